"""ABMSPF's idea on strong evidence: the `default` preset."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.geometry.ellipse import SIGMA
from vtrack_ros.localisation import Localiser, ResponseMap
from vtrack_ros.localisation.mean_shift import climb, climbing_weights
from vtrack_ros.tracker import Estimate
from vtrack_ros.trackers.mean_shift_fusion import fused, Point, Settings

#: Steps of a climb at most, and the step in cells that ends it, with either bandwidth.
_COARSE_STEPS, _COARSE_TOLERANCE = 8, 0.1
_FINE_STEPS, _FINE_TOLERANCE = 8, 0.02
#: Bandwidth of the last steps, in target sizes: half the width of the evidence's peak.
_FINE = 1 / 32
#: Evidence as a likelihood: so many times the share of the highest evidence that is missing is
#: the negative logarithm.
_SHARPNESS = 20.0


class EvidenceMeanShift:
    """
    Mean shift and few particles on a map of evidence, instead of on pixels' colours.

    As in the paper [Yin2013, sec. 2], a climb from the last place gives y_ms, the best particle
    gives y_pf, the two are fused by eqs 13-15, particles converge on the result and are redrawn
    about it. What differs is what is climbed: not the colour histogram's weights, but the
    evidence of a discriminative model, of which zeta is the share of its running mean. When the
    fused place is null, the extended search starts with the best place of the window.

    The bandwidth follows the size that the model finds. The angle is 0: the second moments of a
    foreground map turn with limbs and background rather than with the target.

    Parameters
    ----------
    rng : numpy.random.Generator
    settings : Settings

    """

    def __init__(self, rng: np.random.Generator, settings: Settings) -> None:
        self._rng = rng
        self.settings = settings

    def start(self, frame: Frame, box: Box) -> Estimate:
        """Begin on a box."""
        self._target = Localiser(frame, box.center, (box.width, box.height), self._rng)
        self._velocity = np.zeros(2)
        covariance = np.diag([1.0, 1.0, 0.0, 0.0])
        return self._target.estimate(covariance, particles=self._boxes(self._drawn(box.center)))

    def update(self, frame: Frame, dt: float) -> Estimate:
        """Find the target in the next frame."""
        target, settings = self._target, self.settings
        center_before = target.center
        sighting = target.localise(frame, center_before)
        weights = climbing_weights(sighting.values)
        usual = target.usual_response
        climbed = self._climbed(sighting, weights, center_before)
        center = climbed
        points = None
        if settings.particles:
            points = self._drawn(center_before) + dt * settings.inertia * self._velocity
            scores = sighting.sample(points)
            best = points[int(scores.argmax())]
            best = self._climbed(sighting, weights, (best[0], best[1]))
            zeta = min(sighting.sample_one(climbed) / usual, 1.0)
            place = fused(zeta, climbed, best, SIGMA, max(target.size) / 2, settings)
            center = sighting.center if place is None else place
        center = sighting.unless_dominated(center)
        covariance = np.zeros((4, 4))
        covariance[:2, :2] = self._spread(sighting, center)
        found_elsewhere = target.update(frame, sighting, center, dt)
        step = np.subtract(target.center, center_before) / dt
        self._velocity = np.zeros(2) if found_elsewhere else (self._velocity + step) / 2
        return target.estimate(
            covariance, particles=None if points is None else self._boxes(points))

    def _climbed(self, sighting: ResponseMap, weights: NDArray[np.float64], start: Point) -> Point:
        """Climb from a place with the target's bandwidth, then with the peak's."""
        size, cell = self._target.size, sighting.window.cell
        coarse = np.array(size) / (2 * SIGMA) / cell
        fine = np.maximum(np.array(size) * _FINE / cell, 0.6)
        place = sighting.cells(np.array([start]))[0]
        place = climb(weights, place, coarse, _COARSE_STEPS, _COARSE_TOLERANCE)
        place = climb(weights, place, fine, _FINE_STEPS, _FINE_TOLERANCE)
        return sighting.place(place)

    def _spread(self, sighting: ResponseMap, center: Point) -> NDArray[np.float64]:
        """Return the covariance of the place under the evidence taken as a likelihood, [px^2]."""
        rows, columns = sighting.values.shape
        x, y = np.arange(columns, dtype=np.float64), np.arange(rows, dtype=np.float64)
        likelihood = np.exp(_SHARPNESS * (sighting.values / max(sighting.peak, 1e-6) - 1))
        at_x, at_y = sighting.cells(np.array([center]))[0]
        x, y = (x - at_x) * sighting.window.cell[0], (y - at_y) * sighting.window.cell[1]
        in_x, in_y = likelihood.sum(0), likelihood.sum(1)
        total = in_x.sum()
        cross = float(y @ likelihood @ x) / total
        return np.array([[in_x @ x**2 / total, cross], [cross, in_y @ y**2 / total]])

    def _drawn(self, center: Point) -> NDArray[np.float64]:
        """Redraw the particles uniformly about a place [Yin2013, sec. 2.2]."""
        size = np.array(self._target.size)
        uniform = self._rng.uniform(-1.0, 1.0, (self.settings.particles, 2))
        return np.array(center) + self.settings.region * size / 2 * uniform

    def _boxes(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        size = np.broadcast_to(self._target.size, points.shape)
        return np.concatenate([points, size], 1)
