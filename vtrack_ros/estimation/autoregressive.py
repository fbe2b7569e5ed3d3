"""Autoregressive models of motion, of first and second order."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.estimation.model import (
    checked_array, checked_positive, FloatArray, LinearModel)


class FirstOrderAutoregressive(LinearModel):
    """
    Components that fall back to a mean: `x_k = mean + phi^dt (x_{k-1} - mean) + u`.

    The exact sampling of an Ornstein-Uhlenbeck process, so any dt is right; `phi = 1` is a random
    walk. All components are measured.

    Parameters
    ----------
    coefficient : array_like, shape (n,)
        phi per unit of time, 0 < phi <= 1.
    noise : array_like, shape (n,)
        The variance of u after one unit of time, positive.
    measurement_noise : array_like, shape (n, n)
    mean : array_like, shape (n,), optional
        Zero by default.

    """

    def __init__(
            self, coefficient: ArrayLike, noise: ArrayLike, measurement_noise: ArrayLike,
            mean: ArrayLike | None = None) -> None:
        self.coefficient = checked_array('coefficient', np.atleast_1d(coefficient), (None,))
        n = len(self.coefficient)
        self.noise = checked_array('noise', np.atleast_1d(noise), (n,))
        self.mean = np.zeros(n) if mean is None else checked_array(
            'mean', np.atleast_1d(mean), (n,))
        if not ((0 < self.coefficient) & (self.coefficient <= 1)).all():
            raise ValueError('coefficient must be greater than zero and at most one')
        if not (self.noise > 0).all():
            raise ValueError('noise must be positive')
        super().__init__(np.eye(n), measurement_noise)

    def transition_matrix(self, dt: float) -> FloatArray:
        """Return F, shape (n, n), diagonal."""
        return np.diag(self.coefficient ** dt)

    def transition(self, states: FloatArray, dt: float, time: float = 0.0) -> FloatArray:
        """Return the expected states after `dt`, shape (N, n)."""
        expected: FloatArray = self.mean + self.coefficient ** dt * (states - self.mean)
        return expected

    def process_noise(self, dt: float) -> FloatArray:
        """Return Q(dt), shape (n, n), diagonal."""
        walk = self.coefficient == 1
        decay = np.where(walk, 0.5, self.coefficient ** 2)
        growth = np.where(walk, dt, (1 - decay ** dt) / (1 - decay))
        return np.diag(self.noise * growth)


class SecondOrderAutoregressive(LinearModel):
    """
    Components that depend on their last two values: `x_k = a_1 x_{k-1} + a_2 x_{k-2} + u`.

    The state is `[x_k, x_{k-1}]`, each of d components; `a_1 = 2, a_2 = -1` is constant velocity
    [Yin2013, eq. 6]. The recursion is defined on a grid of times: a step of dt counts as
    `max(1, round(dt / period))` of its own. The copy of x_{k-1} has no noise of its own; it gets
    the fraction `lag_noise` of u's variance so that the transition has a density. All of x_k is
    measured.

    Parameters
    ----------
    first, second : array_like, shape (d,)
        a_1 and a_2.
    noise : array_like, shape (d,)
        The variance of u, positive.
    measurement_noise : array_like, shape (d, d)
    period : float
        The time between x_{k-1} and x_k.
    lag_noise : float
        Relative variance of the copy, positive.

    """

    def __init__(
            self, first: ArrayLike, second: ArrayLike, noise: ArrayLike,
            measurement_noise: ArrayLike, period: float = 1.0, lag_noise: float = 1e-6) -> None:
        first = checked_array('first', np.atleast_1d(first), (None,))
        d = len(first)
        second = checked_array('second', np.atleast_1d(second), (d,))
        noise = checked_array('noise', np.atleast_1d(noise), (d,))
        if not (noise > 0).all():
            raise ValueError('noise must be positive')
        self.period = checked_positive('period', period)
        lag_noise = checked_positive('lag_noise', lag_noise)
        self._matrix = np.block([[np.diag(first), np.diag(second)],
                                 [np.eye(d), np.zeros((d, d))]])
        self._noise = np.diag(np.concatenate([noise, lag_noise * noise]))
        super().__init__(np.eye(d, 2 * d), measurement_noise)

    def transition_matrix(self, dt: float) -> FloatArray:
        """Return F, shape (n, n): the companion matrix to the power of the number of steps."""
        return np.linalg.matrix_power(self._matrix, self._steps(dt))

    def process_noise(self, dt: float) -> FloatArray:
        """Return Q(dt), shape (n, n): the noise of each step, carried to the end."""
        total = self._noise
        for _ in range(self._steps(dt) - 1):
            total = self._matrix @ total @ self._matrix.T + self._noise
        return total

    def _steps(self, dt: float) -> int:
        return max(1, round(dt / self.period))
