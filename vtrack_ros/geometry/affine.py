"""The group of two-dimensional affine transformations: exponential, logarithm, mean."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Array

_Complex = NDArray[np.complex128]

#: Lower clamp of half the difference of two eigenvalues, relative to the function's own scale:
#: below it, a quotient of differences loses digits.
_LEAST_RADIUS = 1e-5


def from_coordinates(coordinates: Array) -> Array:
    """
    Return elements of the Lie algebra aff(2), shape (..., 3, 3), from coordinates (..., 6).

    These are the change of scale, aspect ratio, rotation (clockwise as one looks at an image,
    since y points down), skew, and translation along x and y [Kwon and Park 2010, sec. 3.1].
    """
    scale, aspect, rotation, skew, x, y = np.moveaxis(np.asarray(coordinates, float), -1, 0)
    element = np.zeros((*scale.shape, 3, 3))
    element[..., 0, 0], element[..., 0, 1] = scale + aspect, skew - rotation
    element[..., 1, 0], element[..., 1, 1] = skew + rotation, scale - aspect
    element[..., 0, 2], element[..., 1, 2] = x, y
    return element


def exponential(element: Array) -> Array:
    """
    Return the exponential of elements of the Lie algebra, shape (..., 3, 3), in closed form.

    exp([A, v; 0, 0]) = [exp(A), phi(A) v; 0, 1] with phi(z) = (exp(z) - 1) / z; both functions of
    the 2 x 2 matrix come from its eigenvalues.
    """
    linear, translation = element[..., :2, :2], element[..., :2, 2]
    result = np.zeros_like(element)
    result[..., :2, :2] = _function(np.exp, linear)
    result[..., :2, 2] = _times(_function(_relative_exponential, linear), translation)
    result[..., 2, 2] = 1
    return result


def logarithm(transformation: Array) -> Array:
    """
    Return the principal logarithm of transformations, shape (..., 3, 3).

    It's unique only while the linear part has no eigenvalue on the negative real axis, that is
    for rotations by less than half a turn. Elsewhere the result is NaN: the caller decides how to
    treat a step that is too large to have a direction.
    """
    linear, translation = transformation[..., :2, :2], transformation[..., :2, 2]
    half_trace = (linear[..., 0, 0] + linear[..., 1, 1]) / 2
    area = determinant(linear)
    defined = (area > 0) & ((half_trace > 0) | (half_trace**2 < area))
    safe = np.where(defined[..., None, None], linear, np.eye(2))
    result = np.zeros_like(transformation)
    result[..., :2, :2] = logarithm_of_linear = _function(np.log, safe, scale(safe))
    inverse = _function(lambda z: 1 / _relative_exponential(z), logarithm_of_linear)
    result[..., :2, 2] = _times(inverse, translation)
    result[~defined] = np.nan
    return result


def inverse(transformation: Array) -> Array:
    """Return the inverse of transformations of shape (..., 3, 3)."""
    a, b, c, d = (transformation[..., i, j] for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    result = np.zeros_like(transformation)
    area = a * d - b * c
    result[..., 0, 0], result[..., 0, 1] = d / area, -b / area
    result[..., 1, 0], result[..., 1, 1] = -c / area, a / area
    result[..., :2, 2] = -_times(result[..., :2, :2], transformation[..., :2, 2])
    result[..., 2, 2] = 1
    return result


def group_mean(transformations: Array, weights: Array) -> Array:
    """
    Return the mean, shape (3, 3), of transformations (N, 3, 3) that are near each other.

    The linear parts are averaged in the tangent space at the one of largest weight,
    R_max exp(sum_j w_j log(R_max^-1 R_j)), and the translations arithmetically
    [Xiang, sec. 2.2; Kwon and Park 2010, sec. 4.3]. Weights need not be normalised.
    """
    share = weights / weights.sum()
    heaviest = np.zeros((3, 3))
    heaviest[:2, :2] = transformations[int(share.argmax()), :2, :2]
    heaviest[2, 2] = 1
    linear = transformations.copy()
    linear[:, :2, 2] = 0
    steps = logarithm(inverse(heaviest) @ linear)
    # a particle that is half a turn away has no logarithm, and is left out
    near = np.isfinite(steps[:, 0, 0])
    step = np.einsum('n,nij->ij', share[near], steps[near]) / share[near].sum()
    mean: Array = heaviest @ exponential(step)
    mean[:2, 2] = share @ transformations[:, :2, 2]
    return mean


def angle(transformation: Array) -> Array:
    """Return the angle, [rad], of the rotation nearest to each linear part; shape (...)."""
    linear = transformation[..., :2, :2]
    return np.arctan2(linear[..., 1, 0] - linear[..., 0, 1], linear[..., 0, 0] + linear[..., 1, 1])


def scale(transformation: Array) -> Array:
    """Return the square root of the area's change, shape (...)."""
    return np.sqrt(np.abs(determinant(transformation[..., :2, :2])))


def stretch(transformation: Array) -> Array:
    """Return the ratio of the linear parts' singular values, at least 1, shape (...)."""
    linear = transformation[..., :2, :2]
    # of [[p + q, s - r], [s + r, p - q]] the singular values are |(p, r)| +- |(q, s)|
    even = np.hypot(linear[..., 0, 0] + linear[..., 1, 1], linear[..., 1, 0] - linear[..., 0, 1])
    odd = np.hypot(linear[..., 0, 0] - linear[..., 1, 1], linear[..., 1, 0] + linear[..., 0, 1])
    return (even + odd) / np.maximum(np.abs(even - odd), 1e-300)


def bounds(transformation: Array, size: tuple[float, float]) -> Array:
    """
    Return the axis-aligned bounds of the images of a rectangle about the origin.

    The transformations (..., 3, 3) map the rectangle, of size (width, height), into the image;
    bounds (..., 4) are (centre x, centre y, width, height) in pixels.
    """
    extent = np.abs(transformation[..., :2, :2] * np.array(size)).sum(-1)
    return np.concatenate([transformation[..., :2, 2], extent], axis=-1)


def ellipse_bounds(transformation: Array, size: tuple[float, float]) -> Array:
    """
    Return the `bounds` of the images of the ellipse inscribed in the rectangle.

    Few targets have corners: the bounds of a round one don't grow when it turns.
    """
    extent = np.linalg.norm(transformation[..., :2, :2] * np.array(size), axis=-1)
    return np.concatenate([transformation[..., :2, 2], extent], axis=-1)


def from_vector(vector: Array) -> Array:
    """
    Return transformations, shape (..., 3, 3), from geometric parameters [Ross2008].

    These, shape (..., 6), are the log scale, half the log ratio of the stretches, rotation [rad],
    direction of the skew [rad], x and y. The stretch comes before the rotation. Its direction is
    counted against the rotation: counterclockwise as one looks at an image.
    """
    size, aspect, turn, direction, x, y = np.moveaxis(np.asarray(vector, float), -1, 0)
    along = rotation(direction)
    stretched = np.zeros_like(along)
    stretched[..., 0, 0], stretched[..., 1, 1] = np.exp(size + aspect), np.exp(size - aspect)
    result = np.zeros((*size.shape, 3, 3))
    result[..., :2, :2] = rotation(turn - direction) @ stretched @ along
    result[..., 0, 2], result[..., 1, 2], result[..., 2, 2] = x, y, 1
    return result


def transformation(center: tuple[float, float], size: tuple[float, float], turn: float) -> Array:
    """Return the map of the unit square about the origin onto a turned rectangle, (3, 3)."""
    result = np.eye(3)
    result[:2, :2] = rotation(np.asarray(turn)) * size
    result[:2, 2] = center
    return result


def rotation(turn: Array) -> Array:
    """Return the matrices, shape (..., 2, 2), of rotations, [rad], of shape (...)."""
    cosine, sine = np.cos(turn), np.sin(turn)
    return np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)


def determinant(linear: Array) -> Array:
    """Return the determinants of matrices of shape (..., 2, 2), shape (...)."""
    return linear[..., 0, 0] * linear[..., 1, 1] - linear[..., 0, 1] * linear[..., 1, 0]


def _times(linear: Array, vectors: Array) -> Array:
    result: Array = np.einsum('...ij,...j->...i', linear, vectors)
    return result


def _relative_exponential(z: _Complex) -> _Complex:
    """Return (exp(z) - 1) / z, which is 1 at 0."""
    zero = z == 0
    return np.where(zero, 1.0, np.expm1(z) / np.where(zero, 1.0, z))


def _function(function: Callable[[_Complex], _Complex], linear: Array,
              size: Array | float = 1.0) -> Array:
    """
    Return an analytic function, real on the real axis, of 2 x 2 matrices.

    It must be smooth over distances of about `size`, which broadcasts with the matrices (...).
    With eigenvalues m +- r and traceless part B, it's
    (f(m + r) + f(m - r)) / 2 I + (f(m + r) - f(m - r)) / (2 r) B.
    """
    middle = (linear[..., 0, 0] + linear[..., 1, 1]) / 2
    traceless = linear - middle[..., None, None] * np.eye(2)
    radius: _Complex = np.sqrt(-determinant(traceless) + 0j)
    # if the eigenvalues are equal, a small step about them gives the derivative
    least = _LEAST_RADIUS * size
    radius = np.where(np.abs(radius) < least, least + 0j, radius)
    above, below = function(middle + radius), function(middle - radius)
    even, odd = ((above + below) / 2).real, ((above - below) / (2 * radius)).real
    return even[..., None, None] * np.eye(2) + odd[..., None, None] * traceless
