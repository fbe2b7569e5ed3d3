"""What a filter must know about a system: how its state moves, and what is seen of it."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.estimation.gaussian import GaussianNoise
from vtrack_ros.estimation.validation import (
    checked_array, checked_count, checked_covariance, FloatArray)


class StateSpaceModel(ABC):
    """
    A Markov state, and a measurement of it with additive Gaussian error.

        x_k = f(x_{k-1}, dt) + v_k,   cov v_k = Q(dt)
        z_k = h(x_k) + w_k,           w_k ~ N(0, R)

    A subclass gives f, Q and h, all vectorised: states have the shape (N, n). The process noise
    is Gaussian unless the subclass overrides `sample_noise` and `log_noise_density`; its mean is
    always zero, so that f and Q are the first two moments of the transition.

    Methods take `time`: for a transition that of its beginning, for a measurement its own. Only
    models that change with time look at it. Time and dt have the unit of the model, usually
    seconds or frames.

    Parameters
    ----------
    state_dimension : int
    measurement_noise : array_like, shape (m, m)
        The covariance R, symmetric positive definite; gives the measurement's dimension.

    Raises
    ------
    ValueError
        If the dimension isn't positive or the covariance not positive definite.

    """

    measured_components: tuple[int, ...] | None = None
    """The components that the measurement depends on; None stands for all."""

    def __init__(self, state_dimension: int, measurement_noise: ArrayLike) -> None:
        self.state_dimension = checked_count('state_dimension', state_dimension)
        noise = np.atleast_2d(np.asarray(measurement_noise, dtype=np.float64))
        self.measurement_dimension = len(noise)
        self.measurement_error = GaussianNoise.from_covariance(
            checked_covariance('measurement_noise', noise, len(noise)))
        self._process_error: tuple[float, GaussianNoise] | None = None

    @abstractmethod
    def transition(self, states: FloatArray, dt: float, time: float = 0.0) -> FloatArray:
        """Return the expected states after `dt`, shape (N, n)."""

    @abstractmethod
    def process_noise(self, dt: float) -> FloatArray:
        """Return the covariance of the process noise of a step of `dt`, shape (n, n)."""

    @abstractmethod
    def measure(self, states: FloatArray, time: float = 0.0) -> FloatArray:
        """Return the error-free measurements of states, shape (N, m)."""

    def transition_matrix(self, dt: float) -> FloatArray | None:
        """Return F, shape (n, n), where the transition is linear up to a constant; else None."""
        return None

    @property
    def measurement_noise(self) -> FloatArray:
        """Return the covariance of the measurement's error, shape (m, m)."""
        return self.measurement_error.covariance

    def process_error(self, dt: float) -> GaussianNoise:
        """
        Return the process noise of a step of `dt`, factorised; the last one is remembered.

        Raises
        ------
        ValueError
            If the covariance isn't positive definite.

        """
        if self._process_error is None or self._process_error[0] != dt:
            self._process_error = dt, GaussianNoise.from_covariance(self.process_noise(dt))
        return self._process_error[1]

    def sample_noise(self, count: int, dt: float, rng: np.random.Generator) -> FloatArray:
        """Draw the process noise of `count` steps of `dt`, shape (count, n)."""
        return self.process_error(dt).sample(count, rng)

    def log_noise_density(self, noise: FloatArray, dt: float) -> FloatArray:
        """Return the log-density of the process noise of a step of `dt`, shape (N,)."""
        return self.process_error(dt).log_density(noise)

    def sample_transition(
            self, states: FloatArray, dt: float, rng: np.random.Generator,
            time: float = 0.0) -> FloatArray:
        """Draw a successor of each state, shape (N, n)."""
        successors = self.sample_noise(len(states), dt, rng)
        successors += self.transition(states, dt, time)
        return successors

    def log_transition(
            self, states: FloatArray, previous: FloatArray, dt: float,
            time: float = 0.0) -> FloatArray:
        """Return log p(states[i] | previous[i]), shape (N,)."""
        return self.log_noise_density(states - self.transition(previous, dt, time), dt)

    def residual(self, measurements: FloatArray, predicted: FloatArray) -> FloatArray:
        """Return measurement minus prediction, shape (..., m); override where angles wrap."""
        return measurements - predicted

    def log_likelihood(
            self, states: FloatArray, measurement: FloatArray, time: float = 0.0,
            error: GaussianNoise | None = None) -> FloatArray:
        """
        Return log p(measurement | states[i]), shape (N,).

        Parameters
        ----------
        states : ndarray, shape (N, n)
            What the state may be.
        measurement : ndarray, shape (m,)
            What was seen.
        time : float
            That of the measurement.
        error : GaussianNoise, optional
            That of this measurement, where it differs from the model's.

        """
        residual = self.residual(measurement, self.measure(states, time))
        return (error or self.measurement_error).log_density(residual)

    def simulate(
            self, start: ArrayLike, steps: int, rng: np.random.Generator, dt: float = 1.0,
            time: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """
        Draw a trajectory and its measurements.

        Parameters
        ----------
        start : array_like, shape (n,)
            The state at `time`; not part of the result.
        steps : int
            How many.
        rng : numpy.random.Generator
            Where randomness comes from.
        dt, time : float
            The length of a step, and when the first one begins.

        Returns
        -------
        states : ndarray, shape (steps, n)
        measurements : ndarray, shape (steps, m)

        """
        state = checked_array('start', start, (self.state_dimension,))[np.newaxis]
        states = np.empty((steps, self.state_dimension))
        measurements = self.measurement_error.sample(steps, rng)
        for step in range(steps):
            state = self.sample_transition(state, dt, rng, time)
            time += dt
            states[step] = state[0]
            measurements[step] += self.measure(state, time)[0]
        return states, measurements

    def transition_jacobian(
            self, states: FloatArray, dt: float, time: float = 0.0) -> FloatArray:
        """Return the derivative of the transition at each state, shape (N, n, n)."""
        jacobian = np.empty((*states.shape, self.state_dimension))
        for column, step, above, below in self._neighbours(states):
            difference = self.transition(above, dt, time) - self.transition(below, dt, time)
            jacobian[:, :, column] = difference / step[:, np.newaxis]
        return jacobian

    def measurement_jacobian(self, states: FloatArray, time: float = 0.0) -> FloatArray:
        """Return the derivative of the measurement at each state, shape (N, m, n)."""
        jacobian = np.empty((len(states), self.measurement_dimension, self.state_dimension))
        for column, step, above, below in self._neighbours(states):
            difference = self.residual(self.measure(above, time), self.measure(below, time))
            jacobian[:, :, column] = difference / step[:, np.newaxis]
        return jacobian

    def _neighbours(
            self, states: FloatArray) -> list[tuple[int, FloatArray, FloatArray, FloatArray]]:
        """Return states a little above and below in each component, for central differences."""
        relative = np.cbrt(np.finfo(np.float64).eps)
        neighbours = []
        for column in range(self.state_dimension):
            above, below = states.copy(), states.copy()
            step = relative * np.maximum(np.abs(states[:, column]), 1.0)
            above[:, column] += step
            below[:, column] -= step
            neighbours.append((column, above[:, column] - below[:, column], above, below))
        return neighbours


class LinearModel(StateSpaceModel):
    """
    A model whose transition and measurement are matrices.

    Parameters
    ----------
    measurement_matrix : array_like, shape (m, n)
        H in `z = H x + w`.
    measurement_noise : array_like, shape (m, m)
        The covariance R, symmetric positive definite.

    Raises
    ------
    ValueError
        If the shapes don't fit or the covariance isn't positive definite.

    """

    def __init__(self, measurement_matrix: ArrayLike, measurement_noise: ArrayLike) -> None:
        matrix = checked_array('measurement_matrix', measurement_matrix, (None, None))
        super().__init__(matrix.shape[1], measurement_noise)
        if len(matrix) != self.measurement_dimension:
            raise ValueError(f'measurement_matrix has {len(matrix)} rows, '
                             f'measurement_noise {self.measurement_dimension}')
        self.measurement_matrix = matrix
        self.measured_components = tuple(int(i) for i in np.flatnonzero(matrix.any(axis=0)))

    @abstractmethod
    def transition_matrix(self, dt: float) -> FloatArray:
        """Return F of `x_k = F x_{k-1} + c + v`, shape (n, n)."""

    def transition(self, states: FloatArray, dt: float, time: float = 0.0) -> FloatArray:
        """Return the expected states after `dt`, shape (N, n)."""
        return states @ self.transition_matrix(dt).T

    def measure(self, states: FloatArray, time: float = 0.0) -> FloatArray:
        """Return the error-free measurements of states, shape (N, m)."""
        return states @ self.measurement_matrix.T

    def transition_jacobian(
            self, states: FloatArray, dt: float, time: float = 0.0) -> FloatArray:
        """Return the transition matrix for each state, shape (N, n, n)."""
        matrix = self.transition_matrix(dt)
        return np.broadcast_to(matrix, (len(states), *matrix.shape))

    def measurement_jacobian(self, states: FloatArray, time: float = 0.0) -> FloatArray:
        """Return the measurement matrix for each state, shape (N, m, n)."""
        matrix = self.measurement_matrix
        return np.broadcast_to(matrix, (len(states), *matrix.shape))
