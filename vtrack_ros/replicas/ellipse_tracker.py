"""ABMS: mean shift on an ellipse's colours, with an adaptive bandwidth."""

from dataclasses import dataclass
import math

import cv2
import numpy as np

from vtrack_ros.frame import Array, Frame, Point
from vtrack_ros.geometry import Box
from vtrack_ros.geometry.ellipse import (
    axes_of_bandwidth, bounded, bounds_of_bandwidth, SIGMA, turned)
from vtrack_ros.localisation.presence import logistic, state_after, unknown_covariance
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.replicas.ellipse_colours import EllipseColours
from vtrack_ros.tracker import Estimate, Tracker

#: Largest number of a frame's pixels that are searched for blobs, and of blobs that are matched.
_SAMPLES, _BLOBS = 20000, 12
#: Largest number of iterations of eq. 11 as printed; a change, relative to the axes, that ends it.
_ITERATIONS, _STILL = 10, 0.01
#: Range of the axes' mean relative to the first one; largest factor by which their ratio changes.
_SIZES, _ASPECT = (0.3, 4.0), 1.6
#: Share of the measured change of form (on a logarithmic scale) that is applied per frame, if the
#: target shares no colour with its surroundings.
_GAIN = 0.4
#: Ratio of the axes below which an ellipse counts as a circle, without an angle.
_ROUND = 1.15
#: Similarity at which the confidence is 0.5, and the width of its logistic function.
_EVEN, _WIDTH = 0.4, 0.1
#: Width of the likelihood for the covariance; added standard deviations (centre, size), in sides.
_LIKELIHOOD_WIDTH, _CENTER_ERROR, _SIZE_ERROR = 0.2, 0.33, 0.3

_STENCIL = np.array([(0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)])

_MEAN_SHIFT = ParameterTable([
    Parameter('rejected', 0.5, 'Similarity threshold r: at r or below, the target counts as '
              'hidden and is searched for.', 0.0, 1.0),
    Parameter('growth', 0.1, 'Largest relative change of an axis per frame; 0: none; ignored with '
              'as_printed.', 0.0, 0.5),
    Parameter('levels', 16, 'Levels per colour channel. Takes effect with the next target or '
              '~/reinit.', choices=(8, 16)),
    Parameter('background', True, 'Reduce the weight of colours that also surround the target; '
              'off with as_printed. Takes effect with the next target or ~/reinit.'),
    Parameter('learning', 0.0, 'Learning rate of colours at high similarity; 0: none.', 0.0, 1.0),
    Parameter('as_printed', False, 'The steps as printed: no weights for the background, one step '
              'of mean shift, eq. 11 iterated, no particle at th or below, fusion after a search. '
              'Takes effect with the next target or ~/reinit.'),
])


@dataclass(frozen=True)
class Match:
    """A centre that is like the target, shape (2,), [px], and the similarity there [eq. 5]."""

    place: Array
    zeta: float


class MeanShiftReplica(Tracker):
    """
    ABMS: mean shift with an adaptive bandwidth, the baseline of [Yin2013, sec. 1.1].

    The target is the ellipse of eq. 8, compared by its colours (eqs 1, 4, 5). Where the similarity
    falls to r, it searches the whole frame at once for blobs of these colours. Misprints, always
    corrected, for the method can't be run with them: eq. 2's denominator lacks the weights and has
    a factor `s` too many; eq. 10 has `h11 - h12` for `h11 - h22`.

    Otherwise than in the paper:

    - Colours that the first surroundings share are weighted down, in the manner of Comaniciu et
      al. (2003); without this the bandwidth follows the background (`background`).
    - Eq. 11 lets an unchanged target grow by sigma^2 / 4: its moment is taken relative to the
      first one. The matrix changes once, by at most `growth`, per frame, and less the more colours
      the target shares with its surroundings. It's constant while the similarity is below the mean
      of th and r, and reset to the last one with similarity th or more when the target is lost:
      the part that an occluder leaves visible isn't the target's form.
    - Mean shift goes on to the maximum, ten steps at most, instead of one step (step 3).
    - The step that eq. 16 repeats is smoothed, and forgotten after a search.

    `as_printed` undoes all: no weights, one step of mean shift, at whose end the similarity is
    measured (step 3), eq. 11 iterated there (step 4), the last step repeated. Readings: y_ms is
    the end of that one step, for ABMS alone too, which has no steps of its own in print; eq. 11
    ends when the axes change by less than 1 %, or after ten iterations; a search is made with the
    matrix of the frame before (sec. 2.4), which stays if the target is found. The bounds relative
    to the first matrix stay, or an ellipse on a background of the same colours would grow without
    end.
    """

    NAME = 'abms_paper'
    SUMMARY = 'adaptive-bandwidth mean shift (ABMS), the baseline of Yin et al. 2013'
    PARAMETERS = _MEAN_SHIFT
    #: Source of the last update's place: 'track', a stage of the search, or 'none'.
    stage = 'track'

    def _configure(self) -> None:
        values = self._parameters
        self._rejected = float(values['rejected'])
        self._accepted = float(values.get('accepted', 0.8))

    def _start(self, frame: Frame, box: Box) -> Estimate:
        values = self._parameters
        self._as_printed = bool(values['as_printed'])
        self._center = np.array(box.center)
        self._matrix = np.diag([box.width / 2, box.height / 2])
        self._first = self._trusted = self._matrix
        self._velocity = np.zeros(2)
        self._searched_frames = 0.0
        self._angle, self._first_angle = 0.0, self._orientation(0.0)
        self._colours = EllipseColours.create(
            frame, self._center, self._matrix, int(values['levels']),
            bool(values['background']) and not self._as_printed)
        turns = np.arange(8) * np.pi / 4
        around = self._center + 1.6 * np.stack([np.cos(turns), np.sin(turns)], 1) @ self._matrix
        self._floor = min(float(self._score(frame, around).mean()), 0.9)
        return self._estimate(frame, 1.0, self._drawn(0.0))

    def _update(self, frame: Frame, dt: float) -> Estimate:
        points, before = self._drawn(dt), self._matrix
        self.stage = 'track'
        match = None if self._searched_frames else self._tracked(frame, points)
        expected = self._center
        # nothing crosses the picture in less than a frame; a tiny `dt` would give any velocity
        limit = max(frame.shape[:2])
        if match is None or match.zeta <= self._rejected:
            self._matrix = before if self._as_printed else self._trusted
            match, expected = self._search(frame, dt, points)
        if match is None:
            self.stage = 'none'
            self._searched_frames += dt
            self._velocity = (
                np.clip((expected - self._center) / dt, -limit, limit) if self._as_printed
                else self._velocity * 0.9**dt)
            self._center = _inside(expected, frame)
            return self._estimate(frame, 0.0, points)
        step = (match.place - self._center) / dt
        if not self._as_printed:
            step = np.zeros(2) if self._searched_frames else (self._velocity + step) / 2
        self._velocity = np.clip(step, -limit, limit)
        self._searched_frames = 0.0
        self._center = _inside(match.place, frame)
        if match.zeta >= self._accepted:
            self._trusted = self._matrix
        self._adapt(frame, match.zeta)
        return self._estimate(frame, match.zeta, points)

    def _drawn(self, dt: float) -> Array:
        """Return particles about the target's predicted place after `dt`, shape (N, 2)."""
        return np.zeros((0, 2))

    def _tracked(self, frame: Frame, points: Array) -> Match | None:
        """Return the match near the last place; None if mean shift and particles contradict."""
        climbed = self._climbed(frame)
        zeta = float(self._score(frame, climbed[None])[0])
        if self._as_printed:
            self._matrix = self._iterated(frame, climbed)
        return Match(climbed, zeta)

    def _climbed(self, frame: Frame) -> Array:
        """Return mean shift's place, (2,): a maximum, or as printed the end of one step."""
        return self._colours.climb(
            frame, self._center, self._matrix, 1 if self._as_printed else 10)

    def _iterated(self, frame: Frame, center: Array) -> Array:
        """Return the matrix at the end of the iteration of eq. 11 as printed (step 4)."""
        matrix = self._matrix
        for _ in range(_ITERATIONS):
            before = matrix
            matrix = bounded(
                matrix @ self._colours.printed_growth(frame, center, matrix), self._first, _SIZES,
                _ASPECT)
            if np.abs(matrix - before).max() < _STILL * np.abs(matrix).max():
                break
        return matrix

    def _search(self, frame: Frame, dt: float, points: Array) -> tuple[Match | None, Array]:
        """Search for the target; also return the place, shape (2,), to report if it fails."""
        self.stage = 'everywhere'
        return self._best_match(frame, self._blobs(frame)), self._center

    def _best_match(self, frame: Frame, candidates: Array) -> Match | None:
        if not len(candidates):
            return None
        return self._matched(frame, candidates, self._score(frame, candidates))

    def _matched(self, frame: Frame, candidates: Array, scores: Array) -> Match | None:
        """Climb from the three best candidates; return the best place if it scores above r."""
        starts = [index for index in np.argsort(-scores)[:3] if scores[index] > self._rejected]
        if not starts:
            return None
        places = np.array([self._colours.climb(frame, candidates[index], self._matrix)
                           for index in starts])
        scores = self._score(frame, places)
        best = int(scores.argmax())
        return Match(places[best], float(scores[best])) if scores[best] > self._rejected else None

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
        growth, rate = float(self._parameters['growth']), float(self._parameters['learning'])
        center, matrix = self._center, self._matrix
        followed = growth > 0 and zeta >= (self._rejected + self._accepted) / 2
        if followed and not self._as_printed:
            values, vectors = np.linalg.eigh(self._colours.growth(frame, center, matrix))
            gain = _GAIN * self._colours.separation**2
            values = np.clip(values**gain, 1 / (1 + growth), 1 + growth)
            self._matrix = bounded(
                matrix @ (vectors * values) @ vectors.T, self._first, _SIZES, _ASPECT)
        if followed or self._as_printed:
            self._angle = self._orientation(self._angle + self._first_angle) - self._first_angle
        if rate and zeta >= self._accepted:
            self._colours = self._colours.updated(frame, center, self._matrix, rate)

    def _score(self, frame: Frame, centers: Array) -> Array:
        return self._colours.coefficients(frame, centers, self._matrix)

    @property
    def _bandwidth(self) -> Array:
        return self._matrix @ self._matrix.T / SIGMA**2

    @property
    def _half_sides(self) -> Array:
        """Return the half sides of the ellipse's axis-aligned bound, shape (2,)."""
        return SIGMA * np.sqrt(np.diag(self._bandwidth))

    def _orientation(self, previous: float) -> float:
        """Return the major axis's angle nearest to a previous one, which a circle keeps."""
        major, minor, angle = axes_of_bandwidth(self._bandwidth)
        return turned(angle, previous) if major > _ROUND * minor else previous

    def _estimate(self, frame: Frame, zeta: float, points: Array) -> Estimate:
        searched = self._searched_frames
        box = bounds_of_bandwidth(as_point(self._center), self._bandwidth)
        offsets = _STENCIL @ self._matrix.T
        scores = self._score(frame, self._center + offsets)
        weights = np.exp(-(scores.max() - scores) / (2 * _LIKELIHOOD_WIDTH**2))
        covariance = np.zeros((4, 4))
        covariance[:2, :2] = (offsets * weights[:, None]).T @ offsets / weights.sum()
        covariance += unknown_covariance(_CENTER_ERROR, _SIZE_ERROR, box.area, searched)
        similarity = ((float(scores[0]) if searched else zeta) - self._floor) / (1 - self._floor)
        confidence = logistic((similarity - _EVEN) / _WIDTH)
        sizes = np.broadcast_to([box.width, box.height], points.shape)
        return Estimate(
            box=box, angle=self._angle, covariance=covariance,
            confidence=min(confidence, 0.3) if searched else confidence,
            state=state_after(searched),
            particles=np.concatenate([points, sizes], 1) if len(points) else None)


def _inside(center: Array, frame: Frame) -> Array:
    return np.clip(center, 0.0, np.subtract(frame.shape[1::-1], 1.0))


def as_point(place: Array) -> Point:
    """Return a place, shape (2,), as (x, y)."""
    return float(place[0]), float(place[1])
