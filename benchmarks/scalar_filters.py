"""
Particle filters on scalar models: the runs of `ung.py`, and their summaries.

The filters are those of the second paper's Table 1 and controls. They run on the same simulated
trajectories, so that differences are paired.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math
import time
from typing import TypeAlias

from nonlinear_models import simulate, VanDerMerweModel
import numpy as np

from vtrack_ros.estimation import (
    ExtendedKalmanFilter, gauss_hermite, GaussianFilterProposal, hermite_nodes, ParticleFilter,
    PriorProposal, Proposal, pruned_gauss_hermite, RuleFactory, SigmaPointFilter, StateSpaceModel,
    unscented)
from vtrack_ros.frame import Array

MakeProposal: TypeAlias = Callable[[StateSpaceModel], Proposal]

STEPS = 60
ORDER = 5


class Demonstration(VanDerMerweModel):
    """
    The model that the filters of van der Merwe's published demonstration assume.

    Their predictions leave out the mean of the Gamma noise, the variances of both noises are
    inflated, the prior's density is taken at x_k - x_{k-1}; and 1e-99 is added to each likelihood.

    Parameters
    ----------
    inflation : float
        Factor on the variance of the process noise.

    """

    FLOOR = 1e-99

    def __init__(self, inflation: float) -> None:
        super().__init__(measurement_variance=0.1)
        self.inflation = inflation

    def transition(self, states: Array, dt: float, time: float = 0.0) -> Array:
        """Return the states without the noise's mean, shape (N, 1)."""
        return super().transition(states, dt, time) - self.shape / self.rate

    def process_noise(self, dt: float) -> Array:
        """Return the inflated variance, shape (1, 1)."""
        return self.inflation * super().process_noise(dt)

    def sample_noise(self, count: int, dt: float, rng: np.random.Generator) -> Array:
        """Draw the noise with its mean, shape (count, 1)."""
        return super().sample_noise(count, dt, rng) + self.shape / self.rate

    def log_transition(
            self, states: Array, previous: Array, dt: float,
            time: float = 0.0) -> Array:
        """Return the Gamma density of the differences, up to a constant, shape (N,)."""
        difference = (states - previous)[:, 0]
        density: Array = (self.shape - 1) * np.log(np.abs(difference)) - self.rate * difference
        return density


class Runs:
    """
    Simulated trajectories, and filters on them.

    Parameters
    ----------
    model : StateSpaceModel
        Scalar.
    start : float
        The state at time zero, which the filters know up to the process noise.
    count : int
        Number of trajectories.
    seed : int
        Trajectory i and the filters on it are seeded by (seed, i).

    """

    def __init__(self, model: StateSpaceModel, start: float, count: int, seed: int) -> None:
        self.model, self.start, self.seed = model, start, seed
        pairs = [simulate(model, [start], STEPS, np.random.default_rng([seed, i]))
                 for i in range(count)]
        self.states: Array = np.array([states[:, 0] for states, _ in pairs])
        self.measurements: Array = np.array([seen for _, seen in pairs])

    def run(
            self, make: MakeProposal, particles: int, believed: StateSpaceModel | None = None,
            floor: float = 0.0) -> tuple[Array, float]:
        """
        Run a filter on every trajectory.

        Parameters
        ----------
        make : callable
            Makes the proposal for a model.
        particles : int
            N.
        believed : StateSpaceModel, optional
            The model that the filter assumes; by default the true one. The likelihood is always
            that of the true model.
        floor : float
            Constant added to each likelihood.

        Returns
        -------
        errors : ndarray, shape (runs, steps)
            Errors of the estimates.
        seconds : float
            Mean processor time of a run.

        """
        errors, seconds = np.empty_like(self.states), 0.0
        believed = believed or self.model
        log_floor = math.log(floor) if floor else -math.inf
        for i, measurements in enumerate(self.measurements):
            particle_filter = ParticleFilter(
                believed, make(believed), particles=particles,
                rng=np.random.default_rng([self.seed, i, 1]))
            particle_filter.start([self.start], self.model.process_noise(1.0))
            began = time.process_time()
            for k, z in enumerate(measurements):
                proposed = particle_filter.propose(z)
                likelihood = self.model.log_likelihood(proposed.states, z, k + 1.0)
                if floor:
                    likelihood = np.logaddexp(likelihood, log_floor)
                step = particle_filter.weight(proposed, likelihood)
                errors[i, k] = step.mean[0] - self.states[i, k]
            seconds += time.process_time() - began
        return errors, seconds / len(errors)


def filters(covariance: str = 'reset') -> dict[str, MakeProposal]:
    """Return the filters by name; `covariance` is that of `GaussianFilterProposal`."""
    def sigma(rule: RuleFactory, inflation: float = 0.0) -> MakeProposal:
        return lambda model: GaussianFilterProposal(
            SigmaPointFilter(model, rule), covariance, inflation)

    hermite = partial(gauss_hermite, order=ORDER)
    # In one dimension the printed threshold prunes nothing. To prune at all, and to regroup, is
    # to discard the outermost pair: the threshold is the second smallest weight.
    outermost = partial(pruned_gauss_hermite, order=ORDER, regroup=True,
                        threshold=float(np.sort(hermite_nodes(ORDER)[1])[2]))
    return {
        'pf': lambda model: PriorProposal(),
        'epf': lambda model: GaussianFilterProposal(ExtendedKalmanFilter(model), covariance),
        'upf': sigma(partial(unscented, kappa=2.0)),
        'qkpf': sigma(hermite),
        'pqkpf': sigma(partial(pruned_gauss_hermite, order=ORDER)),
        'pqkpf_regrouped': sigma(partial(outermost, matched=False)),
        'pqkpf_regrouped_matched': sigma(outermost),
        'qkpf_inflated': sigma(hermite, inflation=0.3),
        'reference': lambda model: PriorProposal(),
    }


def rmse(errors: Array) -> Array:
    """Return the root mean squared error of each run [Qi2012, eq. 25]."""
    return np.sqrt((errors ** 2).mean(axis=1))


def summary(errors: Array, states: Array, seconds: float) -> dict[str, float]:
    """
    Return mean, median and variance of the runs' RMSE, time, and how often the filter is lost.

    A step is in the wrong mode where the estimate is nearer to -x than to x though |x| > 1; a run
    has locked on where five such steps follow one another.
    """
    values = rmse(errors)
    mirrored = (np.abs(errors + 2 * states) < np.abs(errors)) & (np.abs(states) > 1)
    windows = np.lib.stride_tricks.sliding_window_view(mirrored, 5, axis=1)
    return {
        'rmse_mean': float(values.mean()), 'rmse_median': float(np.median(values)),
        'rmse_var': float(values.var(ddof=1)) if len(values) > 1 else 0.0,
        'seconds_per_run': seconds, 'median_absolute_error': float(np.median(np.abs(errors))),
        'wrong_mode_rate': float(mirrored.mean()),
        'lock_on_rate': float(windows.all(axis=2).any(axis=1).mean()),
    }


def paired(values: Array, others: Array) -> dict[str, float]:
    """Return the mean difference over runs, and its 95 % bootstrap interval."""
    difference = values - others
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(difference), size=(4000, len(difference)))
    low, high = np.percentile(difference[drawn].mean(axis=1), [2.5, 97.5])
    return {'mean': float(difference.mean()), 'low': float(low), 'high': float(high)}
