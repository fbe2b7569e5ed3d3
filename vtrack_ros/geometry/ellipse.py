"""Rotated ellipses as bandwidth matrices."""

import math

import numpy as np

from vtrack_ros.frame import Array
from vtrack_ros.geometry.box import Box

#: Semi-axes of the ellipse in units of the bandwidth [Yin2013, eq. 8].
SIGMA = 2.5


def axes_of_bandwidth(bandwidth: Array) -> tuple[float, float, float]:
    """
    Return semi-axes and angle of the ellipse of a bandwidth matrix, shape (2, 2), [px^2].

    These are the major and the minor one [px], and the major one's angle from x towards y, in
    (-pi / 2, pi / 2] [Yin2013, eq. 10, where `h11 - h22` is misprinted as `h11 - h12`].
    """
    h11, h22, h12 = float(bandwidth[0, 0]), float(bandwidth[1, 1]), float(bandwidth[0, 1])
    spread = math.sqrt(4 * h12**2 + (h11 - h22)**2)
    major = SIGMA * math.sqrt((h11 + h22 + spread) / 2)
    minor = SIGMA * math.sqrt(max((h11 + h22 - spread) / 2, 0.0))
    return major, minor, 0.5 * math.atan2(2 * h12, h11 - h22)


def bounds_of_bandwidth(center: tuple[float, float], bandwidth: Array) -> Box:
    """Return the axis-aligned bound of the ellipse about a centre (x, y), in pixels."""
    return Box.from_center(
        *center, 2 * SIGMA * math.sqrt(bandwidth[0, 0]), 2 * SIGMA * math.sqrt(bandwidth[1, 1]))


def bounded(frame: Array, first: Array, sizes: tuple[float, float], aspect: float) -> Array:
    """
    Return an ellipse's frame, shape (2, 2), clamped to bounds about `first`, a diagonal one.

    The axes' geometric mean is clamped to the range `sizes`, as shares of the first one's; the
    ratio of major to minor axis to the first one's within a factor `aspect`, and at least 1.
    """
    left, axes, right = np.linalg.svd(frame)
    reference = np.sort(first.diagonal())[::-1]
    ratio = reference[0] / reference[1]
    mean = math.sqrt(axes[0] * axes[1])
    usual = math.sqrt(reference[0] * reference[1])
    mean = min(max(mean, sizes[0] * usual), sizes[1] * usual)
    elongation = min(max(axes[0] / axes[1], max(ratio / aspect, 1.0)), ratio * aspect)
    axes = mean * np.array([math.sqrt(elongation), 1 / math.sqrt(elongation)])
    return (left * axes) @ right


def turned(angle: float, previous: float) -> float:
    """Return an ellipse's angle, known up to half turns, as the one nearest to a previous one."""
    return previous + math.remainder(angle - previous, math.pi)


def square_root(matrix: Array) -> Array:
    """Return the symmetric square root of a symmetric positive definite matrix, shape (2, 2)."""
    # [Levinger 1980]: (M + sqrt(det M) I) / sqrt(trace M + 2 sqrt(det M))
    root = math.sqrt(max(float(matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]), 0.0))
    scale = math.sqrt(float(matrix[0, 0] + matrix[1, 1]) + 2 * root)
    return (matrix + root * np.eye(2)) / scale
