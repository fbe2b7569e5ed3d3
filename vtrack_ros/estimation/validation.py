"""Checks of what callers hand in: a clear error that names the argument, never a NaN later."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]


def checked_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """
    Return `value` as an array of finite floats of a given shape; None stands for any length.

    Raises
    ------
    ValueError
        If the shape differs, or a value isn't finite.

    """
    array = np.asarray(value, dtype=np.float64)
    fits = array.shape == shape or array.ndim == len(shape) and all(
        wanted is None or length == wanted for length, wanted in zip(array.shape, shape))
    if not fits:
        wanted_shape = ', '.join('any' if length is None else str(length) for length in shape)
        raise ValueError(f'{name} must have the shape ({wanted_shape}), not {array.shape}')
    if not np.isfinite(array).all():
        raise ValueError(f'{name} must be finite')
    return array


def checked_states(name: str, value: ArrayLike, dimension: int) -> FloatArray:
    """
    Return `value` as an array of states, shape (N, dimension), N >= 1.

    Raises
    ------
    ValueError
        If the shape differs, there is no state, or a value isn't finite.

    """
    states = checked_array(name, value, (None, dimension))
    if not len(states):
        raise ValueError(f'{name} must hold at least one state')
    return states


def checked_covariance(name: str, value: ArrayLike, dimension: int) -> FloatArray:
    """
    Return `value` as a symmetric positive definite matrix, shape (dimension, dimension).

    Raises
    ------
    ValueError
        If the shape differs, a value isn't finite, or it isn't symmetric positive definite.

    """
    matrix = checked_array(name, value, (dimension, dimension))
    scale = np.abs(matrix).max(initial=0.0)
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-9 * scale):
        raise ValueError(f'{name} must be symmetric')
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        raise ValueError(f'{name} must be positive definite') from None
    return (matrix + matrix.T) / 2


def checked_count(name: str, value: int, least: int = 1) -> int:
    """
    Return `value` as an int that is `least` or more.

    Raises
    ------
    ValueError
        If it isn't a whole number or too small.

    """
    try:
        number = int(value)
    except (TypeError, ValueError, OverflowError):
        number = least - 1
    if isinstance(value, bool) or number != value or number < least:
        raise ValueError(f'{name} must be a whole number of at least {least}, not {value!r}')
    return number


def checked_positive(name: str, value: float) -> float:
    """
    Return `value` as a finite float greater than zero.

    Raises
    ------
    ValueError
        If it isn't.

    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = -1.0
    if not 0 < number < np.inf:
        raise ValueError(f'{name} must be positive and finite, not {value!r}')
    return number
