"""Gaussian beliefs, and many Kalman filters side by side: linear or linearised."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.estimation.model import (
    checked_array, checked_covariance, GaussianNoise, LinearModel, StateSpaceModel)
from vtrack_ros.frame import Array

#: Numbers that a block of beliefs may hold: it fits the CPU's cache, and memory is bounded.
_BLOCK = 16384


@dataclass(frozen=True, eq=False)
class Gaussian:
    """N Gaussian beliefs, side by side: means (N, n), symmetric covariances (N, n, n)."""

    mean: Array
    covariance: Array

    def __post_init__(self) -> None:
        """Check the shapes; definiteness is only checked in `from_moments`, not at every step."""
        if self.mean.ndim != 2:
            raise ValueError(f'mean must have the shape (N, n), not {self.mean.shape}')
        wanted = (*self.mean.shape, self.mean.shape[1])
        if self.covariance.shape != wanted:
            raise ValueError(f'covariance must have the shape {wanted}, '
                             f'not {self.covariance.shape}')

    @classmethod
    def from_moments(cls, mean: ArrayLike, covariance: ArrayLike) -> Gaussian:
        """
        Make beliefs of means (n,) or (N, n), and one covariance (n, n) for all or (N, n, n).

        ValueError unless covariances are symmetric and positive definite, and all is finite.
        """
        means = checked_array('mean', np.atleast_2d(mean), (None, None))
        count, dimension = means.shape
        matrices = np.asarray(covariance, dtype=np.float64)
        if matrices.ndim != 3:
            one = checked_covariance('covariance', matrices, dimension)
            return cls(means, np.tile(one, (count, 1, 1)))
        if len(matrices) != count:
            raise ValueError(f'covariance must hold {count} matrices, not {len(matrices)}')
        return cls(means, np.array([
            checked_covariance('covariance', matrix, dimension) for matrix in matrices]))

    def __len__(self) -> int:
        """Return the number of beliefs."""
        return len(self.mean)


@dataclass(frozen=True, eq=False)
class Correction:
    """The beliefs after a measurement, and its log-density under each prediction, shape (N,)."""

    posterior: Gaussian
    log_evidence: Array


class GaussianFilter(ABC):
    """
    A filter whose belief is a Gaussian; it works on N beliefs at once.

    Updates take Joseph's form, a sum of positive semi-definite terms: rounding can't make a
    covariance indefinite. Beliefs are processed in blocks, so that a step needs no more memory
    than its result and one block.
    """

    def __init__(self, model: StateSpaceModel) -> None:
        self.model = model

    def predict(self, prior: Gaussian, dt: float, time: float = 0.0) -> Gaussian:
        """Return the beliefs after a step of `dt`, zero or more, that begins at `time`."""
        self._check(prior)
        if not 0 <= dt < math.inf:
            raise ValueError(f'dt must be zero or more, and finite, not {dt!r}')
        mean, covariance = np.empty_like(prior.mean), np.empty(prior.covariance.shape)
        for part in [slice(None)] if self.model.stacked else self.blocks(len(prior)):
            mean[part], covariance[part] = self._predict(
                prior.mean[part], prior.covariance[part], dt, time)
        return Gaussian(mean, covariance)

    def update(self, prior: Gaussian, measurement: Array, time: float = 0.0,
               error: GaussianNoise | None = None) -> Correction:
        """Return the beliefs after a measurement (m,) at `time`; `error` replaces R if given."""
        self._check(prior)
        dimension = self.model.measurement_dimension
        measurement = checked_array('measurement', measurement, (dimension,))
        error = error or self.model.measurement_error
        if error.covariance.shape != (dimension, dimension):
            raise ValueError(f'error must have a covariance of the shape '
                             f'({dimension}, {dimension}), not {error.covariance.shape}')
        mean, covariance = np.empty_like(prior.mean), np.empty(prior.covariance.shape)
        log_evidence = np.empty(len(prior))
        for part in self.blocks(len(prior)):
            mean[part], covariance[part], log_evidence[part] = self._update(
                prior.mean[part], prior.covariance[part], measurement, time, error)
        return Correction(Gaussian(mean, covariance), log_evidence)

    @abstractmethod
    def _predict(self, mean: Array, covariance: Array, dt: float,
                 time: float) -> tuple[Array, Array]:
        """Return mean and covariance after the step, of one block."""

    @abstractmethod
    def _update(self, mean: Array, covariance: Array, measurement: Array, time: float,
                error: GaussianNoise) -> tuple[Array, Array, Array]:
        """Return mean, covariance and log-evidence after the measurement, of one block."""

    def _floats_per_belief(self) -> int:
        """Return how many numbers one belief needs while it's processed."""
        return max(16, 4 * self.model.state_dimension ** 2)

    def blocks(self, count: int) -> list[slice]:
        """Return slices that divide `count` beliefs into blocks."""
        size = max(1, _BLOCK // self._floats_per_belief())
        return [slice(start, start + size) for start in range(0, count, size)]

    def _check(self, beliefs: Gaussian) -> None:
        dimension = beliefs.mean.shape[1]
        if dimension != self.model.state_dimension:
            raise ValueError(f'beliefs are of dimension {dimension}, '
                             f'the model of {self.model.state_dimension}')

    def _propagate(self, mean: Array, covariance: Array, matrix: Array, dt: float,
                   time: float) -> tuple[Array, Array]:
        """Predict by a transition matrix, shape (n, n) or (N, n, n)."""
        predicted = matrix @ covariance @ matrix.swapaxes(-1, -2)
        predicted += self.model.process_noise(dt)
        return self.model.transition(mean, dt, time), symmetrised(predicted)


class ExtendedKalmanFilter(GaussianFilter):
    """The extended Kalman filter: transition and measurement linearised at the mean."""

    def _predict(self, mean: Array, covariance: Array, dt: float,
                 time: float) -> tuple[Array, Array]:
        matrix = self.model.transition_matrix(dt)
        if matrix is None:
            matrix = self.model.transition_jacobian(mean, dt, time)
        if matrix is None:
            matrix = central_differences(
                lambda states: self.model.transition(states, dt, time), mean)
        return self._propagate(mean, covariance, matrix, dt, time)

    def _update(self, mean: Array, covariance: Array, measurement: Array, time: float,
                error: GaussianNoise) -> tuple[Array, Array, Array]:
        jacobian = self.model.measurement_jacobian(mean, time)
        if jacobian is None:
            jacobian = central_differences(
                lambda states: self.model.measure(states, time), mean, self.model.residual)
        cross = covariance @ jacobian.swapaxes(1, 2)
        innovation_covariance = jacobian @ cross
        innovation_covariance += error.covariance
        residual = self.model.residual(measurement, self.model.measure(mean, time))
        gain, log_evidence = innovate(cross, innovation_covariance, residual)
        keep = np.eye(mean.shape[1]) - gain @ jacobian
        posterior = keep @ covariance @ keep.swapaxes(1, 2)
        posterior += gain @ error.covariance @ gain.swapaxes(1, 2)
        return mean + matrix_times(gain, residual), symmetrised(posterior), log_evidence


class KalmanFilter(ExtendedKalmanFilter):
    """The Kalman filter: exact on a linear model with Gaussian noise."""

    def __init__(self, model: StateSpaceModel) -> None:
        if not isinstance(model, LinearModel):
            raise ValueError(f'model must be a LinearModel, not {type(model).__name__}; '
                             'the other filters accept any model')
        super().__init__(model)


def innovate(cross: Array, innovation_covariance: Array, residual: Array) -> tuple[Array, Array]:
    """
    Return the gains `cross S^-1`, shape (N, n, m), and log-densities of N innovations.

    `cross` is the covariance of state and measurement, S (N, m, m) that of the residuals (N, m).
    """
    dimension = residual.shape[1]
    if dimension == 1:
        variance = innovation_covariance[:, 0]
        distance = residual[:, 0] ** 2 / variance[:, 0]
        gain = cross / variance[:, np.newaxis]
        log_determinant = np.log(variance[:, 0])
    else:
        inverse = np.linalg.inv(innovation_covariance)
        gain = cross @ inverse
        distance = np.einsum('ni,nij,nj->n', residual, inverse, residual)
        log_determinant = np.linalg.slogdet(innovation_covariance)[1]
    log_density: Array = -0.5 * (distance + log_determinant + dimension * math.log(2 * math.pi))
    return gain, log_density


def covariance_factors(covariance: Array) -> Array:
    """
    Return lower triangular L with `L L^T = covariance`, for symmetric matrices (..., n, n).

    Cholesky's factor where it exists. If rounding has left any matrix indefinite, the factors are
    those of the nearest matrices whose eigenvalues are positive.
    """
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariance)
        least = np.finfo(np.float64).eps * np.abs(values).max(axis=-1, keepdims=True)
        root = vectors * np.sqrt(np.maximum(values, least))[..., np.newaxis, :]
        upper = np.linalg.qr(root.swapaxes(-1, -2), mode='r')
        return upper.swapaxes(-1, -2)


def central_differences(function: Callable[[Array], Array], states: Array,
                        subtract: Callable[[Array, Array], Array] = np.subtract) -> Array:
    """Return the derivative of a function (N, n) -> (N, m) at each state, shape (N, m, n)."""
    columns = []
    for component in range(states.shape[1]):
        above, below = states.copy(), states.copy()
        step = np.cbrt(np.finfo(np.float64).eps) * np.maximum(np.abs(states[:, component]), 1.0)
        above[:, component] += step
        below[:, component] -= step
        width = (above - below)[:, component, np.newaxis]
        columns.append(subtract(function(above), function(below)) / width)
    return np.stack(columns, axis=2)


def matrix_times(matrices: Array, vectors: Array) -> Array:
    """Return the product of each matrix with its vector."""
    return (matrices @ vectors[:, :, np.newaxis])[:, :, 0]


def symmetrised(matrices: Array) -> Array:
    """Return the matrices with rounding's asymmetry averaged out."""
    return 0.5 * (matrices + matrices.swapaxes(1, 2))
