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

from collections.abc import Sequence
import math

import numpy as np

from vtrack_ros.estimation.validation import FloatArray

SHORTEST_SERIES = 4
#: Exponent that isn't exceeded: the forecast of a distant future stays finite.
_LARGEST = 600.0


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
    columns = _checked(series).T.tolist()
    return np.array([series_forecast(column, steps) for column in columns])


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
    columns = _checked(series).T.tolist()
    if not margin > 0:
        raise ValueError(f'margin must be positive, not {margin!r}')
    return np.array([series_forecast(column, steps, margin) for column in columns])


def _checked(series: FloatArray) -> FloatArray:
    series = np.asarray(series, dtype=np.float64)
    if series.ndim != 2 or len(series) < SHORTEST_SERIES:
        raise ValueError(f'series must have the shape (m, n) with m >= {SHORTEST_SERIES}, '
                         f'not {series.shape}')
    if not np.isfinite(series).all():
        raise ValueError('series must be finite')
    return series


def series_forecast(
        series: Sequence[float], steps: float = 1.0, margin: float | None = None) -> float:
    """
    Forecast one series, as `gm11_forecast` or, with a margin, as `equivariant_forecast`.

    A series is so short that plain numbers are several times as quick as arrays. Nothing is
    checked.
    """
    lowest = min(series)
    span = max(series) - lowest or 1.0
    if margin is not None:
        shift, unit = margin * span - lowest, span
    else:
        shift = 0.0 if lowest > 0 else span - lowest
        unit = sum(series) / len(series) + shift
    # in units of the series: neither tiny nor huge values lose digits in the accumulation
    return unit * _forecast([(value + shift) / unit for value in series], steps) - shift


def _forecast(series: list[float], steps: float) -> float:
    """Forecast a positive series of moderate values [Zhu2012, eqs 9-16]."""
    first, *later = series
    total, background = first, []
    for value in later:
        background.append(total + value / 2)
        total += value
    centre = sum(background) / len(later)
    variance = covariance = 0.0
    for value, accumulated in zip(later, background):
        deviation = accumulated - centre
        variance += deviation * deviation
        covariance += deviation * value
    # all of the series may lie in its first value, to machine precision: it has no slope then
    a = min(max(-covariance / variance, -2.0), 2.0) if variance else 0.0
    b = (total - first) / len(later) + a * centre
    ratio = math.expm1(a) / a if a else 1.0
    return (b - a * first) * math.exp(min(-a * (len(later) + steps), _LARGEST)) * ratio
