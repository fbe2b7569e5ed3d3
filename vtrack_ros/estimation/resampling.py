"""
Resampling: which particles live on, and how often.

Each scheme is a function `scheme(weights, count, rng)` that returns `count` indices, ascending,
in time O(N + count); particle i is drawn `count * weights[i]` times on average. They differ in
the variance of that number (see Douc, Cappe and Moulines, 2005): multinomial has the largest,
residual and stratified have less, systematic usually least.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.estimation.validation import checked_count, FloatArray

Indices: TypeAlias = NDArray[np.intp]
Resampler: TypeAlias = Callable[[FloatArray, int, np.random.Generator], Indices]


def systematic(weights: FloatArray, count: int, rng: np.random.Generator) -> Indices:
    """
    Resample with one uniform number: the points (j + u) / count on the cumulated weights.

    Parameters
    ----------
    weights : ndarray, shape (N,)
        Non-negative; need not be normalised.
    count : int
        How many indices to draw, at least one.
    rng : numpy.random.Generator
        Where randomness comes from.

    Returns
    -------
    ndarray of intp, shape (count,)

    Raises
    ------
    ValueError
        If the weights aren't finite, non-negative and with a positive sum, or `count` < 1.

    """
    return _offspring(_cumulated(weights, count), rng.random())


def stratified(weights: FloatArray, count: int, rng: np.random.Generator) -> Indices:
    """
    Resample with one uniform number in each of `count` equal strata.

    Parameters, result and errors are those of `systematic`.
    """
    cumulated = _cumulated(weights, count)
    stratum = np.minimum(cumulated.astype(np.intp), count - 1)
    points = rng.random(count)
    cumulated -= stratum
    ends = stratum + (points[stratum] < cumulated).astype(np.float64)
    ends[-1] = count
    return _offspring(ends)


def residual(weights: FloatArray, count: int, rng: np.random.Generator) -> Indices:
    """
    Resample floor(count * weight) copies of each, and the rest by multinomial resampling.

    Parameters, result and errors are those of `systematic`.
    """
    expected = _checked(weights, count) * count
    copies = np.floor(expected)
    remaining = count - int(copies.sum())
    if remaining > 0:
        rest = expected - copies
        total = rest.sum()
        if total > 0:
            copies += rng.multinomial(remaining, rest / total)
        else:
            copies[np.argmax(expected)] += remaining
    return np.repeat(np.arange(len(copies)), copies.astype(np.intp))


def multinomial(weights: FloatArray, count: int, rng: np.random.Generator) -> Indices:
    """
    Resample independently; the number of copies is multinomial.

    Parameters, result and errors are those of `systematic`.
    """
    copies = rng.multinomial(count, _checked(weights, count))
    return np.repeat(np.arange(len(copies)), copies)


RESAMPLERS: dict[str, Resampler] = {
    'systematic': systematic,
    'stratified': stratified,
    'residual': residual,
    'multinomial': multinomial,
}


def resampler(scheme: str) -> Resampler:
    """
    Return a resampling scheme by name.

    Raises
    ------
    ValueError
        If there is none of that name.

    """
    if scheme not in RESAMPLERS:
        raise ValueError(f'unknown resampling scheme {scheme!r}; valid are '
                         + ', '.join(RESAMPLERS))
    return RESAMPLERS[scheme]


def _checked(weights: FloatArray, count: int) -> FloatArray:
    """Return the weights, normalised."""
    checked_count('count', count)
    _check_shape(weights)
    total = weights.sum()
    _check_values(weights, total)
    return weights / total


def _check_shape(weights: FloatArray) -> None:
    if weights.ndim != 1 or not weights.size:
        raise ValueError(f'weights must be a non-empty vector, not of shape {weights.shape}')


def _check_values(weights: FloatArray, total: float) -> None:
    # The negation catches NaN as well.
    if not (weights.min() >= 0 and 0 < total < math.inf):
        raise ValueError('weights must be finite, non-negative and not all zero')


def _cumulated(weights: FloatArray, count: int) -> FloatArray:
    """Return the cumulated weights, scaled so that the last is exactly `count`."""
    checked_count('count', count)
    _check_shape(weights)
    cumulated = weights.cumsum()
    total = float(cumulated[-1])
    _check_values(weights, total)
    cumulated *= count / total
    cumulated[-1] = count
    return cumulated


def _offspring(ends: FloatArray, shift: float = 0.0) -> Indices:
    """Return the indices, given where on the axis of points 0 + u, 1 + u, ... each one ends."""
    ends -= shift
    copies = np.ceil(ends, out=ends).astype(np.intp)
    del ends
    copies[1:] -= copies[:-1].copy()
    return np.repeat(np.arange(len(copies)), copies)
