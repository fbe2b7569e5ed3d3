"""Particles on the affine group, and particles in a vector of geometric parameters."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.estimation.particles import systematic
from vtrack_ros.frame import Array
from vtrack_ros.geometry import affine

#: Allowed scale relative to the first frame's (minimum, maximum), by default.
_SCALES = 0.2, 5.0
#: Largest allowed elongation: the ratio of the stretches along two axes.
_MAX_STRETCH = 2.5
#: Elementwise bound (+/-) of a step in the Lie algebra: logarithms of size and shape, and sides in
#: the last column. It only keeps the exponential finite after a pause of years: far shorter steps
#: are already refused.
_STEP_CLAMP = np.array([[10.0, 10.0, 1e6], [10.0, 10.0, 1e6], [0.0, 0.0, 0.0]])


class AffineParticles(ABC):
    """
    A set of equally weighted affine frames and how they move.

    A frame maps a rectangle about the origin, of area 1 and the target's first aspect ratio, onto
    the target. Displacements are in units of the target's mean side, so that the noise doesn't
    depend on the target's size in pixels.

    All particles start at `first`, shape (3, 3). A step that takes a particle's centre more than
    one mean side beyond the border of the image is refused; `limit` is the image's (width, height)
    in pixels. So is one to a scale outside `scales`, (minimum, maximum), relative to the first.
    """

    states: Array

    def __init__(self, first: Array, count: int, limit: Array, rng: np.random.Generator,
                 scales: tuple[float, float] = _SCALES) -> None:
        self._rng = rng
        self._limit, self._scales = limit, scales
        self._first_scale = float(affine.scale(first))
        self.restart(first, count)

    @abstractmethod
    def restart(self, state: Array, count: int) -> None:
        """Put `count` particles at rest at a state, shape (3, 3)."""

    @abstractmethod
    def propose(self, dt: float, sigmas: Array, autoregression: float,
                move: Array | None = None, share: float = 0.0) -> None:
        """
        Move every particle by a time step of `dt` frames.

        `sigmas`, shape (6,), are the standard deviations of the noise per frame, in the order of
        `affine.from_coordinates`; `autoregression` is the coefficient a of the process, where
        there is one. A fraction `share` of the particles follows a measured movement in the image,
        p' = move p.
        """

    @abstractmethod
    def mean(self, weights: Array) -> Array:
        """Return the estimate, shape (3, 3), from normalised weights, shape (N,)."""

    def resample(self, weights: Array, count: int) -> None:
        """Draw `count` particles by their weights."""
        self._keep(systematic(weights, count, self._rng))

    @abstractmethod
    def _keep(self, chosen: NDArray[np.intp]) -> None:
        """Keep the chosen particles."""

    def _allowed(self, states: Array) -> NDArray[np.bool_]:
        """Tell which states have an allowed size, shape and position, shape (N,)."""
        scale = affine.scale(states)
        relative = scale / self._first_scale
        center = states[:, :2, 2]
        margin = scale[:, None]
        near = ((center > -margin) & (center < self._limit + margin)).all(1)
        return (
            near & (affine.determinant(states[:, :2, :2]) > 0) & (relative > self._scales[0])
            & (relative < self._scales[1]) & (affine.stretch(states) < _MAX_STRETCH))


class GroupParticles(AffineParticles):
    """
    Autoregressive dynamics on the affine group [Xiang, sec. 3.2; Kwon and Park 2010, eq. 12].

    X_t = X_{t-1} exp(a log(X_{t-2}^-1 X_{t-1}) + dW); with a time step dt the first term is
    multiplied by dt and the noise by sqrt(dt). Where the logarithm isn't defined (a step by more
    than half a turn) the particle has no velocity.
    """

    def restart(self, state: Array, count: int) -> None:
        self.states = np.repeat(state[None], count, 0)
        self.velocities: Array = np.zeros_like(self.states)

    def propose(self, dt: float, sigmas: Array, autoregression: float,
                move: Array | None = None, share: float = 0.0) -> None:
        """Move every particle; a share of them follows the measured movement instead."""
        before = self.states
        noise = np.sqrt(dt) * sigmas * self._rng.standard_normal((len(before), 6))
        drift = autoregression * dt * self.velocities
        base = before
        # particles come in the order of resampling, so that the followers are spread evenly
        count = 0 if move is None else round(share * len(before))
        followers = np.linspace(0, len(before) - 1, count).astype(int)
        if count:
            base = before.copy()
            base[followers] = move @ before[followers]
            drift[followers] = 0
        steps = (drift + affine.from_coordinates(noise)).clip(-_STEP_CLAMP, _STEP_CLAMP)
        states = base @ affine.exponential(steps)
        if count:
            # for all other particles the logarithm is the step just taken
            steps[followers] = affine.logarithm(
                affine.inverse(before[followers]) @ states[followers])
        refused = ~self._allowed(states)
        states[refused] = before[refused]
        steps[refused | ~np.isfinite(steps[:, 0, 0])] = 0
        self.states, self.velocities = states, steps / dt

    def mean(self, weights: Array) -> Array:
        return affine.group_mean(self.states, weights)

    def gather(self, place: Array, share: float) -> None:
        """Shift a share of the particles by one common offset, so that their mean is `place`."""
        count = round(share * len(self.states))
        if count:
            chosen = np.linspace(0, len(self.states) - 1, count).astype(int)
            self.states[chosen, :2, 2] += place - self.states[chosen, :2, 2].mean(0)

    def grow(self, factor: float) -> None:
        """Multiply the particles' scale by a factor."""
        self.states[:, :2, :2] *= factor

    def turn(self, angle: float) -> None:
        """Turn the particles by an angle, [rad], each about its own centre."""
        self.states[:, :2, :2] = affine.rotation(np.asarray(angle)) @ self.states[:, :2, :2]

    def _keep(self, chosen: NDArray[np.intp]) -> None:
        self.states, self.velocities = self.states[chosen], self.velocities[chosen]


class VectorParticles(AffineParticles):
    """
    Independent random walks of six geometric parameters [Ross2008].

    The estimate is the particle of the largest weight, as in that paper.
    """

    def restart(self, state: Array, count: int) -> None:
        """Put `count` particles at a state, shape (3, 3), that has no stretch."""
        vector = np.zeros(6)
        vector[0], vector[2] = np.log(affine.scale(state)), affine.angle(state)
        vector[4:] = state[:2, 2]
        self.vectors: Array = np.repeat(vector[None], count, 0)
        self.states = affine.from_vector(self.vectors)

    def propose(self, dt: float, sigmas: Array, autoregression: float,
                move: Array | None = None, share: float = 0.0) -> None:
        """Move every particle by noise alone: the arguments after `sigmas` are ignored."""
        noise = np.sqrt(dt) * sigmas * self._rng.standard_normal((len(self.vectors), 6))
        noise[:, 4:] *= np.exp(self.vectors[:, :1])
        noise[:, :2] = noise[:, :2].clip(-_STEP_CLAMP[0, 0], _STEP_CLAMP[0, 0])
        vectors = self.vectors + noise
        states = affine.from_vector(vectors)
        refused = ~self._allowed(states)
        vectors[refused], states[refused] = self.vectors[refused], self.states[refused]
        self.vectors, self.states = vectors, states

    def mean(self, weights: Array) -> Array:
        return np.array(self.states[int(weights.argmax())])

    def _keep(self, chosen: NDArray[np.intp]) -> None:
        self.vectors, self.states = self.vectors[chosen], self.states[chosen]
