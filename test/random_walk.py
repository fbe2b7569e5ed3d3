"""A user-defined state-space model: a scalar that reverts to its mean, measured with noise."""

import numpy as np

from vtrack_ros.estimation import LinearModel


class RandomWalk(LinearModel):
    """`x_k = mean + phi^dt (x_{k-1} - mean) + u`, var u = `noise` at dt = 1; z = x + w."""

    def __init__(self, coefficient=1.0, noise=1.0, measurement_noise=1.0, mean=0.0):
        super().__init__([[1.0]], [[measurement_noise]])
        self.coefficient, self.noise, self.mean = coefficient, noise, mean

    def transition(self, states, dt, time=0.0):
        """Return the expected states, shape (N, 1)."""
        return self.mean + self.coefficient ** dt * (states - self.mean)

    def transition_matrix(self, dt):
        """Return phi^dt, shape (1, 1)."""
        return np.array([[self.coefficient ** dt]])

    def process_noise(self, dt):
        """Return the variance of an Ornstein-Uhlenbeck process after dt, shape (1, 1)."""
        square = self.coefficient ** 2
        growth = dt if square == 1 else (1 - square ** dt) / (1 - square)
        return np.array([[self.noise * growth]])
