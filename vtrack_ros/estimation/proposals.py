"""Proposal densities of a particle filter: the transition prior, and Gaussian filters."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
import math

import numpy as np

from vtrack_ros.estimation.kalman import (
    covariance_factors, Gaussian, GaussianFilter, matrix_times)
from vtrack_ros.estimation.model import GaussianNoise, StateSpaceModel
from vtrack_ros.estimation.particles import Belief
from vtrack_ros.frame import Array


@dataclass(frozen=True, eq=False)
class Proposed:
    """
    Samples (N, n) of a proposal, one for each particle, and its log-density (N,) at each.

    The density is None where the proposal is the transition prior itself, so that the two cancel
    in the weight. Covariances (N, n, n) are those of each particle's filter, if they're kept.
    """

    states: Array
    log_density: Array | None = None
    covariances: Array | None = None


class Proposal(ABC):
    """
    A density to draw the next particles from.

    A proposal holds no state: all that it uses is in the belief, so one object may serve several
    filters.
    """

    window: int = 0
    """How many past estimates it uses."""
    keeps_covariances: bool = False
    """Whether each particle carries the covariance of its own Gaussian filter."""

    @abstractmethod
    def propose(self, model: StateSpaceModel, belief: Belief, dt: float, rng: np.random.Generator,
                measurement: Array | None = None, error: GaussianNoise | None = None) -> Proposed:
        """
        Draw one successor for each particle of the belief before the step.

        The measurement, shape (m,), is made at the end of the step, which is `dt` long; `error` is
        given where it differs from the model's.
        """


class PriorProposal(Proposal):
    """The transition prior p(x_k | x_{k-1}): the bootstrap filter, or Condensation."""

    def propose(self, model: StateSpaceModel, belief: Belief, dt: float, rng: np.random.Generator,
                measurement: Array | None = None, error: GaussianNoise | None = None) -> Proposed:
        return Proposed(model.sample_transition(belief.states, dt, rng, belief.time))


class GaussianFilterProposal(Proposal):
    """
    A Gaussian filter for each particle, updated by the measurement [Qi2012, section 2.2].

    Particle i is drawn from the posterior N(x_hat_i, P_i) of its own filter. With
    `KalmanFilter` or `ExtendedKalmanFilter` the particle filter is the KPF or EPF, with
    `SigmaPointFilter` and a rule the UPF, QKPF or P-QKPF. Without a measurement particles come
    from the transition prior.

    Parameters
    ----------
    gaussian_filter : GaussianFilter
        Usually for the model of the particle filter; a filter for another model of the same
        dimensions gives another proposal, which is still correct.
    covariance : {'reset', 'kept'}
        The covariance that the filter of a particle starts a step with. 'reset': zero, for the
        particle's state is known; the proposal then approximates the optimal one,
        p(x_k | x_{k-1}, z_k). 'kept': that of its last posterior [Qi2012, section 2.2 b]; this
        counts the uncertainty of x_{k-1} twice, once in the covariance and once in the spread of
        the particles, and the proposal becomes wider than the optimal one.
    inflation : float
        Multiple of the predicted covariance added to P_i for sampling, zero or more. A filter
        that is too sure of itself (a strongly curved measurement, a noise with heavy tails)
        leaves parts of the posterior without particles; inflation covers them.

    """

    def __init__(self, gaussian_filter: GaussianFilter, covariance: str = 'reset',
                 inflation: float = 0.0) -> None:
        if covariance not in ('reset', 'kept'):
            raise ValueError(f'unknown covariance {covariance!r}; valid are reset, kept')
        if not 0 <= inflation < math.inf:
            raise ValueError(f'inflation must be zero or more, not {inflation!r}')
        self.gaussian_filter = gaussian_filter
        self.keeps_covariances = covariance == 'kept'
        self.inflation = float(inflation)

    def propose(self, model: StateSpaceModel, belief: Belief, dt: float, rng: np.random.Generator,
                measurement: Array | None = None, error: GaussianNoise | None = None) -> Proposed:
        count, dimension = belief.states.shape
        covariances = np.empty((count, dimension, dimension)) if self.keeps_covariances else None
        if measurement is None:
            states = model.sample_transition(belief.states, dt, rng, belief.time)
            if covariances is not None:
                for part in self.gaussian_filter.blocks(count):
                    covariances[part] = self._predicted(belief, part, dt).covariance
            return Proposed(states, None, covariances)
        states = rng.standard_normal((count, dimension))
        log_density = np.einsum('ij,ij->i', states, states)
        log_density += dimension * math.log(2 * math.pi)
        log_density *= -0.5
        for part in self.gaussian_filter.blocks(count):
            predicted = self._predicted(belief, part, dt)
            posterior = self.gaussian_filter.update(
                predicted, measurement, belief.time + dt, error).posterior
            if covariances is not None:
                covariances[part] = posterior.covariance
            spread = posterior.covariance
            if self.inflation:
                spread += self.inflation * predicted.covariance
            factors = covariance_factors(spread)
            log_density[part] -= np.log(np.abs(np.einsum('nii->ni', factors))).sum(axis=1)
            states[part] = matrix_times(factors, states[part])
            states[part] += posterior.mean
        return Proposed(states, log_density, covariances)

    def _predicted(self, belief: Belief, part: slice, dt: float) -> Gaussian:
        """Return the predictions of some of the particles' filters."""
        states = belief.states[part]
        if self.keeps_covariances and belief.covariances is not None:
            prior = Gaussian(states, belief.covariances[part])
            return self.gaussian_filter.predict(prior, dt, belief.time)
        model = self.gaussian_filter.model
        noise = model.process_noise(dt)
        return Gaussian(model.transition(states, dt, belief.time),
                        np.broadcast_to(noise, (len(states), *noise.shape)))
