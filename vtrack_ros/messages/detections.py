"""Boxes as messages of vision_msgs; `types` as in poses.py."""

import math
from typing import Any

from vtrack_ros.frame import Array
from vtrack_ros.geometry import Box
from vtrack_ros.messages.poses import pose_with_covariance, Types
from vtrack_ros.tracker import Estimate


def bounding_box(types: Types, box: Box, theta: float = 0.0) -> Any:
    """Return a BoundingBox2D; theta [rad] is counterclockwise on the image."""
    x, y = box.center
    center = types['vision_msgs/msg/Pose2D'](
        position=types['vision_msgs/msg/Point2D'](x=float(x), y=float(y)), theta=theta)
    return types['vision_msgs/msg/BoundingBox2D'](
        center=center, size_x=float(box.width), size_y=float(box.height))


def oriented_box(types: Types, estimate: Estimate) -> Any:
    """
    Return the target's rotated box as a BoundingBox2D; its plain box without an affine frame.

    The angle of an `Estimate` is positive clockwise on the image, theta of vision_msgs is positive
    counterclockwise.
    """
    if estimate.affine is None:
        return bounding_box(types, estimate.box)
    angle = math.atan2(estimate.affine[1, 0], estimate.affine[0, 0])
    return bounding_box(types, estimate.upright, -angle)


def detections(types: Types, header: Any, box: Box | None, angle: float = 0.0,
               score: float = 1.0, class_id: str = 'target', target_id: str = '',
               covariance: Array | None = None) -> Any:
    """
    Return a Detection2DArray of one box, or an empty one for None.

    The angle [rad] about the optical axis and the covariance (3, 3) [px^2] of the centre (x, y, z)
    go into the pose of the hypothesis.
    """
    found = []
    if box is not None:
        hypothesis = types['vision_msgs/msg/ObjectHypothesis'](
            class_id=class_id, score=float(score))
        result = types['vision_msgs/msg/ObjectHypothesisWithPose'](
            hypothesis=hypothesis,
            pose=pose_with_covariance(types, (*box.center, 0.0), angle, covariance))
        found.append(types['vision_msgs/msg/Detection2D'](
            header=header, results=[result], bbox=bounding_box(types, box), id=target_id))
    return types['vision_msgs/msg/Detection2DArray'](header=header, detections=found)
