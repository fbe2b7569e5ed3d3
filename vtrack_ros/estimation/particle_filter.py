"""The particle filter: one loop for any proposal."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.estimation.model import (
    checked_array, checked_count, checked_covariance, GaussianNoise, StateSpaceModel)
from vtrack_ros.estimation.particles import Belief, systematic, Weights
from vtrack_ros.estimation.proposals import PriorProposal, Proposal, Proposed
from vtrack_ros.frame import Array

LogLikelihood: TypeAlias = Callable[[Array], Array]

WEIGHTINGS = ('full', 'simplified')


class ParticleFilter:
    """
    A particle filter with any proposal.

    A step draws particles from the proposal, weights them, estimates, and resamples where the
    effective sample size has fallen below a threshold. PF, GMPF, KPF/EPF, UPF, QKPF and P-QKPF
    differ in the proposal alone.

    The weight of a particle is the previous one times

    - 'full': `p(z|x) p(x|x_prev) / q(x|x_prev, z)` [Zhu2012, eq. 5; Qi2012, section 2.2 d];
    - 'simplified': `p(z|x)` [Zhu2012, section 4, step 3]: right for the prior proposal only; with
      any other, the proposal acts as the prior, and the posterior is that of a target which moves
      as the proposal says. With the grey proposal, the full weight compares a sample with a
      predecessor that it wasn't drawn from, and in many dimensions few particles keep any weight.

    Where no particle explains the measurement (all weights vanish), the measurement is ignored:
    the proposed particles keep the previous weights, which are marked `recovered`, and
    `recoveries` is incremented.

    The proposal is the transition prior by default; the threshold is a fraction of N, from 0 to 1.
    All randomness comes from `rng`. TypeError or ValueError if one of them is wrong.
    """

    def __init__(self, model: StateSpaceModel, proposal: Proposal | None = None, *,
                 particles: int = 100, threshold: float = 0.5, weighting: str = 'full',
                 rng: np.random.Generator) -> None:
        self.model = model
        self.proposal = proposal if proposal is not None else PriorProposal()
        if not isinstance(self.proposal, Proposal):
            raise TypeError(f'proposal must be a Proposal, not {proposal!r}')
        if not isinstance(rng, np.random.Generator):
            raise TypeError(f'rng must be a numpy.random.Generator, not {rng!r}')
        self.particles = checked_count('particles', particles)
        if weighting not in WEIGHTINGS:
            raise ValueError(f'unknown weighting {weighting!r}; valid are {", ".join(WEIGHTINGS)}')
        if not 0 <= threshold <= 1:
            raise ValueError(f'threshold must be from 0 to 1, not {threshold!r}')
        self.threshold = float(threshold)
        self.weighting = weighting
        self.recoveries = 0
        self._rng = rng
        self._belief: Belief | None = None

    @property
    def belief(self) -> Belief:
        """Return the belief the next step starts from; may be set. ValueError before the start."""
        if self._belief is None:
            raise ValueError('the filter has no belief yet: call start() or set_particles()')
        return self._belief

    @belief.setter
    def belief(self, belief: Belief) -> None:
        self._checked_states(belief.states)
        self._belief = belief

    def start(self, mean: ArrayLike, covariance: ArrayLike, time: float = 0.0) -> Belief:
        """
        Begin, or begin again, with particles from a Gaussian.

        ValueError unless the mean has the shape (n,), and the covariance, shape (n, n), is
        symmetric and positive definite.
        """
        dimension = self.model.state_dimension
        mean = checked_array('mean', mean, (dimension,))
        covariance = checked_covariance('covariance', covariance, dimension)
        states = GaussianNoise.from_covariance(covariance).sample(self.particles, self._rng)
        states += mean
        self._belief = Belief(
            states, Weights.uniform(self.particles), time, self._copies(covariance),
            *self._remembered((), (), mean, time))
        return self._belief

    def resume(self, belief: Belief) -> None:
        """Continue from another filter's belief; it's resampled if its size isn't this one's."""
        count, self.belief = self.particles, belief
        if len(belief) != count:
            picked = self._rng.choice(len(belief), count, p=belief.weights.values)
            self.set_particles(belief.states[picked])

    def set_particles(self, states: ArrayLike, log_weights: Array | None = None) -> Belief:
        """
        Replace the particles by the caller's; time and past estimates are kept.

        The N of states (N, n) may differ from before; log-weights (N,) need not be normalised. If
        the proposal keeps a covariance for each particle, all become that of the new set.
        """
        states = self._checked_states(states)
        weights = (Weights.uniform(len(states)) if log_weights is None
                   else Weights.from_log(log_weights))
        belief, old = Belief(states, weights), self._belief
        self.particles = len(states)
        time = old.time if old is not None else 0.0
        memory = ((old.estimates, old.estimate_times) if old is not None
                  else self._remembered((), (), belief.mean, time))
        self._belief = Belief(states, weights, time, self._copies(belief.covariance), *memory)
        return self._belief

    def correct_estimate(self, estimate: ArrayLike) -> None:
        """Replace the latest estimate, shape (n,), that a forecast uses; the particles stay."""
        latest = checked_array('estimate', estimate, (self.model.state_dimension,))
        belief = self.belief
        if belief.estimates:
            self._belief = replace(belief, estimates=(*belief.estimates[:-1], latest))

    def step(self, measurement: ArrayLike | None = None, dt: float = 1.0,
             log_likelihood: LogLikelihood | None = None,
             error: GaussianNoise | None = None) -> Belief:
        """
        Advance by `dt`: propose, weight, estimate, resample.

        Returns the belief before resampling: take estimates from this one.

        A measurement, shape (m,), steers proposals that use it, which otherwise fall back to
        prediction. It weights the particles too, by the model, unless `log_likelihood` does, which
        takes states (N, n) and returns log p(z | x), shape (N,); without either the step is a pure
        prediction. `error` is the measurement's error where it differs from the model's.
        """
        proposed = self.propose(measurement, dt, error)
        if log_likelihood is not None:
            values = log_likelihood(proposed.states)
        elif measurement is not None:
            values = self.model.log_likelihood(
                proposed.states, np.asarray(measurement, dtype=np.float64),
                self.belief.time + dt, error)
        else:
            values = None
        return self.weight(proposed, values, dt)

    def propose(self, measurement: ArrayLike | None = None, dt: float = 1.0,
                error: GaussianNoise | None = None) -> Proposed:
        """Draw the next particles, as `step` does, without changing the filter: see `weight`."""
        if not dt > 0:
            raise ValueError(f'dt must be positive, not {dt!r}')
        if measurement is not None:
            measurement = checked_array(
                'measurement', measurement, (self.model.measurement_dimension,))
        return self.proposal.propose(self.model, self.belief, dt, self._rng, measurement, error)

    def weight(self, proposed: Proposed, log_likelihood: Array | None, dt: float = 1.0) -> Belief:
        """
        Weight proposed particles and make them the filter's; return the unresampled belief.

        They are from `propose`, with the same `dt`; the log-likelihood, shape (N,), is None where
        nothing was measured.
        """
        belief = self.belief
        log_weights = self._log_weights(proposed, belief, dt)
        if log_likelihood is not None:
            if np.shape(log_likelihood) != log_weights.shape:
                raise ValueError(f'log_likelihood must have the shape {log_weights.shape}, '
                                 f'not {np.shape(log_likelihood)}')
            log_weights = log_weights + log_likelihood
        weights = Weights.from_log(log_weights, fallback=belief.weights)
        del log_weights
        self.recoveries += weights.recovered
        time = belief.time + dt
        mean = weights.values @ proposed.states
        memory = self._remembered(belief.estimates, belief.estimate_times, mean, time)
        posterior = Belief(proposed.states, weights, time, proposed.covariances, *memory)
        resample = weights.effective_sample_size < self.threshold * len(weights)
        self._belief = self._resampled(posterior) if resample else posterior
        return posterior

    def _log_weights(self, proposed: Proposed, belief: Belief, dt: float) -> Array:
        """Return the log-weights without the likelihood, shape (N,)."""
        previous = belief.weights.logarithms
        if proposed.log_density is None or self.weighting == 'simplified':
            return previous
        ratio = self.model.log_transition(proposed.states, belief.states, dt, belief.time)
        ratio -= proposed.log_density
        ratio += previous
        return ratio

    def _resampled(self, belief: Belief) -> Belief:
        indices = systematic(belief.weights.values, self.particles, self._rng)
        covariances = belief.covariances
        return replace(
            belief, states=belief.states[indices], weights=Weights.uniform(self.particles),
            covariances=None if covariances is None else covariances[indices])

    def _copies(self, covariance: Array) -> Array | None:
        """Return a copy of the covariance for each particle, where the proposal keeps them."""
        if not self.proposal.keeps_covariances:
            return None
        return np.tile(covariance, (self.particles, 1, 1))

    def _remembered(self, estimates: tuple[Array, ...], times: tuple[float, ...], mean: Array,
                    time: float) -> tuple[tuple[Array, ...], tuple[float, ...]]:
        """Return the past estimates and the new one, the latest as many as the proposal uses."""
        window = self.proposal.window
        if not window:
            return (), ()
        return (*estimates, mean)[-window:], (*times, time)[-window:]

    def _checked_states(self, states: ArrayLike) -> Array:
        """Return states of the model's dimension, at least one."""
        checked = checked_array('states', states, (None, self.model.state_dimension))
        if not len(checked):
            raise ValueError('states must hold at least one state')
        return checked
