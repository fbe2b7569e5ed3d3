"""What a tracker knows, as messages: every number with the image's own header."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.geometry import Box
from vtrack_ros.trackers import Estimate, TrackState

#: The variance of an angle that may be anything, in rad^2: that of a uniform one.
UNKNOWN_ANGLE = math.pi ** 2 / 3

_LEVELS = {
    TrackState.TRACKING: DiagnosticStatus.OK,
    TrackState.SEARCHING: DiagnosticStatus.WARN,
    TrackState.LOST: DiagnosticStatus.ERROR,
}


def rotation(angle: float) -> Quaternion:
    """Return the rotation by `angle` [rad] about the optical axis (z, away from the camera)."""
    return Quaternion(x=0.0, y=0.0, z=math.sin(angle / 2), w=math.cos(angle / 2))


def pose(position: tuple[float, float, float], angle: float) -> Pose:
    """Return a pose; the angle [rad] is about the optical axis."""
    x, y, z = position
    return Pose(position=Point(x=float(x), y=float(y), z=float(z)), orientation=rotation(angle))


def covariance36(position: NDArray[np.float64]) -> list[float]:
    """
    Return a pose's covariance, row by row over (x, y, z, about x, about y, about z).

    Parameters
    ----------
    position : ndarray, shape (3, 3)
        The position's covariance. No tracker estimates how sure it is of the rotation: its
        variances are those of a uniform angle.

    """
    full = np.diag([0.0, 0.0, 0.0, UNKNOWN_ANGLE, UNKNOWN_ANGLE, UNKNOWN_ANGLE])
    full[:3, :3] = position
    return [float(value) for value in full.ravel()]


def fill_bounds(message: Any, box: Box, theta: float = 0.0) -> None:
    """
    Write a box into a vision_msgs/msg/BoundingBox2D.

    Parameters
    ----------
    message : vision_msgs/msg/BoundingBox2D
        What is filled.
    box : Box
        In pixels of the image.
    theta : float, [rad]
        Counterclockwise as one looks at the image.

    """
    message.center.position.x, message.center.position.y = box.center
    message.center.theta = theta
    message.size_x, message.size_y = box.width, box.height


def fill_oriented(message: Any, estimate: Estimate) -> None:
    """
    Write the target's rotated box into a BoundingBox2D; its plain box where it has no rotation.

    An `Estimate`'s angle is clockwise-positive on the image, vision_msgs' theta the other way.
    """
    if estimate.affine is None:
        fill_bounds(message, estimate.box)
        return
    affine = estimate.affine
    width, height = np.hypot(affine[0, :2], affine[1, :2])
    angle = math.atan2(affine[1, 0], affine[0, 0])
    box = Box.from_center(affine[0, 2], affine[1, 2], width, height)
    fill_bounds(message, box, -angle)


def particle_poses(header: Any, particles: NDArray[np.float64] | None) -> PoseArray:
    """Return the particles' centres, in pixels; `particles` has shape (N, 4) or is None."""
    message = PoseArray(header=header)
    if particles is not None:
        still = rotation(0.0)
        message.poses = [
            Pose(position=Point(x=x, y=y, z=0.0), orientation=still)
            for x, y in np.asarray(particles, np.float64)[:, :2].tolist()]
    return message


def state_status(name: str, tracker: str, word: str, estimate: Estimate | None,
                 values: Mapping[str, str], stale: bool = False) -> DiagnosticStatus:
    """
    Return the target's state.

    Parameters
    ----------
    name : str
        The node's full name.
    tracker : str
        The tracker's name.
    word : str
        The state: that of the estimate, or why there is none.
    estimate : Estimate or None
        What the tracker knows.
    values : mapping of str to str
        More to tell.
    stale : bool
        Whether the estimate is no longer of what the camera sees now.

    """
    rows = {'tracker': tracker, **values}
    level = DiagnosticStatus.OK
    if estimate is not None:
        if word == estimate.state.value:
            # Who paused it has no need of a warning.
            level = max(_LEVELS[estimate.state], DiagnosticStatus.WARN if stale else level)
        box = estimate.box
        rows['box'] = ('stale' if stale else
                       'measured' if estimate.measured else 'predicted')
        rows['confidence'] = f'{estimate.confidence:.3f}'
        rows['x'], rows['y'] = f'{box.x:.2f} px', f'{box.y:.2f} px'
        rows['width'], rows['height'] = f'{box.width:.2f} px', f'{box.height:.2f} px'
    return DiagnosticStatus(
        level=level, name=f'{name}: target', message=word, hardware_id=tracker,
        values=[KeyValue(key=key, value=value) for key, value in rows.items()])
