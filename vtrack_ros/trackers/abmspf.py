"""ABMSPF: adaptive-bandwidth mean shift fused with few particles."""

from dataclasses import replace

import numpy as np

from vtrack_ros.frame import Array, Frame, Point
from vtrack_ros.geometry import Box
from vtrack_ros.geometry.affine import rotation
from vtrack_ros.geometry.ellipse import SIGMA
from vtrack_ros.localisation import ResponseMap
from vtrack_ros.localisation.filter_parameters import LOCALISER, MEAN_SHIFT_PARTICLES
from vtrack_ros.localisation.mean_shift import climb, climbing_weights, fuse
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Estimate
from vtrack_ros.trackers.localised_tracker import LocalisedTracker

#: Mean shift with the coarse and with the fine bandwidth: largest number of iterations, and step,
#: in cells, below which it has converged.
_COARSE_STEPS, _COARSE_TOLERANCE = 8, 0.1
_FINE_STEPS, _FINE_TOLERANCE = 8, 0.02
#: Fine bandwidth, in target sizes: half the standard deviation of the response's peak.
_FINE = 1 / 32
#: Response r as a likelihood: its logarithm is -_LIKELIHOOD_GAIN * (peak - r) / peak.
_LIKELIHOOD_GAIN = 20.0


class MeanShiftParticleFilter(LocalisedTracker):
    """
    Mean shift and few particles on the response map, in place of pixels' colours [Yin2013].

    As in the paper, mean shift gives y_ms, the best particle gives y_pf, and the two are fused by
    their distance and the similarity zeta (eqs 13-15). Three things differ. The map that is
    climbed isn't the colour histogram's weights, but the response of a discriminative model; zeta
    is the response as a share of the usual one. The climb starts at the place that the guided
    search has found, which is also the result where fusion gives none. And y_pf isn't the best
    particle's own place, but the maximum that mean shift climbs to from there. The particles are
    drawn about the tracker's own forecast, which repeats a part of the last steps' moving average.

    The bandwidth follows the size that the model measures, and the rotation is the model's, too:
    the second moments of a foreground map turn with limbs and background rather than the target.
    """

    NAME = 'abmspf'
    SUMMARY = 'adaptive-bandwidth mean shift with particles (ABMSPF)'
    PARAMETERS = ParameterTable([
        Parameter('rejected', 0.5, "Similarity threshold r: if mean shift's result is not more "
                  "similar than r, the best particle's is used without comparing the two.",
                  0.0, 1.0),
    ]) + MEAN_SHIFT_PARTICLES + LOCALISER

    def _start(self, frame: Frame, box: Box) -> Estimate:
        self._begin(frame, box)
        self._velocity = np.zeros(2)
        return self._localiser.estimate(
            np.diag([1.0, 1.0, 0.0, 0.0]), self._boxes(self._drawn(box.center)))

    def _update(self, frame: Frame, dt: float) -> Estimate:
        self._adjust()
        localiser, values = self._localiser, self._parameters
        before = localiser.center
        step = dt * float(values['inertia']) * self._velocity
        forecast = before[0] + float(step[0]), before[1] + float(step[1])
        found = self._search.search(frame, dt, forecast)
        response, start = found.response, found.place
        weights = climbing_weights(response.values)
        climbed = self._climbed(response, weights, start)
        points = self._drawn(forecast)
        best = points[int(response.sample(points).argmax())]
        zeta = min(response.sample_one(climbed) / localiser.response_unit, 1.0)
        place = fuse(
            zeta, climbed, self._climbed(response, weights, (best[0], best[1])), SIGMA,
            max(localiser.size) / 2, float(values['accepted']), float(values['rejected']))
        # with a distractor near, mean shift would leave the target for it
        center = (start if place is None or found.distractors
                  else response.unless_dominated(place, start))
        covariance = np.zeros((4, 4))
        covariance[:2, :2] = _spread(response, center)
        elsewhere = localiser.update(frame, replace(found, place=center), dt)
        self._search.follow(dt, elsewhere)
        if elsewhere:
            # the velocity and the covariance at the old place don't hold at the new one
            self._velocity, covariance = np.zeros(2), np.zeros((4, 4))
            points += np.subtract(localiser.center, forecast)
        else:
            step = np.subtract(localiser.center, before) / dt
            self._velocity = (self._velocity + step) / 2
        return localiser.estimate(covariance, self._boxes(points))

    def _climbed(self, response: ResponseMap, weights: Array, start: Point) -> Point:
        """Climb from a place with the target's bandwidth, then with the fine one."""
        size, cell = np.array(self._localiser.size), response.window.cell
        place = response.cells(np.array([start]))[0]
        place = climb(weights, place, size / (2 * SIGMA) / cell, _COARSE_STEPS, _COARSE_TOLERANCE)
        place = climb(
            weights, place, np.maximum(size * _FINE / cell, 0.6), _FINE_STEPS, _FINE_TOLERANCE)
        return response.place(place)

    def _drawn(self, center: Point) -> Array:
        """Redraw the particles uniformly about a place [Yin2013, sec. 2.2]."""
        uniform = self._rng.uniform(-1.0, 1.0, (int(self._parameters['particles']), 2))
        reach = float(self._parameters['region']) * np.array(self._localiser.size) / 2
        return np.array(center) + reach * uniform


def _spread(response: ResponseMap, center: Point) -> Array:
    """Return the covariance of the place under the response taken as a likelihood, [px^2]."""
    # relative to the peak, whose likelihood is 1: small and negative responses do no harm
    excess = (response.values - response.peak).astype(np.float64)
    likelihood = np.exp(_LIKELIHOOD_GAIN / max(response.peak, 1e-6) * excess)
    likelihood /= likelihood.sum()
    places = [(np.arange(count) - at) * cell for count, at, cell in zip(
        reversed(likelihood.shape), response.cells(np.array([center]))[0], response.window.cell)]
    in_x, in_y = likelihood.sum(0), likelihood.sum(1)
    # about the mean first: about a place far from it, the squares would swamp the spread
    mean = np.array([in_x @ places[0], in_y @ places[1]])
    x, y = (place - middle for place, middle in zip(places, mean))
    cross = y @ likelihood @ x
    spread = np.array([[in_x @ x**2, cross], [cross, in_y @ y**2]])
    spread += mean[:, np.newaxis] * mean
    turn = rotation(np.asarray(response.window.angle))
    turned: Array = turn @ spread @ turn.T
    return turned
