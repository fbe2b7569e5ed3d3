"""State-space models: how a state moves, what is measured of it, and their Gaussian errors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
import math
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.frame import Array


def checked_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Return finite floats of a given shape, None being any length; else raise ValueError."""
    array = np.asarray(value, dtype=np.float64)
    if array.ndim != len(shape) or any(
            wanted not in (None, length) for length, wanted in zip(array.shape, shape)):
        wanted_shape = ', '.join('any' if length is None else str(length) for length in shape)
        raise ValueError(f'{name} must have the shape ({wanted_shape}), not {array.shape}')
    if not np.isfinite(array).all():
        raise ValueError(f'{name} must be finite')
    return array


def checked_covariance(name: str, value: ArrayLike, dimension: int) -> Array:
    """Return a symmetric positive definite matrix, shape (n, n); else raise ValueError."""
    matrix = checked_array(name, value, (dimension, dimension))
    scale = np.abs(matrix).max(initial=0.0)
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-9 * scale):
        raise ValueError(f'{name} must be symmetric')
    return GaussianNoise.from_covariance((matrix + matrix.T) / 2, name).covariance


def checked_count(name: str, value: float, least: int = 1) -> int:
    """Return a whole number that is `least` or more; else raise ValueError."""
    # the remainder of NaN and infinity is NaN, which counts as true
    if isinstance(value, bool) or not isinstance(value, Real) or value % 1 or value < least:
        raise ValueError(f'{name} must be a whole number of at least {least}, not {value!r}')
    return int(value)


def checked_positive(name: str, value: float) -> float:
    """Return a finite float greater than zero; else raise ValueError."""
    if not (isinstance(value, Real) and 0 < value < np.inf):
        raise ValueError(f'{name} must be positive and finite, not {value!r}')
    return float(value)


@dataclass(frozen=True, eq=False)
class GaussianNoise:
    """A zero-mean Gaussian error, with the factor L of its covariance `L L^T`, (n, n) both."""

    covariance: Array
    factor: Array

    @classmethod
    def from_covariance(cls, covariance: Array, name: str = 'covariance') -> GaussianNoise:
        """Factorise a covariance, (n, n); ValueError unless finite and positive definite."""
        try:
            factor = np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError:
            raise ValueError(f'{name} must be positive definite') from None
        # infinity and NaN raise nothing
        if not np.isfinite(factor).all():
            raise ValueError(f'{name} must be finite')
        return cls(covariance, factor)

    @cached_property
    def whitener(self) -> Array:
        """Return the inverse of the factor, shape (n, n)."""
        return np.linalg.inv(self.factor)

    @cached_property
    def log_normaliser(self) -> float:
        """Return the log-density at zero."""
        return (-len(self.factor) / 2 * math.log(2 * math.pi)
                - float(np.log(self.factor.diagonal()).sum()))

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Draw `count` errors, shape (count, n)."""
        return rng.standard_normal((count, len(self.factor))) @ self.factor.T

    def log_density(self, errors: Array) -> Array:
        """Return the log-density of errors of shape (N, n), shape (N,)."""
        white = errors @ self.whitener.T
        density: Array = np.einsum('ij,ij->i', white, white)
        density *= -0.5
        density += self.log_normaliser
        return density


class StateSpaceModel(ABC):
    """
    A Markov state, and a measurement of it with additive Gaussian error.

        x_k = f(x_{k-1}, dt) + v_k,   cov v_k = Q(dt)
        z_k = h(x_k) + w_k,           w_k ~ N(0, R)

    A subclass gives f, Q and h, all vectorised: states have the shape (N, n). The process noise
    is Gaussian unless the subclass overrides `sample_noise` and `log_noise_density`; its mean is
    always zero, so that f and Q are the first two moments of the transition.

    Methods take `time`: when the transition begins, or when the measurement is made. Only models
    that change with time use it. Time and dt have the unit of the model, usually seconds or
    frames.

    The measurement noise is R, shape (m, m); ValueError unless it's symmetric and positive
    definite.
    """

    measured_components: tuple[int, ...] | None = None
    """The components that the measurement depends on; None: all of them."""

    stacked = False
    """Whether the matrices are stacked, one for each belief: then all are predicted in one go."""

    def __init__(self, state_dimension: int, measurement_noise: ArrayLike) -> None:
        self.state_dimension = checked_count('state_dimension', state_dimension)
        noise = np.atleast_2d(np.asarray(measurement_noise, dtype=np.float64))
        self.measurement_dimension = len(noise)
        self.measurement_error = GaussianNoise.from_covariance(
            checked_covariance('measurement_noise', noise, len(noise)))
        self._process_error: tuple[float, GaussianNoise] | None = None

    @abstractmethod
    def transition(self, states: Array, dt: float, time: float = 0.0) -> Array:
        """Return the expected states after `dt`, shape (N, n)."""

    @abstractmethod
    def process_noise(self, dt: float) -> Array:
        """Return the covariance of the process noise of a step of `dt`, shape (n, n)."""

    @abstractmethod
    def measure(self, states: Array, time: float = 0.0) -> Array:
        """Return the error-free measurements of states, shape (N, m)."""

    def transition_matrix(self, dt: float) -> Array | None:
        """Return F, shape (n, n), where the transition is linear up to a constant; else None."""
        return None

    @property
    def measurement_noise(self) -> Array:
        """Return the covariance of the measurement's error, shape (m, m)."""
        return self.measurement_error.covariance

    def process_error(self, dt: float) -> GaussianNoise:
        """
        Return the process noise of a step of `dt`, factorised; the latest one is cached.

        ValueError unless it's positive definite: a particle filter needs noise in every component.
        """
        if self._process_error is None or self._process_error[0] != dt:
            self._process_error = dt, GaussianNoise.from_covariance(
                self.process_noise(dt), 'process_noise')
        return self._process_error[1]

    def sample_noise(self, count: int, dt: float, rng: np.random.Generator) -> Array:
        """Draw the process noise of `count` steps of `dt`, shape (count, n)."""
        return self.process_error(dt).sample(count, rng)

    def log_noise_density(self, noise: Array, dt: float) -> Array:
        """Return the log-density of the process noise of a step of `dt`, shape (N,)."""
        return self.process_error(dt).log_density(noise)

    def sample_transition(self, states: Array, dt: float, rng: np.random.Generator,
                          time: float = 0.0) -> Array:
        """Draw a successor of each state, shape (N, n)."""
        successors = self.sample_noise(len(states), dt, rng)
        successors += self.transition(states, dt, time)
        return successors

    def log_transition(self, states: Array, previous: Array, dt: float,
                       time: float = 0.0) -> Array:
        """Return log p(states[i] | previous[i]), shape (N,)."""
        return self.log_noise_density(states - self.transition(previous, dt, time), dt)

    def residual(self, measurements: Array, predicted: Array) -> Array:
        """Return measurement minus prediction, shape (..., m); override where angles wrap."""
        return measurements - predicted

    def log_likelihood(self, states: Array, measurement: Array, time: float = 0.0,
                       error: GaussianNoise | None = None) -> Array:
        """Return log p(measurement | states[i]), shape (N,); `error` replaces R if given."""
        residual = self.residual(measurement, self.measure(states, time))
        return (error or self.measurement_error).log_density(residual)

    def transition_jacobian(self, states: Array, dt: float, time: float = 0.0) -> Array | None:
        """Return the derivative of f, shape (N, n, n); None: central differences are used."""
        return None

    def measurement_jacobian(self, states: Array, time: float = 0.0) -> Array | None:
        """Return the derivative of h, shape (N, m, n); None: central differences are used."""
        return None


class LinearModel(StateSpaceModel):
    """A model with matrices: `x_k = F(dt) x_{k-1} + c + v` and `z = H x + w`; H, R are given."""

    def __init__(self, measurement_matrix: ArrayLike, measurement_noise: ArrayLike) -> None:
        matrix = checked_array('measurement_matrix', measurement_matrix, (None, None))
        super().__init__(matrix.shape[1], measurement_noise)
        if len(matrix) != self.measurement_dimension:
            raise ValueError(f'measurement_matrix has {len(matrix)} rows, '
                             f'measurement_noise {self.measurement_dimension}')
        self.measurement_matrix = matrix
        self.measured_components = tuple(int(i) for i in np.flatnonzero(matrix.any(axis=0)))

    @abstractmethod
    def transition_matrix(self, dt: float) -> Array:
        """Return F of `x_k = F x_{k-1} + c + v`, shape (n, n)."""

    def transition(self, states: Array, dt: float, time: float = 0.0) -> Array:
        return states @ self.transition_matrix(dt).T

    def measure(self, states: Array, time: float = 0.0) -> Array:
        return states @ self.measurement_matrix.T

    def measurement_jacobian(self, states: Array, time: float = 0.0) -> Array:
        """Return H for each state, shape (N, m, n)."""
        matrix = self.measurement_matrix
        return np.broadcast_to(matrix, (len(states), *matrix.shape))


class ConstantVelocity(LinearModel):
    """
    Positions that move at nearly constant velocity, and components that do a random walk.

    The state is `[p_1 .. p_d, v_1 .. v_d, s_1 .. s_c]`; with d = c = 2 it is the paper's
    `[cx, cy, vx, vy, Hx, Hy]` [Zhu2012, eq. 19]. Velocities are driven by white acceleration of
    the given spectral density (Bar-Shalom, Li and Kirubarajan, 2001, section 6.2.2), so Q(dt) is
    positive definite and two steps of dt equal one of 2 dt. What is measured is p, or p and s.

    `acceleration_density` is in [unit^2/s^3]; `wander_density` is the variance that a wandering
    component gains per unit of time, [unit^2/s]. The shape of the measurement noise, [unit^2],
    says what is measured; by default p with unit variance.
    """

    def __init__(self, positions: int = 2, wandering: int = 0, acceleration_density: float = 1.0,
                 wander_density: float = 1.0, measurement_noise: ArrayLike | None = None) -> None:
        self.positions = positions = checked_count('positions', positions)
        self.wandering = wandering = checked_count('wandering', wandering, least=0)
        self._acceleration_density = checked_positive('acceleration_density', acceleration_density)
        self._wander_density = checked_positive('wander_density', wander_density)
        noise = np.eye(positions) if measurement_noise is None else np.asarray(measurement_noise)
        measured = (positions, positions + wandering)
        if noise.shape not in [(size, size) for size in measured]:
            raise ValueError('measurement_noise must be a square matrix of size '
                             f'{" or ".join(str(size) for size in dict.fromkeys(measured))}, '
                             f'not of shape {noise.shape}')
        matrix = np.zeros((len(noise), 2 * positions + wandering))
        matrix[:positions, :positions] = np.eye(positions)
        matrix[positions:, 2 * positions:] = np.eye(len(noise) - positions, wandering)
        super().__init__(matrix, noise)

    @property
    def acceleration_density(self) -> float:
        """Return the spectral density of the acceleration, [unit^2/s^3]."""
        return self._acceleration_density

    @property
    def wander_density(self) -> float:
        """Return the variance that a wandering component gains per unit of time, [unit^2/s]."""
        return self._wander_density

    def transition_matrix(self, dt: float) -> Array:
        d = self.positions
        matrix = np.eye(self.state_dimension)
        matrix[:d, d:2 * d] = dt * np.eye(d)
        return matrix

    def transition(self, states: Array, dt: float, time: float = 0.0) -> Array:
        d = self.positions
        expected = states.copy()
        expected[:, :d] += dt * states[:, d:2 * d]
        return expected

    def process_noise(self, dt: float) -> Array:
        d = self.positions
        noise = np.diag(np.full(self.state_dimension, self.wander_density * dt))
        eye = self.acceleration_density * np.eye(d)
        noise[:d, :d] = eye * dt ** 3 / 3
        noise[:d, d:2 * d] = noise[d:2 * d, :d] = eye * dt ** 2 / 2
        noise[d:2 * d, d:2 * d] = eye * dt
        return noise
