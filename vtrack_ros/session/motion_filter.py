"""The target's velocity: a Kalman filter on the boxes that any tracker measures."""

from collections import deque
from dataclasses import dataclass
import math

import numpy as np

from vtrack_ros.estimation import (
    Gaussian, GaussianNoise, KalmanFilter, mix, moments, switching, VelocityHypotheses)
from vtrack_ros.frame import Array
from vtrack_ros.geometry import Box
from vtrack_ros.tracker import Estimate

#: Time [s] after the latest measurement beyond which the motion counts as unknown.
LONGEST_FORECAST = 0.5
#: Number of the latest estimates that are queued until the motion is requested.
_BACKLOG = 30
#: Of the two hypotheses (steady, erratic): spectral density of the white acceleration, in mean
#: sides^2/s^3; and time constant of the velocity's exponential decay, in seconds.
_DENSITIES, _FADING = (2.0, 500.0), (math.inf, 0.1)
#: Time constant of switching between the hypotheses, in seconds.
_SWITCHING = 0.33
#: Unit of the logarithms of the size: a change by this counts like one mean side of the centre.
_SIZE_SHARE = 0.5
#: Standard deviation of the initial, unknown velocity, in mean sides/s.
_FIRST_VELOCITY = 3.0
#: Share of a tracker's variance that is independent from frame to frame: the measurement noise.
#: The rest changes little between frames, and so doesn't look like motion.
_JITTER_SHARE = 0.05
#: Standard deviation of the jitter that is added for every tracker, in mean sides.
_LEAST_JITTER = 0.01
#: Variances assumed for a tracker that gives none, in the units of the state.
_ASSUMED_VARIANCES = np.array([0.005, 0.005, 0.04, 0.04])
#: Squared Mahalanobis distance of an innovation beyond which it's a jump, not motion: exceeded
#: once in a million, chi-square with 2 degrees of freedom.
_JUMP = 27.6


@dataclass(frozen=True)
class Motion:
    """
    Where the target is and how it moves.

    `velocity`, shape (4,), [px/s], is that of (centre x, centre y, width, height); `covariance`,
    shape (8, 8), is over those four, [px], and their velocities, [px/s]; NaN: unknown.
    """

    box: Box
    velocity: Array
    covariance: Array


class MotionFilter:
    """
    A Kalman filter on measured boxes in real time, the same for every tracker.

    The state is the centre in mean sides of the target, the logarithms of its size, and their
    velocities. Two hypotheses interact [Blom1988]: a target at nearly constant velocity, and one
    that moves erratically. So the assumed acceleration, and the covariance, fit the target.

    Frames without a measurement are skipped. The filter restarts where a target is found again at
    a place that constant velocity doesn't explain, or jumps further than either hypothesis
    explains: a jump is no velocity.
    """

    def __init__(self) -> None:
        self._filter = KalmanFilter(VelocityHypotheses(4, _DENSITIES, _FADING))
        self.restart()

    def restart(self) -> None:
        """Forget the target."""
        self._pending: deque[tuple[Estimate, int]] = deque(maxlen=_BACKLOG)
        self._beliefs: Gaussian | None = None
        self._weights = np.full(len(_DENSITIES), 1 / len(_DENSITIES))
        self._measured = self._timed = self._coasted = False
        self._side, self._stamp = 1.0, 0

    def add(self, estimate: Estimate, stamp: int) -> None:
        """Queue a frame's estimate, stamped in ns; it's filtered when the motion is requested."""
        self._pending.append((estimate, stamp))

    def motion(self, age: float = 0.0) -> Motion | None:
        """
        Return the motion `age` seconds after the latest frame.

        None if that has no measurement, or if its stamp is 0 or that of the one measured before.

        The measured box, with the tracker's covariance, is extrapolated with the velocity.
        """
        while self._pending:
            self._update(*self._pending.popleft())
        if self._beliefs is None or not (self._measured and self._timed):
            return None
        mean, covariance = self._beliefs.mean.copy(), self._beliefs.covariance.copy()
        mean[:, :4], covariance[:, :4, :4] = self._place, self._error
        beliefs = Gaussian(mean, covariance)
        state, covariance = moments(
            self._filter.predict(beliefs, age) if age else beliefs, self._weights)
        box = Box.from_center(*self._side * state[:2], *np.exp(_SIZE_SHARE * state[2:4]))
        units = _units(self._side, box)
        velocity = units * state[4:]
        slope = np.diag([*units, *units])
        # the size's velocity in pixels is proportional to the size, so it varies with that
        slope[[6, 7], [2, 3]] = _SIZE_SHARE * velocity[2:]
        covariance = slope @ covariance @ slope.T
        return Motion(box, velocity, covariance if self._known else covariance * math.nan)

    def _update(self, estimate: Estimate, stamp: int) -> None:
        self._measured = estimate.measured
        if not estimate.measured:
            self._coasted = True
            return
        box = estimate.upright
        side = math.sqrt(box.area)
        error, self._known = _error(estimate, _units(side, box))
        least = _LEAST_JITTER**2 * np.eye(4)
        before, dt = self._side, (stamp - self._stamp) / 1e9
        # at first 0, the stamp of images without one
        self._timed = stamp != self._stamp
        self._side, self._stamp, self._error = side, stamp, error + least
        self._place = np.array([*np.divide(box.center, side),
                                *np.log([box.width, box.height]) / _SIZE_SHARE])
        jitter = GaussianNoise.from_covariance(_JITTER_SHARE * error + least)
        if not (0 < dt <= LONGEST_FORECAST and self._follow(jitter, before / side, dt)):
            self._begin(jitter)
        self._coasted = False

    def _follow(self, jitter: GaussianNoise, scale: float, dt: float) -> bool:
        """Filter the latest place, after `dt` seconds; False, unchanged, if it's a jump."""
        if self._beliefs is None:
            return False
        scales = np.array([scale, scale, 1.0, 1.0] * 2)
        beliefs, weights = mix(
            Gaussian(self._beliefs.mean * scales,
                     self._beliefs.covariance * np.outer(scales, scales)),
            self._weights, switching(len(self._weights), dt, _SWITCHING))
        prior = self._filter.predict(beliefs, dt)
        # squared Mahalanobis distances of centre and size, (K, 2), by the inverse of each 2 x 2
        innovation = self._place - prior.mean[:, :4]
        spread = prior.covariance[:, :4, :4] + jitter.covariance
        variance, mixed = spread.diagonal(axis1=1, axis2=2), spread[:, [0, 2], [1, 3]]
        (dx, dy), (xx, yy) = ((of[:, ::2], of[:, 1::2]) for of in (innovation, variance))
        determinant = xx * yy - mixed * mixed
        distance = (yy * dx * dx - 2 * mixed * dx * dy + xx * dy * dy) / determinant
        furthest = distance.max(axis=1)
        # the negation rejects NaN as well
        if not (furthest[0] if self._coasted else furthest.min()) <= _JUMP:
            return False
        # log-likelihood of the centre alone: the size isn't measured in every frame
        evidence = -0.5 * (distance[:, 0] + np.log(determinant[:, 0]))
        weights = weights * np.exp(evidence - evidence.max())
        self._weights = weights / weights.sum()
        self._beliefs = self._filter.update(prior, self._place, error=jitter).posterior
        return True

    def _begin(self, jitter: GaussianNoise) -> None:
        """Begin at the latest place, at rest."""
        count = len(_DENSITIES)
        covariance = _FIRST_VELOCITY**2 * np.eye(8)
        covariance[:4, :4] = jitter.covariance
        self._beliefs = Gaussian.from_moments(
            np.tile([*self._place, 0.0, 0.0, 0.0, 0.0], (count, 1)), covariance)
        self._weights = np.full(count, 1 / count)


def _error(estimate: Estimate, units: Array) -> tuple[Array, bool]:
    """Return a tracker's covariance in the state's units, True; or the assumed one, False."""
    error = estimate.covariance / np.outer(units, units)
    if np.isfinite(error).all() and np.linalg.eigvalsh(error)[0] > -_LEAST_JITTER**2:
        return error, True
    return np.diag(_ASSUMED_VARIANCES), False


def _units(side: float, box: Box) -> Array:
    """Return how many pixels one unit of each of the four state components is, for a box."""
    return np.array([side, side, _SIZE_SHARE * box.width, _SIZE_SHARE * box.height])
