"""Mean shift on a map, and its fusion with particles [Yin2013]."""

import math

import numpy as np

from vtrack_ros.frame import Array, Array32, Point


def fuse(zeta: float, climbed: Point, best: Point, near: float, far: float, accepted: float,
         rejected: float) -> Point | None:
    """
    Fuse the places that mean shift and the particles found [Yin2013, eqs 13-15].

    `zeta` is the similarity at y_ms, the place climbed to; y_pf is the best particle's. They agree
    within the distance `near` (sigma), and are compatible within `far` (sigma a), [px]. From the
    similarity `accepted` (th) on mean shift is trusted, up to `rejected` (r) it isn't at all.
    Returns None if the two contradict each other.
    """
    if zeta <= rejected:
        return best
    distance = math.dist(climbed, best)
    if distance > far:
        return None
    if zeta < accepted:
        return best
    if distance >= near:
        return climbed
    return (zeta * climbed[0] + (1 - zeta) * best[0], zeta * climbed[1] + (1 - zeta) * best[1])


def climbing_weights(response: Array32) -> Array:
    """Return the weights for a climb on a response: its excess over the mean, cubed."""
    above = np.maximum(response.astype(np.float64) - response.mean(), 0.0)
    return above * above * above


def climb(weights: Array, start: Array, bandwidth: Array, steps: int,
          tolerance: float = 0.01) -> Array:
    """
    Climb to a maximum of the kernel density of a weighted map by mean shift [Yin2013, eq. 2].

    Start, bandwidth of the axis-aligned Gaussian kernel and result are (x, y), shape (2,), in
    cells. A step shorter than the tolerance is the last one.
    """
    rows, columns = weights.shape
    column, row = np.arange(float(columns)), np.arange(float(rows))
    x, y = float(start[0]), float(start[1])
    narrow_x, narrow_y = (-0.5 / float(width)**2 for width in bandwidth)
    for _ in range(steps):
        # the kernel is separable: two products of matrix and vector
        kernel_x = np.exp(narrow_x * np.square(column - x))
        kernel_y = np.exp(narrow_y * np.square(row - y))
        in_x = (kernel_y @ weights) * kernel_x
        in_y = (weights @ kernel_x) * kernel_y
        total = float(in_x.sum())
        if total <= 1e-12:
            break
        before_x, before_y = x, y
        x, y = float(in_x @ column) / total, float(in_y @ row) / total
        if max(abs(x - before_x), abs(y - before_y)) < tolerance:
            break
    return np.array([x, y])
