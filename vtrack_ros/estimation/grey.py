"""
The grey model GM(1,1): a forecast from four to six values [Zhu2012, section 3.2].

The accumulated series `x1 = cumsum(x0)` is taken for the response of a first-order system, with
`z(j) = (x1(j) + x1(j-1)) / 2` and the least squares of `x0(j) = -a z(j) + b`, j = 2..m.

Two misprints of the paper are mended: the left-hand side is the original series x0(2..m), as eq.
12 needs it, where eq. 14 prints the accumulated one; and the time in eq. 16 counts from the start
of the window (m), where the print has the frame number k: with that the forecast explodes or dies
as time goes by.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from vtrack_ros.estimation.validation import FloatArray

SHORTEST_SERIES = 4
_TINY = float(np.finfo(np.float64).tiny)


def gm11_forecast(series: FloatArray, steps: float = 1.0) -> FloatArray:
    """
    Forecast each column of a series by GM(1,1) [Zhu2012, eqs 9-16].

    The forecast is `(x0(1) - b/a) exp(-a m) (1 - exp(a))`; it is computed as
    `(b - a x0(1)) exp(-a m) * expm1(a)/a`, which has the limit b for a -> 0.

    GM(1,1) needs a positive series. A column that isn't positive is first shifted up until its
    smallest value equals its range, and the forecast is shifted back; positive columns are left
    alone, so for them this is the paper's formula and nothing else. For a positive series each
    ratio `(x0(j+1) - x0(j)) / (z(j+1) - z(j))` lies between -2 and 2, hence `|a| <= 2`, and the
    exponential can't overflow.

    The model isn't shift-invariant: where positions have no natural zero, use
    `equivariant_forecast`.

    Parameters
    ----------
    series : ndarray, shape (m, n)
        Evenly spaced in time, oldest first; m >= 4.
    steps : float
        How far ahead, in spacings of the series; the paper's forecast is one step.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    ValueError
        If the series is shorter than four, not two-dimensional or not finite.

    """
    series = _checked(series)
    lowest = series.min(axis=0)
    shift = np.where(lowest > 0, 0.0, _span(series, lowest) - lowest)
    shifted = series + shift
    mean = shifted.mean(axis=0)
    return _forecast(shifted / mean, steps) * mean - shift


def equivariant_forecast(
        series: FloatArray, steps: float = 1.0, margin: float = 10.0) -> FloatArray:
    """
    Forecast each column by GM(1,1) on a series moved to a fixed distance from zero.

    Each column is shifted so that its smallest value is `margin` times its range. The forecast
    then moves and scales with the series: a target at the left edge of an image is forecast like
    one at the right edge, and a velocity may change its sign. The price is curvature: with a
    shift c, a series of slope s is fitted by an exponential that departs from the line by
    O(s^2 / c), so the larger the margin, the closer the forecast comes to the least-squares line
    through the last m - 1 values. A small margin also makes the forecast depend on the direction
    (upward motion accelerates, downward motion brakes).

    Parameters
    ----------
    series : ndarray, shape (m, n)
        Evenly spaced in time, oldest first; m >= 4.
    steps : float
        How far ahead, in spacings of the series.
    margin : float
        Smallest value over range, after the shift; positive.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    ValueError
        If the series is shorter than four, not two-dimensional or not finite, or the margin
        isn't positive.

    """
    series = _checked(series)
    if not margin > 0:
        raise ValueError(f'margin must be positive, not {margin!r}')
    lowest = series.min(axis=0)
    span = _span(series, lowest)
    # In units of the range: neither tiny nor huge values lose digits in the accumulation.
    forecast = _forecast((series - lowest) / span + margin, steps)
    return lowest + span * (forecast - margin)


def _checked(series: FloatArray) -> FloatArray:
    series = np.asarray(series, dtype=np.float64)
    if series.ndim != 2 or len(series) < SHORTEST_SERIES:
        raise ValueError(f'series must have the shape (m, n) with m >= {SHORTEST_SERIES}, '
                         f'not {series.shape}')
    if not np.isfinite(series).all():
        raise ValueError('series must be finite')
    return series


def _span(series: FloatArray, lowest: FloatArray) -> FloatArray:
    """Return the range of each column; one where the column is constant."""
    span: FloatArray = series.max(axis=0) - lowest
    span[span == 0] = 1.0
    return span


def _forecast(series: FloatArray, steps: float) -> FloatArray:
    """Forecast a positive series of moderate values, shape (m, n)."""
    sums = _background(len(series)) @ series
    background, centre, level = sums[:-2], sums[-2], sums[-1]
    # all of the series may lie in its first value, to machine precision: it has no slope then
    variance = np.maximum(np.einsum('ij,ij->j', background, background), _TINY)
    decay = np.einsum('ij,ij->j', background, series[1:])
    decay /= variance
    decay -= _TINY  # where it's zero, expm1(a) / a is one
    a = -decay
    b = level + a * centre
    forecast: FloatArray = (b - a * series[0]) * np.exp((len(series) - 1 + steps) * decay)
    forecast *= np.expm1(a)
    forecast /= a
    return forecast


@lru_cache(maxsize=32)
def _background(length: int) -> FloatArray:
    """
    Return the matrix that makes z(2..m), less their mean, from a series of that length.

    Its last two rows make the means of z(2..m) and of x0(2..m) [Zhu2012, eqs 9-11].
    """
    accumulated = np.tri(length)
    background = (accumulated[1:] + accumulated[:-1]) / 2
    centre = background.mean(axis=0)
    level = np.full(length, 1 / (length - 1))
    level[0] = 0
    return np.vstack([background - centre, centre, level])
