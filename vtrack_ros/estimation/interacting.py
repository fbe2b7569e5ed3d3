"""Several motion hypotheses side by side: the interacting multiple model."""

import math

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.estimation.kalman import Gaussian, matrix_times
from vtrack_ros.estimation.model import checked_array, checked_count, LinearModel
from vtrack_ros.frame import Array


class VelocityHypotheses(LinearModel):
    """
    Positions with constant or decaying velocity under K hypotheses, one for each of K beliefs.

    The state is `[p_1 .. p_d, v_1 .. v_d]`, the measurement p. Under each hypothesis the velocity
    is driven by white acceleration of a spectral density, [unit^2/s^3], and decays exponentially
    with a time constant, [s]; an infinite one gives the model of `ConstantVelocity`. A decaying
    velocity is an Ornstein-Uhlenbeck process, whose moments are exact (Uhlenbeck and Ornstein,
    1930). ValueError unless densities and time constants, shape (K,) both, are positive.

    Matrices are stacked, shape (K, 2d, 2d), so that a `KalmanFilter` takes K beliefs in one go.
    """

    stacked = True

    def __init__(self, positions: int, densities: ArrayLike, time_constants: ArrayLike) -> None:
        self.positions = d = checked_count('positions', positions)
        with np.errstate(divide='ignore'):
            rates = 1 / np.asarray(time_constants, np.float64)
        if rates.ndim != 1 or not ((rates >= 0) & (rates < math.inf)).all():
            raise ValueError(f'time_constants must be a list of positive numbers, some of which '
                             f'may be infinite, not {time_constants!r}')
        values = checked_array('densities', densities, rates.shape)
        if not (values > 0).all():
            raise ValueError(f'densities must be positive, not {densities!r}')
        self._hypotheses = list(zip(values.tolist(), rates.tolist()))
        self._step: tuple[float, Array, Array] | None = None
        super().__init__(np.eye(d, 2 * d), np.eye(d))

    def transition_matrix(self, dt: float) -> Array:
        return self._matrices(dt)[1]

    def transition(self, states: Array, dt: float, time: float = 0.0) -> Array:
        return matrix_times(self.transition_matrix(dt), states)

    def process_noise(self, dt: float) -> Array:
        return self._matrices(dt)[2]

    def _matrices(self, dt: float) -> tuple[float, Array, Array]:
        """Return dt, F and Q, the matrices of shape (K, 2d, 2d); the latest ones are cached."""
        if self._step is None or self._step[0] != dt:
            rows = [_step(rate, dt) for _, rate in self._hypotheses]
            noise = [[q * part for part in row[1]] for (q, _), row in zip(self._hypotheses, rows)]
            self._step = dt, self._blocks([row[0] for row in rows]), self._blocks(noise)
        return self._step

    def _blocks(self, rows: list[list[float]]) -> Array:
        """Return matrices (K, 2d, 2d) of four blocks, each a multiple of the identity."""
        d = self.positions
        blocks: Array = np.einsum('kab,ij->kaibj', np.reshape(rows, (-1, 2, 2)), np.eye(d))
        return blocks.reshape(len(rows), 2 * d, 2 * d)


def _step(rate: float, dt: float) -> tuple[list[float], list[float]]:
    """Return the 2 x 2 entries of F, and of Q at a density of 1, for one position and velocity."""
    kept = math.exp(-rate * dt)
    if rate * dt < 1e-3:
        # the decay is negligible, and the exact formulas would suffer from cancellation
        way, places, speeds = dt, dt**3 / 3, dt
    else:
        way = -math.expm1(-rate * dt) / rate
        speeds = (1 - kept**2) / (2 * rate)
        places = (dt - 2 * way + speeds) / rate**2
    return [1.0, way, 0.0, kept], [places, way**2 / 2, way**2 / 2, speeds]


def switching(count: int, dt: float, time_constant: float) -> Array:
    """Return the transition probabilities (K, K) between hypotheses within `dt`."""
    stay = math.exp(-dt / time_constant)
    return stay * np.eye(count) + (1 - stay) / count


def mix(beliefs: Gaussian, weights: Array, transition: Array) -> tuple[Gaussian, Array]:
    """
    Mix the hypotheses' beliefs before a step: the interaction [Blom1988].

    `weights` (K,) are the hypotheses' probabilities, `transition` (K, K) is from row to column.
    Returns the belief that each hypothesis starts the step with, moments matched, and its
    predicted probability, shape (K,).
    """
    predicted = weights @ transition
    # a hypothesis of probability 0 keeps its own belief
    shares = np.divide(weights[:, np.newaxis] * transition, predicted,
                       out=np.eye(len(weights)), where=predicted > 0).T
    mean = shares @ beliefs.mean
    offset = beliefs.mean - mean[:, np.newaxis]
    covariance = _weighted(shares, beliefs.covariance)
    covariance += (shares[:, :, np.newaxis] * offset).swapaxes(1, 2) @ offset
    return Gaussian(mean, covariance), predicted


def moments(beliefs: Gaussian, weights: Array) -> tuple[Array, Array]:
    """Return mean (n,) and covariance (n, n) of a mixture of beliefs with weights (K,)."""
    mean = weights @ beliefs.mean
    offset = beliefs.mean - mean
    covariance = _weighted(weights, beliefs.covariance)
    covariance += (weights * offset.T) @ offset
    return mean, covariance


def _weighted(weights: Array, matrices: Array) -> Array:
    """Return sums (..., n, n) of matrices (K, n, n) with weights (..., K)."""
    sums: Array = weights @ matrices.reshape(len(matrices), -1)
    return sums.reshape(*weights.shape[:-1], *matrices.shape[1:])
