"""
The grey model GM(1,1), and the proposal of a particle filter about its forecast.

GM(1,1) forecasts from four to six values [Zhu2012, section 3.2]: the accumulated series
`x1 = cumsum(x0)` is taken for the response of a first-order system, with
`z(j) = (x1(j) + x1(j-1)) / 2` and the least squares of `x0(j) = -a z(j) + b`, j = 2..m.

Two misprints of the paper are corrected: the left-hand side is the original series x0(2..m), as
eq. 12 needs it, where eq. 14 prints the accumulated one; and the time in eq. 16 counts from the
start of the window (m), where the print has the frame number k: with that the forecast grows or
decays exponentially as time goes by.
"""

from collections.abc import Mapping, Sequence
import math

import numpy as np

from vtrack_ros.estimation.model import (
    checked_array, checked_count, checked_positive, GaussianNoise, StateSpaceModel)
from vtrack_ros.estimation.particles import Belief, spread_about
from vtrack_ros.estimation.proposals import Proposal, Proposed
from vtrack_ros.frame import Array

SHORTEST_SERIES = 4
SPREADS = ('forecast', 'predicted', 'moved')
#: Upper bound of the exponent, so that a forecast far ahead stays finite.
_LARGEST = 600.0


def gm11_forecast(series: Array, steps: float = 1.0, margin: float | None = None) -> Array:
    """
    Forecast each column of a series by GM(1,1) [Zhu2012, eqs 9-16].

    The forecast is `(x0(1) - b/a) exp(-a m) (1 - exp(a))`; it is computed as
    `(b - a x0(1)) exp(-a m) * expm1(a)/a`, which has the limit b for a -> 0.

    GM(1,1) needs a positive series. Without a margin, a column that isn't positive is shifted up
    until its smallest value equals its range, and the forecast is shifted back; a positive column
    is left alone, so for it this is exactly the paper's formula. Each ratio
    `(x0(j+1) - x0(j)) / (z(j+1) - z(j))` lies between -2 and 2 then, hence `|a| <= 2`, and the
    exponential can't overflow.

    The paper's formula isn't shift-invariant. With a margin every column is shifted so that its
    smallest value is `margin` times its range, and the forecast moves and scales with the series:
    a target at the left edge of an image is forecast like one at the right edge, and a velocity
    may change its sign. The price is curvature: with a shift c, a series of slope s is fitted by
    an exponential that departs from the line by O(s^2 / c), so the larger the margin, the closer
    the forecast comes to the least-squares line through the last m - 1 values. A small margin
    also makes the forecast depend on the direction (upward motion accelerates, downward motion
    brakes).

    The series, shape (m, n), is evenly spaced in time, oldest first; ValueError unless it's
    finite and m >= 4. The forecast, shape (n,), is `steps` spacings ahead, one in the paper.
    """
    series = checked_array('series', series, (None, None))
    if len(series) < SHORTEST_SERIES:
        raise ValueError(f'series must hold {SHORTEST_SERIES} values or more, not {len(series)}')
    if margin is not None:
        checked_positive('margin', margin)
    return np.array([_column_forecast(column, steps, margin) for column in series.T.tolist()])


def _column_forecast(series: Sequence[float], steps: float, margin: float | None) -> float:
    """Forecast one column; for such a short series plain floats are several times as fast."""
    lowest = min(series)
    span = max(series) - lowest or 1.0
    if margin is not None:
        shift, unit = margin * span - lowest, span
    else:
        shift = 0.0 if lowest > 0 else span - lowest
        unit = sum(series) / len(series) + shift
    # in units of the series: neither tiny nor huge values lose digits in the accumulation
    first, *later = [(value + shift) / unit for value in series]
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
    # no slope can be fitted if the others vanish beside the first value, to machine precision
    a = min(max(-covariance / variance, -2.0), 2.0) if variance else 0.0
    b = (total - first) / len(later) + a * centre
    ratio = math.expm1(a) / a if a else 1.0
    growth = math.exp(min(-a * (len(later) + steps), _LARGEST))
    return unit * ((b - a * first) * growth * ratio) - shift


class GreyProposal(Proposal):
    """
    The grey proposal N(g_k, P_k) about a GM(1,1) forecast [Zhu2012, eqs 16-18].

    g_k is the forecast of the last `window` estimates; until there are as many, particles come
    from the transition prior. P_k is the spread of the previous particles about g_k (eq. 17).
    As printed, nothing keeps P_k from shrinking once resampling has collapsed the particles:
    `floor` times the process noise is added.

    Parameters
    ----------
    window : int
        m, at least 4; the paper finds 4 to 6 good and 10 useless [Zhu2012, table 3].
    floor : float
        How much of the process noise is added to P_k, zero (the paper) or more. Where P_k isn't
        positive definite without it, the particles come from the transition prior.
    margin : float or None
        That of `gm11_forecast`; None takes the paper's formula, whose forecast depends on where
        in the image the target is.
    spread : {'forecast', 'predicted', 'moved'}
        What P_k is the spread of: of the previous particles about the forecast (the paper), which
        also holds the square of the forecast motion, so that the particles of a fast target
        spread along its path; or of the particles moved on by the transition about their mean, so
        that uncertain velocities widen it. 'moved' takes these particles themselves, shifted so
        that their mean is the forecast: mean and covariance are the same, but several modes are
        kept, each particle has its predecessor, and no matrix is factorised; it needs a floor.
    prior_share : float
        The fraction of particles that the transition prior draws, in [0, 1); the proposal is then
        the mixture of both densities. The paper has none. The forecast of a component that is
        not measured is computed from earlier forecasts, and a few wrong ones in a row can carry
        all particles away from what the model allows; with a share s of prior particles the weight
        `prior / proposal` is at most 1/s, and the filter recovers.
    densities : bool
        Whether the samples' densities are computed. Only 'simplified' weights need none; a filter
        with 'full' weights would treat the samples as drawn from the transition prior.
    velocities : mapping of int to int, optional
        Which component is the derivative of which, e.g. `{2: 0, 3: 1}`: it is then forecast as
        the forecast change of that component over dt, in place of a series of its own.
    steady : sequence of int, optional
        Components whose forecast is their latest value: GM(1,1) would only extrapolate the noise
        of a series of small random changes.

    """

    def __init__(self, window: int = 5, floor: float = 1.0, margin: float | None = 10.0,
                 spread: str = 'forecast', prior_share: float = 0.0, densities: bool = True,
                 velocities: Mapping[int, int] | None = None, steady: Sequence[int] = ()) -> None:
        self.window = checked_count('window', window, least=SHORTEST_SERIES)
        if spread not in SPREADS:
            raise ValueError(f'unknown spread {spread!r}; valid are ' + ', '.join(SPREADS))
        self.spread = spread
        if not 0 <= floor < math.inf or spread == 'moved' and not floor:
            raise ValueError(f'floor must be zero or more, and positive if moved, not {floor!r}')
        self.floor = float(floor)
        self.margin = None if margin is None else checked_positive('margin', margin)
        if not 0 <= prior_share < 1:
            raise ValueError(f'prior_share must be in [0, 1), not {prior_share!r}')
        self.prior_share = float(prior_share)
        self.densities = densities
        self.velocities = dict(velocities or {})
        self.steady = list(steady)
        #: Cache: (belief, dt, forecast). A caller may ask for the forecast before proposing.
        self._made: tuple[Belief, float, Array | None] | None = None

    def propose(self, model: StateSpaceModel, belief: Belief, dt: float, rng: np.random.Generator,
                measurement: Array | None = None, error: GaussianNoise | None = None) -> Proposed:
        """Draw successors about g_k, and `prior_share` of them from the transition prior."""
        forecast = self.forecast(belief, dt)
        predicted = model.transition(belief.states, dt, belief.time)
        scatter = None if forecast is None else self._scatter(
            model, belief, forecast, predicted, dt)
        if forecast is None or scatter is None:
            predicted += model.sample_noise(len(belief), dt, rng)
            return Proposed(predicted)
        centre = forecast
        if self.spread == 'moved':
            centre = predicted + (forecast - belief.weights.values @ predicted)
        states = scatter.sample(len(predicted), rng)
        states += centre
        if self.prior_share:
            chosen, = (rng.random(len(states)) < self.prior_share).nonzero()
            states[chosen] = predicted[chosen] + model.sample_noise(len(chosen), dt, rng)
        if not self.densities:
            return Proposed(states)
        log_density = scatter.log_density(states - centre)
        if self.prior_share:
            prior = model.log_noise_density(states - predicted, dt)
            log_density = np.logaddexp(prior + math.log(self.prior_share),
                                       log_density + math.log1p(-self.prior_share))
        return Proposed(states, log_density)

    def forecast(self, belief: Belief, dt: float) -> Array | None:
        """
        Return g_k, shape (n,), or None while there are too few estimates.

        GM(1,1) takes a series for evenly spaced: where frames were dropped, estimates are
        interpolated to even times, and a step of another length is that many steps.
        """
        made = self._made
        if made is None or made[0] is not belief or made[1] != dt:
            made = self._made = belief, dt, self._forecast(belief, dt)
        return made[2]

    def _forecast(self, belief: Belief, dt: float) -> Array | None:
        if len(belief.estimates) < self.window:
            return None
        rows = [estimate.tolist() for estimate in belief.estimates[-self.window:]]
        times = belief.estimate_times[-self.window:]
        latest = rows[-1]
        spacing = (times[-1] - times[0]) / (self.window - 1)
        steps = dt / spacing if spacing > 0 else 1.0
        gaps = [later - earlier for earlier, later in zip(times, times[1:])]
        if max(gaps) - min(gaps) > 1e-6 * spacing:
            even = np.linspace(times[0], times[-1], self.window)
            rows = np.stack([np.interp(even, times, series) for series in zip(*rows)], 1).tolist()
        known = (*self.velocities, *self.steady)
        forecast = [
            latest[i] if i in known else _column_forecast(series, steps, self.margin)
            for i, series in enumerate(zip(*rows))]
        for velocity, position in self.velocities.items():
            forecast[velocity] = (forecast[position] - latest[position]) / dt
        return np.array(forecast)

    def _scatter(self, model: StateSpaceModel, belief: Belief, forecast: Array, predicted: Array,
                 dt: float) -> GaussianNoise | None:
        """Return the noise about the centre; None where it isn't finite and positive definite."""
        if not math.isfinite(forecast.sum()):
            return None
        noise = model.process_error(dt)
        if self.spread == 'moved':
            return noise if self.floor == 1 else GaussianNoise(
                self.floor * noise.covariance, math.sqrt(self.floor) * noise.factor)
        weights, states, about = belief.weights.values, belief.states, forecast
        if self.spread == 'predicted':
            states, about = predicted, weights @ predicted
        with np.errstate(over='ignore', invalid='ignore'):
            spread = spread_about(about, states, weights)
        try:
            return GaussianNoise.from_covariance(spread + self.floor * noise.covariance)
        except ValueError:
            return None
