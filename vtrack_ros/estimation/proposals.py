"""Proposals: where a particle filter looks for the next state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np

from vtrack_ros.estimation.belief import Belief, spread_about
from vtrack_ros.estimation.gaussian import GaussianNoise
from vtrack_ros.estimation.grey import series_forecast, SHORTEST_SERIES
from vtrack_ros.estimation.model import StateSpaceModel
from vtrack_ros.estimation.validation import checked_count, checked_positive, FloatArray

SPREADS = ('forecast', 'predicted', 'moved')


@dataclass(frozen=True, eq=False)
class Proposed:
    """
    Samples of a proposal, one for each particle.

    Parameters
    ----------
    states : ndarray, shape (N, n)
    log_density : ndarray, shape (N,), optional
        The proposal's log-density at each sample; None where the proposal is the transition
        prior itself, so that the two cancel in the weight.
    covariances : ndarray, shape (N, n, n), optional
        Of each particle's own Gaussian filter, to be kept for the next step.

    """

    states: FloatArray
    log_density: FloatArray | None = None
    covariances: FloatArray | None = None


class Proposal(ABC):
    """
    A density to draw the next particles from.

    A proposal holds no state: all that it looks at is in the belief, so one object may serve
    several filters.
    """

    window: int = 0
    """How many past estimates it looks at."""
    keeps_covariances: bool = False
    """Whether each particle carries the covariance of its own Gaussian filter."""

    @abstractmethod
    def propose(
            self, model: StateSpaceModel, belief: Belief, dt: float, rng: np.random.Generator,
            measurement: FloatArray | None = None,
            error: GaussianNoise | None = None) -> Proposed:
        """
        Draw one successor for each particle.

        Parameters
        ----------
        model : StateSpaceModel
            Of the state's motion and measurement.
        belief : Belief
            Of before the step.
        dt : float
            The length of the step.
        rng : numpy.random.Generator
            Where randomness comes from.
        measurement : ndarray, shape (m,), optional
            At the end of the step; None where there is none.
        error : GaussianNoise, optional
            The measurement's error, where it differs from the model's.

        """


class PriorProposal(Proposal):
    """The transition prior p(x_k | x_{k-1}): the bootstrap filter, or Condensation."""

    def propose(
            self, model: StateSpaceModel, belief: Belief, dt: float, rng: np.random.Generator,
            measurement: FloatArray | None = None,
            error: GaussianNoise | None = None) -> Proposed:
        """Draw one successor for each particle from the model's transition."""
        return Proposed(model.sample_transition(belief.states, dt, rng, belief.time))


class GreyProposal(Proposal):
    """
    The grey proposal N(g_k, P_k) about a GM(1,1) forecast [Zhu2012, eqs 16-18].

    g_k is the forecast of the last `window` estimates; until there are as many, particles come
    from the transition prior. P_k is the spread of the previous particles about g_k (eq. 17).
    As printed, nothing keeps P_k up once resampling has collapsed the particles: `floor` times
    the process noise is added.

    Parameters
    ----------
    window : int
        m, at least 4; the paper uses 5 and finds 4 to 6 good and 10 useless [Zhu2012, table 3].
    floor : float
        How much of the process noise is added to P_k, positive.
    margin : float or None
        That of `equivariant_forecast`; None takes the paper's formula, `gm11_forecast`, whose
        forecast depends on where in the image the target is.
    spread : {'forecast', 'predicted', 'moved'}
        What P_k is the spread of: of the previous particles about the forecast (the paper), which
        also holds the square of the forecast motion, so that the particles of a fast target
        spread along its path; or of the particles moved on by the transition about their mean, so
        that uncertain velocities widen it. 'moved' takes these particles themselves, moved so
        that their mean is the forecast: mean and covariance are the same, but modes stay modes,
        each particle has its predecessor, and nothing is factorised.
    prior_share : float
        The fraction of particles that the transition prior draws, in [0, 1); the proposal is then
        the mixture of both densities. The paper has none. The forecast of a component that is
        not measured feeds on itself, and a few steps of wrong forecasts can carry all particles
        away from what the model allows; with a share s of prior particles the weight
        `prior / proposal` is at most 1/s, and the filter comes back.
    densities : bool
        Whether the samples' densities are computed. Only the simplified weight does without; a
        filter that needs them would take the samples for the transition prior's.
    velocities : mapping of int to int, optional
        Which component is the derivative of which, e.g. `{2: 0, 3: 1}`: it is then forecast as
        the forecast change of that component over dt, in place of a series of its own.
    steady : sequence of int, optional
        Components that are expected to stay what they were last: of a series of small random
        changes, a forecast is the noise, extrapolated.

    Raises
    ------
    ValueError
        If an argument is out of range.

    """

    def __init__(
            self, window: int = 5, floor: float = 1.0, margin: float | None = 10.0,
            spread: str = 'forecast', prior_share: float = 0.0,
            densities: bool = True, velocities: Mapping[int, int] | None = None,
            steady: Sequence[int] = ()) -> None:
        self.window = checked_count('window', window, least=SHORTEST_SERIES)
        self.floor = checked_positive('floor', floor)
        self.margin = None if margin is None else checked_positive('margin', margin)
        if spread not in SPREADS:
            raise ValueError(f'unknown spread {spread!r}; valid are ' + ', '.join(SPREADS))
        self.spread = spread
        if not 0 <= prior_share < 1:
            raise ValueError(f'prior_share must be in [0, 1), not {prior_share!r}')
        self.prior_share = float(prior_share)
        self.densities = densities
        self.velocities = dict(velocities or {})
        self.steady = list(steady)

    def propose(
            self, model: StateSpaceModel, belief: Belief, dt: float, rng: np.random.Generator,
            measurement: FloatArray | None = None,
            error: GaussianNoise | None = None) -> Proposed:
        """Draw successors about g_k, and the prior's share from the transition."""
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

    def forecast(self, belief: Belief, dt: float) -> FloatArray | None:
        """
        Return g_k, shape (n,), or None while there are too few estimates.

        GM(1,1) takes a series for evenly spaced: where frames were dropped, estimates are
        interpolated to even times, and a step of another length is that many steps.
        """
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
            latest[i] if i in known else series_forecast(series, steps, self.margin)
            for i, series in enumerate(zip(*rows))]
        for velocity, position in self.velocities.items():
            forecast[velocity] = (forecast[position] - latest[position]) / dt
        return np.array(forecast)

    def _scatter(
            self, model: StateSpaceModel, belief: Belief, forecast: FloatArray,
            predicted: FloatArray, dt: float) -> GaussianNoise | None:
        """Return what is drawn about the centre, or None where numbers left the floats' range."""
        if not math.isfinite(forecast.sum()):
            return None
        noise = model.process_error(dt)
        if self.spread == 'moved':
            return noise if self.floor == 1 else GaussianNoise(
                self.floor * noise.covariance, math.sqrt(self.floor) * noise.factor)
        weights = belief.weights.values
        covariance = (belief.spread_about(forecast) if self.spread == 'forecast'
                      else spread_about(weights @ predicted, predicted, weights))
        covariance += self.floor * noise.covariance
        try:
            return GaussianNoise.from_covariance(covariance)
        except ValueError:
            return None
