"""From pixels to rays and metres, with the uncertainty carried through."""

from collections.abc import Callable
from dataclasses import dataclass
import math

import cv2
import numpy as np

from vtrack_ros.frame import Array
from vtrack_ros.geometry.box import Box

# Termination of OpenCV's iterative undistortion: iterations, and error below which it stops.
_CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)

#: How many coefficients each distortion model has.
MODELS = {'plumb_bob': (4, 5), 'rational_polynomial': (8,), 'equidistant': (4,)}
#: What a position can be in; 'auto' is the best of the others that is available.
UNITS = ('auto', 'pixels', 'ray', 'metres')


@dataclass(frozen=True)
class Position:
    """
    Where the target is: point (3,) and covariance (3, 3), in 'pixels', 'ray' or 'metres'.

    `slope`, shape (3, 4), is the point's derivative with respect to the box's centre (x, y), width
    and height.
    """

    point: Array
    covariance: Array
    units: str
    slope: Array


@dataclass(frozen=True)
class Camera:
    """
    A calibrated camera: pinhole with distortion; all lengths in pixels.

    For the intrinsics (fx, fy, cx, cy) a pixel's centre has whole coordinates. `coefficients` of
    the distortion model, one of `MODELS`, are in the order of sensor_msgs/msg/CameraInfo; without
    any there's no distortion. The images have a width and a height; `offset` is the place of their
    corner on the sensor, in the sensor's pixels, and `binning` the number of the sensor's pixels
    to one of theirs; both in x and y.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    model: str = 'plumb_bob'
    coefficients: tuple[float, ...] = ()
    offset: tuple[float, float] = (0.0, 0.0)
    binning: tuple[float, float] = (1.0, 1.0)

    def project(self, x: float, y: float) -> tuple[float, float]:
        """
        Return where a ray at depth 1 meets the image.

        In pixels as a `Box` counts them: from the outer corner of the first pixel.
        """
        place = np.array([[[x, y, 1.0]]]), np.zeros(3), np.zeros(3), self._matrix, self._distortion
        bent = self.model == 'equidistant' and self.coefficients
        projection = cv2.fisheye.projectPoints if bent else cv2.projectPoints
        column, row = projection(*place)[0].ravel()
        return (float(column + 0.5 - self.offset[0]) / self.binning[0],
                float(row + 0.5 - self.offset[1]) / self.binning[1])

    def ray_and_slope(self, column: float, row: float) -> tuple[Array, Array]:
        """
        Return x and y, (2,), of the ray at depth 1 that a place [px] sees, and its derivative.

        The derivative is that of x and y (its rows) with respect to column and row (its columns),
        [1/px]. NaN where the lens model has no such ray: far outside the image it may bend back.
        """
        step = 1e-2
        around = np.array([[0, 0], [step, 0], [-step, 0], [0, step], [0, -step]])
        rays = self._undistorted(np.array([column, row]) + around)
        slope = np.column_stack([rays[1] - rays[2], rays[3] - rays[4]]) / (2 * step)
        back = self.project(*rays[0]) if np.isfinite(rays).all() else (math.nan, math.nan)
        # A lens doesn't mirror the image; a distortion model does outside its valid range.
        upright = slope[0, 0] > 0 and np.linalg.det(slope) > 0
        if not (upright and max(abs(back[0] - column), abs(back[1] - row)) < 1e-6):
            return np.full(2, math.nan), np.full((2, 2), math.nan)
        return rays[0], slope

    def _undistorted(self, places: Array) -> Array:
        """Return x and y at depth 1 of the rays through places on the image, both (n, 2)."""
        sensor = places * self.binning + np.asarray(self.offset) - 0.5
        if not self.coefficients:
            return np.asarray((sensor - (self.cx, self.cy)) / (self.fx, self.fy))
        points = sensor[:, None]
        if self.model == 'equidistant':
            rays = cv2.fisheye.undistortPoints(
                points, self._matrix, self._distortion, criteria=_CRITERIA)
        else:
            # Older versions of OpenCV take the criteria only in a separate function.
            undistort = getattr(cv2, 'undistortPointsIter', cv2.undistortPoints)
            rays = undistort(points, self._matrix, self._distortion, R=None, P=None,
                             criteria=_CRITERIA)
        return np.asarray(rays, np.float64).reshape(-1, 2)

    @property
    def _matrix(self) -> Array:
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def _distortion(self) -> Array:
        return np.array(self.coefficients or (0.0,) * 4)


@np.errstate(over='ignore', invalid='ignore')  # no position if not finite
def locate(box: Box, box_covariance: Array, camera: Camera | None, units: str = 'auto',
           width: float = 0.0, height: float = 0.0) -> Position | None:
    """
    Return where the target is, with the box's covariance carried through to first order.

    The covariance, shape (4, 4), [px^2], is over centre x, centre y, width, height; `camera` is
    None if there's no calibration. Width and height are the target's real size, [m], 0 where
    unknown; the height is used where the width is unknown.

    Units are 'pixels', on the image, z = 0; 'ray', at depth 1 in the optical frame (x right, y
    down, z forward); 'metres', in the same frame; 'auto' for the best of these that is available.
    None where the units aren't available, or the box has no position in them; ValueError for any
    others. A covariance of NaN, which is unknown, stays so.
    """
    if units not in UNITS:
        raise ValueError(f'unknown units {units!r}; valid are ' + ', '.join(UNITS))
    sized = width > 0 or height > 0
    if units == 'auto':
        units = 'pixels' if camera is None else 'metres' if sized else 'ray'
    if units == 'pixels':
        covariance, slope = np.zeros((3, 3)), np.zeros((3, 4))
        covariance[:2, :2] = box_covariance[:2, :2]
        slope[:2, :2] = np.eye(2)
        return Position(np.array([*box.center, 0.0]), covariance, units, slope)
    if camera is None or (units == 'metres' and not sized):
        return None
    cx, cy = box.center
    ray, slope = camera.ray_and_slope(cx, cy)
    direction = np.array([*ray, 1.0])
    # With respect to (centre x, centre y, width, height), as the covariance.
    bend = np.zeros((3, 4))
    bend[:2, :2] = slope
    depth, change = 1.0, np.zeros(4)
    if units == 'metres':
        across = 0 if width > 0 else 1
        depth, change = _depth(camera, box, across, width if width > 0 else height)
    point = depth * direction
    if not np.isfinite(point).all() or depth <= 0:
        return None
    total = depth * bend + np.outer(direction, change)
    covariance = total @ box_covariance @ total.T
    known = not np.isnan(box_covariance).any()
    if not np.isfinite(covariance if known else total).all():
        return None
    return Position(point, covariance, units, total)


def locate_velocity(locate_box: Callable[[Box], Position | None], box: Box, velocity: Array,
                    covariance: Array) -> tuple[Array, Array] | None:
    """
    Return the velocity (3,) of where a moving box is, per second, and its covariance (3, 3).

    `locate_box` says where a box is. The velocity, shape (4,), [px/s], is that of centre x, centre
    y, width, height; the covariance, shape (8, 8), is over those four and their velocities, and is
    carried through to first order. None where the box has no position.
    """
    here = locate_box(box)
    if here is None:
        return None
    # in this time step the box moves by at most a hundredth of its shorter side
    step = 0.01 * min(box.width, box.height) / max(float(np.abs(velocity).max()), 1e-9)
    place = np.array([*box.center, box.width, box.height])
    before, after = (locate_box(Box.from_center(*(place + way)))
                     for way in (-step * velocity, step * velocity))
    # the velocity depends on the box as well, by the second derivatives
    bend = (np.zeros((3, 4)) if before is None or after is None else
            (after.slope - before.slope) / (2 * step))
    slope = np.hstack([bend, here.slope])
    return here.slope @ velocity, slope @ covariance @ slope.T


def _depth(camera: Camera, box: Box, across: int, size: float) -> tuple[float, Array]:
    """Return the depth of a box whose width (across 0) or height (1) is `size` [m]; its slope."""
    half = np.zeros(2)
    half[across] = (box.width, box.height)[across] / 2
    center = np.array(box.center)
    near, near_slope = camera.ray_and_slope(*(center - half))
    far, far_slope = camera.ray_and_slope(*(center + half))
    span = far[across] - near[across]
    change = np.zeros(4)
    change[:2] = far_slope[across] - near_slope[across]
    change[2 + across] = (far_slope[across, across] + near_slope[across, across]) / 2
    depth = size / span if span else math.nan
    return depth, -depth / span * change if span else change * math.nan
