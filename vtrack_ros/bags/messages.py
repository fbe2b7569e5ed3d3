"""The messages in our bags, made and read without ROS."""

from functools import cache
from typing import Any

import cv2
import numpy as np
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore

from vtrack_ros.bags.truth import true_box
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.messages import detections as builder, poses
from vtrack_ros.messages.images import fill_image
from vtrack_ros.session.motion_filter import Motion

IMAGE = 'sensor_msgs/msg/Image'
COMPRESSED_IMAGE = 'sensor_msgs/msg/CompressedImage'
DETECTIONS = 'vision_msgs/msg/Detection2DArray'
POSE = 'geometry_msgs/msg/PoseStamped'
TWIST = 'geometry_msgs/msg/TwistWithCovarianceStamped'

#: The message types that frames are read from.
IMAGE_TYPES = (IMAGE, COMPRESSED_IMAGE)

# Definitions of vision_msgs 4.1, which rosbags' type store lacks. They are copied here, because
# bags are also read where vision_msgs isn't installed.
_VISION_MSGS = {
    'Point2D': 'float64 x\nfloat64 y\n',
    'Pose2D': 'vision_msgs/Point2D position\nfloat64 theta\n',
    'BoundingBox2D': 'vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n',
    'ObjectHypothesis': 'string class_id\nfloat64 score\n',
    'ObjectHypothesisWithPose':
        'vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n',
    'Detection2D':
        'std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n'
        'vision_msgs/BoundingBox2D bbox\nstring id\n',
    'Detection2DArray':
        'std_msgs/Header header\nvision_msgs/Detection2D[] detections\n',
}


@cache
def typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy, and those of vision_msgs that we use."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, definition in _VISION_MSGS.items():
        types.update(get_types_from_msg(definition, f'vision_msgs/msg/{name}'))
    store.register(types)
    return store


def header(stamp: int, frame_id: str) -> Any:
    """Return a std_msgs/msg/Header of a stamp in nanoseconds."""
    return poses.header(typestore().types, stamp, frame_id)


def image(frame: Frame, stamp: int, frame_id: str) -> Any:
    """Return a sensor_msgs/msg/Image, bgr8 or mono8 as the frame is."""
    message = _make(
        IMAGE, header=header(stamp, frame_id), height=0, width=0, encoding='', is_bigendian=0,
        step=0, data=np.zeros(0, np.uint8))
    fill_image(message, frame)
    message.data = np.frombuffer(message.data, np.uint8)
    return message


def compressed_image(frame: Frame, stamp: int, frame_id: str, compression: str) -> Any:
    """Return a sensor_msgs/msg/CompressedImage: png, lossless, or jpeg of quality 90."""
    options = [cv2.IMWRITE_JPEG_QUALITY, 90] if compression == 'jpeg' else []
    _, data = cv2.imencode('.jpg' if compression == 'jpeg' else '.png', frame, options)
    encoding = 'mono8' if frame.ndim == 2 else 'bgr8'
    return _make(
        COMPRESSED_IMAGE, header=header(stamp, frame_id),
        format=f'{encoding}; {compression} compressed {encoding}', data=data.ravel())


def detections(box: Box | None, stamp: int, frame_id: str, angle: float = 0.0,
               score: float = 1.0) -> Any:
    """Return a vision_msgs/msg/Detection2DArray; arguments as in `messages.detections`."""
    return builder.detections(typestore().types, header(stamp, frame_id), box, angle, score)


def detected_box(message: Any) -> Box | None:
    """Return the box of a Detection2DArray's first detection; None if missing or without area."""
    if not message.detections:
        return None
    bounds = message.detections[0].bbox
    return true_box(bounds.center.position.x - bounds.size_x / 2,
                    bounds.center.position.y - bounds.size_y / 2, bounds.size_x, bounds.size_y)


def pose(x: float, y: float, angle: float, stamp: int, frame_id: str) -> Any:
    """Return a geometry_msgs/msg/PoseStamped in the image plane: pixels, and radians about z."""
    return _make(POSE, header=header(stamp, frame_id),
                 pose=poses.pose(typestore().types, (x, y, 0.0), angle))


def twist(motion: Motion, stamp: int, frame_id: str) -> Any:
    """Return a geometry_msgs/msg/TwistWithCovarianceStamped in the image plane, in pixels."""
    velocity, covariance = np.zeros(3), np.zeros((3, 3))
    velocity[:2], covariance[:2, :2] = motion.velocity[:2], motion.covariance[4:6, 4:6]
    return _make(TWIST, header=header(stamp, frame_id), twist=poses.twist_with_covariance(
        typestore().types, velocity, covariance))


def _make(name: str, **fields: Any) -> Any:
    return typestore().types[name](**fields)
