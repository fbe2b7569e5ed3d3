"""
Headers, rotations and poses as messages.

Every function takes the message types, classes of rclpy or of rosbags by their full names.
"""

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np

from vtrack_ros.frame import Array

#: Variance of an unknown angle, in rad^2: that of a uniform distribution over the full circle.
UNKNOWN_ANGLE = math.pi ** 2 / 3
#: Variance of an angular velocity, which isn't measured, in rad^2/s^2.
UNKNOWN_RATE = 1e6

Types = Mapping[str, Any]


def header(types: Types, stamp: int, frame_id: str) -> Any:
    """Return a std_msgs/msg/Header of a stamp in nanoseconds."""
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    time = types['builtin_interfaces/msg/Time'](sec=seconds, nanosec=nanoseconds)
    return types['std_msgs/msg/Header'](stamp=time, frame_id=frame_id)


def rotation(types: Types, angle: float) -> Any:
    """Return the rotation by `angle` [rad] about the optical axis (z, away from the camera)."""
    return types['geometry_msgs/msg/Quaternion'](
        x=0.0, y=0.0, z=math.sin(angle / 2), w=math.cos(angle / 2))


def pose(types: Types, position: Sequence[float] | Array, angle: float) -> Any:
    """Return a geometry_msgs/msg/Pose; the angle [rad] is about the optical axis."""
    x, y, z = (float(value) for value in position)
    return types['geometry_msgs/msg/Pose'](
        position=types['geometry_msgs/msg/Point'](x=x, y=y, z=z),
        orientation=rotation(types, angle))


def pose_with_covariance(types: Types, position: Sequence[float] | Array,
                         angle: float, covariance: Array | None) -> Any:
    """
    Return a geometry_msgs/msg/PoseWithCovariance, over (x, y, z, about x, about y, about z).

    `covariance` (3, 3) is the position's; if it's None or NaN, unknown, all are 0, as elsewhere in
    ROS. No tracker estimates the uncertainty of the rotation: its variances are those of a uniform
    angle.
    """
    return types['geometry_msgs/msg/PoseWithCovariance'](
        pose=pose(types, position, angle), covariance=_completed(covariance, UNKNOWN_ANGLE))


def twist_with_covariance(types: Types, velocity: Array, covariance: Array) -> Any:
    """
    Return a geometry_msgs/msg/TwistWithCovariance of a linear velocity (3,).

    `covariance` (3, 3) is the velocity's; if it's NaN, unknown, all are 0. No tracker measures the
    angular velocity: it's 0, with a large variance.
    """
    vector = types['geometry_msgs/msg/Vector3']
    x, y, z = (float(value) for value in velocity)
    return types['geometry_msgs/msg/TwistWithCovariance'](
        twist=types['geometry_msgs/msg/Twist'](
            linear=vector(x=x, y=y, z=z), angular=vector(x=0.0, y=0.0, z=0.0)),
        covariance=_completed(covariance, UNKNOWN_RATE))


def particle_poses(types: Types, header: Any, particles: Array | None) -> Any:
    """Return the particles' centres [px] as a PoseArray; `particles` (N, 4) or None."""
    places = [] if particles is None else np.asarray(particles, np.float64)[:, :2].tolist()
    still, point = rotation(types, 0.0), types['geometry_msgs/msg/Point']
    kind = types['geometry_msgs/msg/Pose']
    return types['geometry_msgs/msg/PoseArray'](header=header, poses=[
        kind(position=point(x=x, y=y, z=0.0), orientation=still) for x, y in places])


def _completed(covariance: Array | None, angular: float) -> Array:
    """Return a covariance (3, 3) with angular variances, shape (36,); all 0 if it's unknown."""
    full = np.zeros((6, 6))
    if covariance is not None and np.isfinite(covariance).all():
        full[:3, :3] = covariance
        full[3:, 3:] = np.diag([angular] * 3)
    return full.ravel()
