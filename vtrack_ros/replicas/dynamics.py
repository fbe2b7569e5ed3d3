"""The dynamics that the papers' "first-order autoregressive model" may mean."""

from vtrack_ros.estimation import ConstantVelocity
from vtrack_ros.frame import Array

#: Names of the dynamics.
DYNAMICS = ('white_acceleration', 'constant_velocity', 'random_walk')
#: Standard deviation of the velocity's independent noise, as a share of that of the position's.
_VELOCITY_SHARE = 0.13


class DiagonalNoise(ConstantVelocity):
    """
    Positions and velocities with independent noise, of the densities of `ConstantVelocity`.

    Unless it `moves`, A is the identity: positions do a random walk; velocities have no effect.
    """

    def __init__(self, density: float, wander_density: float, moves: bool) -> None:
        super().__init__(2, 2, density, wander_density)
        self._moves = moves

    def transition_matrix(self, dt: float) -> Array:
        return super().transition_matrix(dt if self._moves else 0.0)

    def transition(self, states: Array, dt: float, time: float = 0.0) -> Array:
        return super().transition(states, dt if self._moves else 0.0, time)

    def process_noise(self, dt: float) -> Array:
        noise = super().process_noise(dt)
        noise[:4, :4] = 0.0
        noise[[0, 1], [0, 1]] = self.acceleration_density * dt
        noise[[2, 3], [2, 3]] = _VELOCITY_SHARE**2 * self.acceleration_density * dt
        return noise


def motion_model(dynamics: str, noise: float, size_noise: float) -> ConstantVelocity:
    """Return the model of (cx, cy, vx, vy, w, h) of that name; noise per frame, in px."""
    if dynamics == 'white_acceleration':
        return ConstantVelocity(2, 2, noise**2, size_noise**2)
    return DiagonalNoise(noise**2, size_noise**2, dynamics == 'constant_velocity')
