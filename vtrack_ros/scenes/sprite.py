"""Sprites: pictures with an alpha channel, their placement and their motion."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
import math

import cv2
import numpy as np

from vtrack_ros.frame import Array, Array32

#: A 2-D affine map, shape (2, 3).
Affine = Array
#: A value that changes with time in frames.
Motion = Callable[[float], float]


@dataclass(frozen=True)
class Placement:
    """A sprite's position in the world, scale and rotation angle (clockwise, in radians)."""

    x: float
    y: float
    scale: float = 1.0
    angle: float = 0.0

    def matrix(self) -> Affine:
        """Return the map from the sprite's coordinates to the world's, shape (2, 3)."""
        cos, sin = self.scale * math.cos(self.angle), self.scale * math.sin(self.angle)
        return np.array([[cos, -sin, self.x], [sin, cos, self.y]])


def compose(outer: Affine, inner: Affine) -> Affine:
    """Return the affine map that applies `inner`, then `outer`."""
    linear = outer[:, :2] @ inner[:, :2]
    offset = outer[:, :2] @ inner[:, 2] + outer[:, 2]
    return np.column_stack([linear, offset])


@dataclass(frozen=True, eq=False)
class Sprite:
    """
    A picture, (H, W, 4): blue, green, red, 0 to 255, premultiplied by alpha; and alpha, 0 to 1.

    A length of 1 has `unit` pixels; `left` and `top` are the picture's top-left corner.
    """

    pixels: Array32
    unit: float
    left: float
    top: float

    @cached_property
    def outline(self) -> Array:
        """Return where alpha crosses one half along rows and columns, shape (n, 2)."""
        alpha = np.pad(self.pixels[..., 3].astype(np.float64), 1)
        points = [_crossings(alpha), _crossings(alpha.T)[:, ::-1]]
        return np.concatenate(points) / self.unit + (self.left, self.top)

    @cached_property
    def _levels(self) -> list[Array32]:
        levels = [self.pixels]
        while min(levels[-1].shape[:2]) > 3:
            height, width = levels[-1].shape[:2]
            size = ((width + 1) // 2, (height + 1) // 2)
            levels.append(np.asarray(
                cv2.resize(levels[-1], size, interpolation=cv2.INTER_AREA), np.float32))
        return levels

    def bounds(self, matrix: Affine) -> tuple[int, int, int, int]:
        """Return left, top, right, bottom, in whole pixels, of the picture mapped by `matrix`."""
        height, width = self.pixels.shape[:2]
        right, bottom = self.left + width / self.unit, self.top + height / self.unit
        corners = np.array([[self.left, self.top], [right, self.top], [self.left, bottom],
                            [right, bottom]])
        mapped = corners @ matrix[:, :2].T + matrix[:, 2]
        low, high = np.floor(mapped.min(axis=0)) - 1, np.ceil(mapped.max(axis=0)) + 1
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])

    def warped(self, matrix: Affine, bounds: tuple[int, int, int, int]) -> Array32:
        """Return the picture, mapped by `matrix`, in a window (left, top, right, bottom)."""
        shrink = math.sqrt(abs(np.linalg.det(matrix[:, :2]))) / self.unit
        level = 0
        while shrink < 0.7 and level + 1 < len(self._levels):
            level, shrink = level + 1, shrink * 2
        pixels = self._levels[level]
        ratio_x = self.pixels.shape[1] / pixels.shape[1] / self.unit
        ratio_y = self.pixels.shape[0] / pixels.shape[0] / self.unit
        # OpenCV's origin is the centre of the first pixel, ours its corner.
        to_sprite = np.array([[ratio_x, 0, self.left + 0.5 * ratio_x],
                              [0, ratio_y, self.top + 0.5 * ratio_y]])
        to_window = np.array([[1, 0, -bounds[0] - 0.5], [0, 1, -bounds[1] - 0.5]])
        full = compose(to_window, compose(matrix, to_sprite))
        size = (bounds[2] - bounds[0], bounds[3] - bounds[1])
        return np.asarray(cv2.warpAffine(pixels, full, size, flags=cv2.INTER_LINEAR), np.float32)


def mapped_bounds(outline: Array, matrix: Affine) -> tuple[float, ...]:
    """Return x, y, width and height of the bounding box of an outline mapped by `matrix`."""
    mapped = outline @ matrix[:, :2].T + matrix[:, 2]
    low, high = mapped.min(axis=0), mapped.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])


def _crossings(alpha: Array) -> Array:
    """Return (x, y) of the first and last crossing of one half in each row of a padded alpha."""
    inside = alpha >= 0.5
    rows = np.flatnonzero(inside.any(axis=1))
    first = inside[rows].argmax(axis=1)
    last = inside.shape[1] - 1 - inside[rows, ::-1].argmax(axis=1)
    # A pixel's value is that at its centre, at + 0.5; - 1 undoes the padding.
    before, at = alpha[rows, first - 1], alpha[rows, first]
    x_first = first - 0.5 - (at - 0.5) / (at - before)
    before, at = alpha[rows, last + 1], alpha[rows, last]
    x_last = last - 0.5 + (at - 0.5) / (at - before)
    y = rows - 0.5
    return np.concatenate([np.column_stack([x_first, y]), np.column_stack([x_last, y])])


def keyframes(*points: tuple[float, float]) -> Motion:
    """Return a smooth motion through (time, value) points, without overshoot; constant outside."""
    # Imported here, as it takes as long to load as all else that the tools need, and many of them
    # render no scene.
    from scipy.interpolate import PchipInterpolator
    times, values = zip(*points)
    curve = PchipInterpolator(times, values)
    return lambda time: float(curve(min(max(time, times[0]), times[-1])))


def piecewise_linear(*points: tuple[float, float]) -> Motion:
    """Return the linear interpolation of (time, value) points; constant outside."""
    times, values = zip(*points)
    return lambda time: float(np.interp(time, times, values))


def unrest(rng: np.random.Generator, amplitude: float, period: float) -> Motion:
    """Return an irregular motion about 0: a sum of sines of 0.35 to 1.6 times a period."""
    periods = period * rng.uniform(0.35, 1.6, 5)
    phases = rng.uniform(0, 2 * math.pi, 5)
    parts = [(amplitude * 0.63 * math.sqrt(size / period), 2 * math.pi / size, phase)
             for size, phase in zip(periods, phases)]
    return lambda time: float(sum(a * math.sin(w * time + p) for a, w, p in parts))
