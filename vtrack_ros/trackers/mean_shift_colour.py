"""ABMSPF as printed, on colours: the `paper` preset."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.ellipse_colours import EllipseColours
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.geometry.ellipse import axes_of_bandwidth, bounds_of_bandwidth, SIGMA, turned
from vtrack_ros.localisation.presence import state_after, unknown_covariance
from vtrack_ros.tracker import Estimate
from vtrack_ros.trackers.mean_shift_fusion import fused, Point, Settings

Array = NDArray[np.float64]

#: Frames of search after which it goes on in the whole frame [Yin2013, step 9].
_LOCAL_FRAMES = 10
#: Candidates of a local search.
_CANDIDATES = 20
#: At most so many samples of a frame are searched for blobs, and so many blobs are matched.
_SAMPLES, _BLOBS = 20000, 12
_SMALLEST, _LARGEST = 0.3, 4.0
#: The ratio of the axes changes by at most this factor in all.
_ASPECT = 1.6
#: Share of the measured change of form that is taken in one frame, where the target shares no
#: colour with its surroundings.
_GAIN = 0.4
#: An ellipse nearer to a circle than this ratio of the axes has no angle.
_ROUND = 1.15
#: Likeness at which on and off the target are even, and the width of the transition.
_EVEN_LIKENESS, _LIKENESS_SPREAD = 0.4, 0.1
#: Width of the likelihood that the covariance is of, and errors in units of the size.
_LIKELIHOOD_WIDTH, _CENTER_ERROR, _SIZE_ERROR = 0.2, 0.33, 0.3

_STENCIL = np.array([(0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)])


class ColourMeanShift:
    """
    Mean shift on a colour histogram, a bandwidth matrix, few particles, an extended search.

    Where the paper is silent or contradicts itself, this is what is done:

    - Search begins in the frame in which it's found necessary [Yin2013, steps 7 and 8].
    - When it fails, the mean of the particles about the forecast is reported, not the best of
      them, which is the likest piece of background.
    - The bandwidth matrix changes by at most `growth` a frame, stays within a range about the
      first one, and follows the less the more colours the target shares with its surroundings. It
      rests while the likeness is below the mean of `th` and `r`, and goes back to what it was at
      `th` when the target is lost: what an occluder leaves visible isn't the target's form.

    Parameters
    ----------
    rng : numpy.random.Generator
    settings : Settings
        Without particles this is ABMS, which searches the whole frame at once when it's lost.

    """

    def __init__(self, rng: np.random.Generator, settings: Settings) -> None:
        self._rng = rng
        self.settings = settings

    def start(self, frame: Frame, box: Box) -> Estimate:
        """Begin on a box: the target is the ellipse inscribed in it."""
        self._center = np.array(box.center)
        self._matrix = np.diag([box.width / 2, box.height / 2])
        self._first = self._trusted = self._matrix
        self._velocity = np.zeros(2)
        self._searched = 0.0
        self._angle, self._first_angle = 0.0, self._orientation(0.0)
        self._colours = EllipseColours.create(
            frame, self._center, self._matrix, self.settings.levels, self.settings.background)
        turns = np.arange(8) * np.pi / 4
        around = self._center + 1.6 * np.stack([np.cos(turns), np.sin(turns)], 1) @ self._matrix
        self._floor = min(float(self._score(frame, around).mean()), 0.9)
        return self._estimate(frame, 1.0, self._drawn(self._center))

    def update(self, frame: Frame, dt: float) -> Estimate:
        """Find the target in the next frame."""
        settings = self.settings
        forecast = self._center + dt * settings.inertia * self._velocity
        points = self._drawn(forecast)
        expected = self._center
        place, zeta = (None, 0.0) if self._searched else self._tracked(frame, points)
        if place is None or zeta <= settings.rejected:
            self._matrix = self._trusted
            place, zeta, expected = self._search(frame, dt, points)
        if place is None:
            self._searched += dt
            self._velocity *= 0.9**dt
            self._center = self._inside(expected, frame)
        else:
            step = (place - self._center) / dt
            self._velocity = np.zeros(2) if self._searched else (self._velocity + step) / 2
            self._searched = 0.0
            self._center = self._inside(place, frame)
            if zeta >= settings.accepted:
                self._trusted = self._matrix
            self._adapt(frame, zeta)
        return self._estimate(frame, zeta, points)

    def _tracked(self, frame: Frame, points: Array) -> tuple[Array | None, float]:
        """Return the fused place and the likeness there."""
        climbed = self._colours.climb(frame, self._center, self._matrix)
        scores = self._score(frame, np.concatenate([climbed[None], points]))
        zeta, scores = float(scores[0]), scores[1:]
        if not len(points):
            return climbed, zeta
        best = points[int(scores.argmax())]
        axis = axes_of_bandwidth(self._bandwidth)[0]
        place = fused(zeta, _point(climbed), _point(best), SIGMA, axis, self.settings)
        if place is None:
            return None, 0.0
        if zeta < self.settings.accepted:
            zeta = max(zeta, float(scores.max()))
        return np.array(place), zeta

    def _search(
            self, frame: Frame, dt: float, points: Array) -> tuple[Array | None, float, Array]:
        """
        Search in three stages [Yin2013, sec. 2.4].

        Returns
        -------
        place : ndarray, shape (2,), or None
            None where nothing is found.
        zeta : float
            The likeness there.
        expected : ndarray, shape (2,)
            What to report otherwise: the mean of the particles, weighted with their likeness
            [Yin2013, eq. 12].

        """
        if not len(points):
            return *self._likest(frame, self._blobs(frame)), self._center
        ahead = self._center + dt * self._velocity
        found, zeta = self._likest(frame, ahead[None])
        if found is not None:
            return found, zeta, found
        reach = self.settings.region * (1 + 0.2 * min(self._searched, 2 * _LOCAL_FRAMES))
        spread = self._rng.uniform(-1.0, 1.0, (_CANDIDATES, 2)) * np.diag(self._box_matrix)
        candidates = np.concatenate([ahead + reach * spread, points])
        scores = self._score(frame, candidates)
        found, zeta = self._matched(frame, candidates, scores)
        if found is None and self._searched > _LOCAL_FRAMES:
            found, zeta = self._likest(frame, self._blobs(frame))
        weights = scores[_CANDIDATES:] + 0.1
        return found, zeta, weights @ points / weights.sum()

    def _likest(self, frame: Frame, candidates: Array) -> tuple[Array | None, float]:
        if not len(candidates):
            return None, 0.0
        return self._matched(frame, candidates, self._score(frame, candidates))

    def _matched(
            self, frame: Frame, candidates: Array, scores: Array) -> tuple[Array | None, float]:
        """Climb from the likest candidates; return the likest place if it's like enough."""
        likest = [index for index in np.argsort(-scores)[:3]
                  if scores[index] > self.settings.rejected]
        if not likest:
            return None, 0.0
        places = np.array([self._colours.climb(frame, candidates[index], self._matrix)
                           for index in likest])
        scores = self._score(frame, places)
        best = int(scores.argmax())
        if scores[best] <= self.settings.rejected:
            return None, 0.0
        return places[best], float(scores[best])

    def _blobs(self, frame: Frame) -> Array:
        """Return the centres of the blobs of the target's colours, shape (N, 2)."""
        height, width = frame.shape[:2]
        stride = max(1, math.ceil(math.sqrt(height * width / _SAMPLES)))
        offset = int(self._rng.integers(stride))
        pixels = np.ascontiguousarray(frame[offset::stride, offset::stride])
        mask = (self._colours.likelihood(pixels) > 0.5).astype(np.uint8)
        area = np.pi * float(np.linalg.det(self._matrix)) / stride**2
        if area > 30:
            mask = cv2.erode(mask, np.ones((2, 2), np.uint8))
        mask = cv2.dilate(mask, np.ones((3, 3), np.uint8))
        _, _, statistics, centers = cv2.connectedComponentsWithStats(mask)
        areas = statistics[1:, cv2.CC_STAT_AREA]
        order = [index for index in np.argsort(-areas)[:_BLOBS] if areas[index] >= 0.15 * area]
        result: Array = centers[1:][order].reshape(-1, 2) * stride + offset
        return result

    def _adapt(self, frame: Frame, zeta: float) -> None:
        """Let bandwidth and colours follow the target, within bounds."""
        settings = self.settings
        if settings.growth and zeta >= (settings.rejected + settings.accepted) / 2:
            values, vectors = np.linalg.eigh(
                self._colours.growth(frame, self._center, self._matrix))
            gain = _GAIN * self._colours.separation**2
            values = np.clip(values**gain, 1 / (1 + settings.growth), 1 + settings.growth)
            self._matrix = bounded_frame(
                self._matrix @ (vectors * values) @ vectors.T, self._first)
            self._angle = self._orientation(self._angle + self._first_angle) - self._first_angle
        if settings.learning and zeta >= settings.accepted:
            self._colours = self._colours.learned(
                frame, self._center, self._matrix, settings.learning)

    def _score(self, frame: Frame, centers: Array) -> Array:
        return self._colours.coefficients(frame, centers, self._matrix)

    def _drawn(self, center: Array) -> Array:
        """Converge the particles on a place and redraw them about it [Yin2013, sec. 2.2]."""
        uniform = self._rng.uniform(-1.0, 1.0, (self.settings.particles, 2))
        return center + self.settings.region * uniform * np.diag(self._box_matrix)

    @property
    def _bandwidth(self) -> Array:
        result: Array = self._matrix @ self._matrix.T / SIGMA**2
        return result

    @property
    def _box_matrix(self) -> Array:
        """Return the half sides of the ellipse's axis-aligned bound, on the diagonal."""
        return np.diag(SIGMA * np.sqrt(np.diag(self._bandwidth)))

    def _orientation(self, previous: float) -> float:
        """Return the major axis's angle, near a previous one; the previous one of a circle."""
        major, minor, angle = axes_of_bandwidth(self._bandwidth)
        return turned(angle, previous) if major > _ROUND * minor else previous

    def _inside(self, center: Array, frame: Frame) -> Array:
        height, width = frame.shape[:2]
        return np.clip(center, 0.0, (width - 1.0, height - 1.0))

    def _estimate(self, frame: Frame, zeta: float, points: Array) -> Estimate:
        box = bounds_of_bandwidth(_point(self._center), self._bandwidth)
        offsets = _STENCIL @ self._matrix.T
        scores = self._score(frame, self._center + offsets)
        weights = np.exp(-(scores.max() - scores) / (2 * _LIKELIHOOD_WIDTH**2))
        covariance = np.zeros((4, 4))
        covariance[:2, :2] = (offsets * weights[:, None]).T @ offsets / weights.sum()
        covariance += unknown_covariance(_CENTER_ERROR, _SIZE_ERROR, box.area, self._searched)
        if self._searched:
            zeta = float(scores[0])
        likeness = (zeta - self._floor) / (1 - self._floor)
        confidence = 1 / (1 + math.exp(-(likeness - _EVEN_LIKENESS) / _LIKENESS_SPREAD))
        if self._searched:
            confidence = min(confidence, 0.3)
        sizes = np.broadcast_to([box.width, box.height], points.shape)
        return Estimate(
            box=box, angle=self._angle, covariance=covariance, confidence=confidence,
            state=state_after(self._searched),
            particles=np.concatenate([points, sizes], 1) if len(points) else None)


def bounded_frame(matrix: Array, first: Array) -> Array:
    """
    Return the frame within bounds about the first one.

    Parameters
    ----------
    matrix, first : ndarray, shape (2, 2), [px]
        The frame, and the one that it may not leave too far: a box's, which is diagonal.

    Returns
    -------
    ndarray, shape (2, 2), [px]
        Its axes' mean is from 0.3 to 4 times the first one's, and the axes' ratio changed by a
        factor of at most 1.6.

    """
    left, axes, right = np.linalg.svd(matrix)
    reference = np.sort(first.diagonal())[::-1]
    ratio = reference[0] / reference[1]
    mean = math.sqrt(axes[0] * axes[1])
    usual = math.sqrt(reference[0] * reference[1])
    mean = min(max(mean, _SMALLEST * usual), _LARGEST * usual)
    elongation = min(max(axes[0] / axes[1], max(ratio / _ASPECT, 1.0)), ratio * _ASPECT)
    axes = mean * np.array([math.sqrt(elongation), 1 / math.sqrt(elongation)])
    result: Array = (left * axes) @ right
    return result


def _point(place: Array) -> Point:
    return float(place[0]), float(place[1])
