"""Nonlinear models that filters are measured on, two scalar ones and a radar; simulation."""

import math

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.estimation.model import (
    checked_array, checked_count, checked_positive, ConstantVelocity, StateSpaceModel)
from vtrack_ros.frame import Array


def simulate(
        model: StateSpaceModel, start: ArrayLike, steps: int, rng: np.random.Generator,
        dt: float = 1.0, time: float = 0.0) -> tuple[Array, Array]:
    """
    Draw a trajectory of a model from `start`, shape (n,), at `time`, and its measurements.

    They have the shapes (steps, n), without the start, and (steps, m).
    """
    state = checked_array('start', start, (model.state_dimension,))[np.newaxis]
    states = np.empty((steps, model.state_dimension))
    measurements = model.measurement_error.sample(steps, rng)
    for step in range(steps):
        state = model.sample_transition(state, dt, rng, time)
        time += dt
        states[step] = state[0]
        measurements[step] += model.measure(state, time)[0]
    return states, measurements


class UnivariateNonstationaryGrowth(StateSpaceModel):
    """
    The univariate nonstationary growth model, UNG [Qi2012, eq. 26].

        x_k = 0.5 x + 25 x / (1 + x^2) + 8 cos(1.2 (k - 1)) + v,   x = x_{k-1}
        y_k = x_k^2 / 20 + w

    The measurement doesn't tell the sign of the state: the posterior has two modes. The paper
    adds `8 cos(k)` to y_k, a known offset that changes nothing. A step has dt = 1; `time` is k.
    The paper gives no variances; 10 and 1 are usual (Gordon, Salmond and Smith, 1993).
    """

    def __init__(self, process_variance: float = 10.0, measurement_variance: float = 1.0) -> None:
        self.process_variance = checked_positive('process_variance', process_variance)
        super().__init__(1, [[checked_positive('measurement_variance', measurement_variance)]])

    def transition(self, states: Array, dt: float, time: float = 0.0) -> Array:
        # In place: 0.5 x + 25 x / (1 + x^2) without four temporary arrays.
        moved = states ** 2
        moved += 1
        np.divide(25, moved, out=moved)
        moved += 0.5
        moved *= states
        moved += 8 * math.cos(1.2 * time)
        return moved

    def process_noise(self, dt: float) -> Array:
        return np.array([[self.process_variance]])

    def measure(self, states: Array, time: float = 0.0) -> Array:
        return states ** 2 / 20

    def transition_jacobian(
            self, states: Array, dt: float, time: float = 0.0) -> Array:
        square = states ** 2
        slope: Array = 0.5 + 25 * (1 - square) / (1 + square) ** 2
        return slope[:, :, np.newaxis]

    def measurement_jacobian(self, states: Array, time: float = 0.0) -> Array:
        return (states / 10)[:, :, np.newaxis]


class VanDerMerweModel(StateSpaceModel):
    """
    The scalar model of the unscented particle filter (van der Merwe et al., 2000, section 5).

        x_k = 1 + sin(0.04 pi (k - 1)) + 0.5 x_{k-1} + v,   v ~ Gamma(3, 2)
        y_k = 0.2 x_k^2 + w     for k <= 30
        y_k = 0.5 x_k - 2 + w   for k > 30

    The noise v isn't symmetric and never negative. Its mean is part of `transition`, which leaves
    a noise of zero mean: the Gamma density is `v^(shape-1) exp(-rate v)`, its mean shape / rate.
    A step has dt = 1, and `time` is k.
    """

    def __init__(
            self, shape: float = 3.0, rate: float = 2.0,
            measurement_variance: float = 1e-5) -> None:
        self.shape = checked_positive('shape', shape)
        self.rate = checked_positive('rate', rate)
        super().__init__(1, [[checked_positive('measurement_variance', measurement_variance)]])

    def transition(self, states: Array, dt: float, time: float = 0.0) -> Array:
        drift = 1 + math.sin(0.04 * math.pi * time) + self.shape / self.rate
        return 0.5 * states + drift

    def process_noise(self, dt: float) -> Array:
        return np.array([[self.shape / self.rate ** 2]])

    def sample_noise(self, count: int, dt: float, rng: np.random.Generator) -> Array:
        """Draw v minus its mean, shape (count, 1)."""
        return rng.gamma(self.shape, 1 / self.rate, (count, 1)) - self.shape / self.rate

    def log_noise_density(self, noise: Array, dt: float) -> Array:
        """Return the log-density of v minus its mean, shape (N,); -inf where v < 0."""
        v = noise[:, 0] + self.shape / self.rate
        possible = v > 0
        v = np.where(possible, v, 1.0)
        normaliser = self.shape * math.log(self.rate) - math.lgamma(self.shape)
        density = (self.shape - 1) * np.log(v) - self.rate * v + normaliser
        return np.where(possible, density, -np.inf)

    def measure(self, states: Array, time: float = 0.0) -> Array:
        if time <= 30:
            return 0.2 * states ** 2
        return 0.5 * states - 2

    def transition_jacobian(
            self, states: Array, dt: float, time: float = 0.0) -> Array:
        return np.full((len(states), 1, 1), 0.5)

    def measurement_jacobian(self, states: Array, time: float = 0.0) -> Array:
        slope = 0.4 * states if time <= 30 else np.full_like(states, 0.5)
        return slope[:, :, np.newaxis]


class BearingRange(StateSpaceModel):
    """
    A target at nearly constant velocity, measured as range and angles from the origin.

    The state is `[p, v]` with positions in the plane (4-D) or in space (6-D), moving as in
    `ConstantVelocity`. The measurement is `[range, bearing]`, with the elevation in space;
    bearings wrap at pi. By default its standard deviations are 1 m and 0.01 rad.
    """

    def __init__(
            self, positions: int = 2, acceleration_density: float = 1.0,
            measurement_noise: ArrayLike | None = None) -> None:
        self.positions = checked_count('positions', positions, least=2)
        if positions > 3:
            raise ValueError(f'positions must be 2 or 3, not {positions}')
        default = np.diag([1.0, 1e-4, 1e-4][:positions])
        noise = default if measurement_noise is None else checked_array(
            'measurement_noise', measurement_noise, (positions, positions))
        super().__init__(2 * positions, noise)
        self._motion = ConstantVelocity(positions, acceleration_density=acceleration_density)
        self.measured_components = tuple(range(positions))

    def transition_matrix(self, dt: float) -> Array:
        return self._motion.transition_matrix(dt)

    def transition(self, states: Array, dt: float, time: float = 0.0) -> Array:
        return self._motion.transition(states, dt, time)

    def process_noise(self, dt: float) -> Array:
        return self._motion.process_noise(dt)

    def measure(self, states: Array, time: float = 0.0) -> Array:
        """Return range, bearing and, in space, elevation; shape (N, positions), [m, rad, rad]."""
        measured = np.empty((len(states), self.positions))
        ground = np.hypot(states[:, 0], states[:, 1])
        measured[:, 0] = ground
        measured[:, 1] = np.arctan2(states[:, 1], states[:, 0])
        if self.positions == 3:
            measured[:, 0] = np.hypot(ground, states[:, 2])
            measured[:, 2] = np.arctan2(states[:, 2], ground)
        return measured

    def residual(self, measurements: Array, predicted: Array) -> Array:
        """Return measurement minus prediction, the bearing's in [-pi, pi); shape (N, m)."""
        difference = measurements - predicted
        bearing = difference[..., 1]
        bearing += math.pi
        bearing %= 2 * math.pi
        bearing -= math.pi
        return difference
