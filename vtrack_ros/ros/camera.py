"""From pixels to rays and metres, with the uncertainty carried through."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.geometry import Box
from vtrack_ros.trackers import Estimate

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

    @classmethod
    def from_message(cls, message: Any) -> Camera:
        """
        Read a sensor_msgs/msg/CameraInfo.

        Raises
        ------
        ValueError
            If it isn't calibrated, or its distortion model is unknown.

        """
        matrix = [float(value) for value in message.k]
        if not all(map(math.isfinite, matrix)) or matrix[0] <= 0 or matrix[4] <= 0:
            raise ValueError(
                f'camera_info is not calibrated: fx and fy of k are {matrix[0]:g} and '
                f'{matrix[4]:g}, but must be positive')
        coefficients = tuple(float(value) for value in message.d)
        model = message.distortion_model
        if not any(coefficients):
            model, coefficients = 'plumb_bob', ()
        elif model not in MODELS:
            raise ValueError(f'camera_info has the unknown distortion model {model!r}; valid are '
                             + ', '.join(MODELS))
        elif len(coefficients) not in MODELS[model] or not all(map(math.isfinite, coefficients)):
            raise ValueError(
                f'camera_info has {len(coefficients)} distortion coefficients; {model} needs '
                + ' or '.join(map(str, MODELS[model])) + ' finite ones')
        roi = message.roi
        binning = (max(1, message.binning_x), max(1, message.binning_y))
        width, height = roi.width or message.width, roi.height or message.height
        return cls(matrix[0], matrix[4], matrix[2], matrix[5],
                   int(width) // binning[0], int(height) // binning[1], model, coefficients,
                   (float(roi.x_offset), float(roi.y_offset)),
                   (float(binning[0]), float(binning[1])))

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

        Newton's method on the distortion, whose derivative is taken numerically.

        Parameters
        ----------
        column, row : float, [px]
            From the outer corner of the first pixel.

        Returns
        -------
        x, y : float
            NaN where the lens model has no such ray: far outside the image it may bend back.

        """
        x = (column * self.binning[0] + self.offset[0] - 0.5 - self.cx) / self.fx
        y = (row * self.binning[1] + self.offset[1] - 0.5 - self.cy) / self.fy
        if not self.coefficients:
            return x, y
        target = np.array([x, y])
        guess = target.copy()
        for _ in range(20):
            error = np.array(self._distorted(guess[0], guess[1])) - target
            slope = jacobian(lambda p: np.array(self._distorted(p[0], p[1])), guess, 1e-6)
            step = np.linalg.lstsq(slope, error, rcond=None)[0]
            guess = guess - step
            if np.abs(step).max() < 1e-13:
                break
        missed = np.array(self._distorted(guess[0], guess[1])) - target
        slope = jacobian(lambda p: np.array(self._distorted(p[0], p[1])), guess, 1e-6)
        # A lens doesn't turn the image inside out; a model does, beyond its reach.
        upright = np.trace(slope) > 0 and np.linalg.det(slope) > 0
        if not (upright and np.abs(missed).max() < 1e-9):
            return math.nan, math.nan
        return float(guess[0]), float(guess[1])

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


def jacobian(function: Callable[[Vector], Vector], point: Vector, step: float) -> Vector:
    """Return the derivative of a function by central differences, shape (outputs, inputs)."""
    columns = []
    for index in range(point.size):
        offset = np.zeros(point.size)
        offset[index] = step
        columns.append((function(point + offset) - function(point - offset)) / (2 * step))
    return np.stack(columns, axis=1)


def locate(estimate: Estimate, camera: Camera | None, units: str = 'auto',
           width: float = 0.0, height: float = 0.0) -> Position | None:
    """
    Return where the target is, with the box's covariance carried through to first order.

    Parameters
    ----------
    estimate : Estimate
        The box and its covariance.
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
        covariance[:2, :2] = estimate.covariance[:2, :2]
        return Position(np.array([*estimate.box.center, 0.0]), covariance, units)
    if camera is None or (units == 'metres' and not sized):
        return None
    known = camera

    def place(values: Vector) -> Vector:
        cx, cy, box_width, box_height = (float(value) for value in values)
        x, y = known.ray(cx, cy)
        depth = 1.0
        if units == 'metres' and width > 0:
            left, right = known.ray(cx - box_width / 2, cy), known.ray(cx + box_width / 2, cy)
            depth = width / (right[0] - left[0])
        elif units == 'metres':
            top, bottom = known.ray(cx, cy - box_height / 2), known.ray(cx, cy + box_height / 2)
            depth = height / (bottom[1] - top[1])
        return depth * np.array([x, y, 1.0])

    box: Box = estimate.box
    values = np.array([*box.center, box.width, box.height])
    step = min(1e-3, box.width / 4, box.height / 4)
    point = place(values)
    if not np.isfinite(point).all() or point[2] <= 0:
        return None
    slope = jacobian(place, values, step)
    return Position(point, slope @ estimate.covariance @ slope.T, units)
