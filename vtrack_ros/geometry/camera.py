"""From pixels to rays and metres, with the uncertainty carried through."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.geometry.box import Box

Vector = NDArray[np.float64]

#: How many coefficients each distortion model has.
MODELS = {'plumb_bob': (4, 5), 'rational_polynomial': (8,), 'equidistant': (4,)}


@dataclass(frozen=True)
class Position:
    """
    Where the target is.

    Parameters
    ----------
    point : ndarray, shape (3,)
        In `units`.
    covariance : ndarray, shape (3, 3)
        In `units` squared.
    units : {'pixels', 'ray', 'metres'}

    """

    point: Vector
    covariance: Vector
    units: str


@dataclass(frozen=True)
class Camera:
    """
    A calibrated camera: pinhole with distortion.

    Parameters
    ----------
    fx, fy, cx, cy : float, [px]
        The intrinsic matrix; a pixel's centre has whole coordinates, as camera_info has it.
    model : str
        The distortion model, one of `MODELS`.
    coefficients : tuple of float
        Its coefficients, in the order of sensor_msgs/msg/CameraInfo; empty: no distortion.
    width, height : int, [px]
        The size of the images that it describes.
    offset : tuple of float, [px]
        Where the image's corner lies on the sensor.
    binning : tuple of float
        How many pixels of the sensor make one of the image, in x and y.

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
        x, y = self._distorted(x, y)
        column = (self.fx * x + self.cx + 0.5 - self.offset[0]) / self.binning[0]
        row = (self.fy * y + self.cy + 0.5 - self.offset[1]) / self.binning[1]
        return column, row

    def ray(self, column: float, row: float) -> tuple[float, float]:
        """
        Return x and y of the ray at depth 1 that a place on the image sees.

        Parameters
        ----------
        column, row : float, [px]
            From the outer corner of the first pixel.

        Returns
        -------
        x, y : float
            NaN where the lens model has no such ray: far outside the image it may bend back.

        """
        (x, y), _ = self.ray_and_slope(column, row)
        return x, y

    def ray_and_slope(self, column: float, row: float) -> tuple[tuple[float, float], Vector]:
        """
        Return a ray as `ray` does, and its derivative by the place on the image.

        Newton's method on the distortion; the derivative of an inverse is the inverse derivative.

        Parameters
        ----------
        column, row : float, [px]
            From the outer corner of the first pixel.

        Returns
        -------
        ray : tuple of float
            x and y at depth 1.
        slope : ndarray, shape (2, 2), [1/px]
            Of x and y (rows) by column and row (columns).

        """
        scale_x, scale_y = self.binning[0] / self.fx, self.binning[1] / self.fy
        wanted_x = (column * self.binning[0] + self.offset[0] - 0.5 - self.cx) / self.fx
        wanted_y = (row * self.binning[1] + self.offset[1] - 0.5 - self.cy) / self.fy
        if not self.coefficients:
            return (wanted_x, wanted_y), np.array([[scale_x, 0.0], [0.0, scale_y]])
        x, y = wanted_x, wanted_y
        for _ in range(30):
            bent_x, bent_y = self._distorted(x, y)
            (xx, xy), (yx, yy) = self._bend(x, y)
            determinant = xx * yy - xy * yx
            if not (math.isfinite(determinant) and abs(determinant) > 1e-12):
                break
            error_x, error_y = bent_x - wanted_x, bent_y - wanted_y
            step_x = (yy * error_x - xy * error_y) / determinant
            step_y = (xx * error_y - yx * error_x) / determinant
            x, y = x - step_x, y - step_y
            if max(abs(step_x), abs(step_y)) < 1e-13:
                break
        bent_x, bent_y = self._distorted(x, y)
        (xx, xy), (yx, yy) = self._bend(x, y)
        determinant = xx * yy - xy * yx
        # A lens doesn't turn the image inside out; a model does, beyond its reach.
        upright = xx + yy > 0 and determinant > 0
        if not (upright and max(abs(bent_x - wanted_x), abs(bent_y - wanted_y)) < 1e-9):
            return (math.nan, math.nan), np.full((2, 2), math.nan)
        return (x, y), np.array([[yy * scale_x, -xy * scale_y],
                                 [-yx * scale_x, xx * scale_y]]) / determinant

    def _bend(self, x: float, y: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the derivative of the distortion, row by row, by central differences."""
        step = 1e-6
        right, left = self._distorted(x + step, y), self._distorted(x - step, y)
        below, above = self._distorted(x, y + step), self._distorted(x, y - step)
        return (((right[0] - left[0]) / (2 * step), (below[0] - above[0]) / (2 * step)),
                ((right[1] - left[1]) / (2 * step), (below[1] - above[1]) / (2 * step)))

    def _distorted(self, x: float, y: float) -> tuple[float, float]:
        d = self.coefficients
        if not d:
            return x, y
        squared = x * x + y * y
        if self.model == 'equidistant':
            radius = math.sqrt(squared)
            if radius < 1e-12:
                return x, y
            angle = math.atan(radius)
            t = angle * angle
            scale = angle * (1 + t * (d[0] + t * (d[1] + t * (d[2] + t * d[3])))) / radius
            return x * scale, y * scale
        k3 = d[4] if len(d) > 4 else 0.0
        radial = 1 + squared * (d[0] + squared * (d[1] + squared * k3))
        if len(d) == 8:
            radial /= 1 + squared * (d[5] + squared * (d[6] + squared * d[7]))
        return (x * radial + 2 * d[2] * x * y + d[3] * (squared + 2 * x * x),
                y * radial + d[2] * (squared + 2 * y * y) + 2 * d[3] * x * y)


def locate(box: Box, box_covariance: Vector, camera: Camera | None, units: str = 'auto',
           width: float = 0.0, height: float = 0.0) -> Position | None:
    """
    Return where the target is, with the box's covariance carried through to first order.

    Parameters
    ----------
    box : Box
        Where the target is on the image.
    box_covariance : ndarray, shape (4, 4), [px^2]
        Over centre x, centre y, width, height.
    camera : Camera or None
        None: not calibrated.
    units : {'auto', 'pixels', 'ray', 'metres'}
        'auto' takes the best that can be had.
    width, height : float, [m]
        The target's real size, 0 where unknown; the height counts where the width is unknown.

    Returns
    -------
    Position or None
        None where it can't be had in those units. Pixels: on the image, z = 0. A ray: at depth 1
        in the optical frame (x right, y down, z forward). Metres: in the same frame.

    """
    sized = width > 0 or height > 0
    if units == 'auto':
        units = 'pixels' if camera is None else 'metres' if sized else 'ray'
    if units == 'pixels':
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = box_covariance[:2, :2]
        return Position(np.array([*box.center, 0.0]), covariance, units)
    if camera is None or (units == 'metres' and not sized):
        return None
    cx, cy = box.center
    ray, slope = camera.ray_and_slope(cx, cy)
    direction = np.array([*ray, 1.0])
    # By (centre x, centre y, width, height), as the covariance.
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
    return Position(point, total @ box_covariance @ total.T, units)


def _depth(camera: Camera, box: Box, across: int, size: float) -> tuple[float, Vector]:
    """
    Return the depth of something of a known size, and its derivative by the box.

    Parameters
    ----------
    camera : Camera
        Whose pixels they are.
    box : Box
        What it covers.
    across : {0, 1}
        Whether `size` is the width or the height.
    size : float, [m]
        The real one.

    """
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
