"""APPF: a particle filter on the affine group, steered by the response."""

from dataclasses import replace

import numpy as np

from vtrack_ros.appearance.affine_likelihood import AffineLikelihood
from vtrack_ros.estimation import spread_about
from vtrack_ros.estimation.affine_particles import GroupParticles
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import affine, Box
from vtrack_ros.localisation import Found
from vtrack_ros.localisation.filter_parameters import (
    AFFINE, AFFINE_GROUP, AFFINE_NOISES, LOCALISER)
from vtrack_ros.localisation.localiser import LARGEST, SMALLEST
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Estimate
from vtrack_ros.trackers.localised_tracker import LocalisedTracker

#: Exponent of the paper's likelihood in the product with the response's: both see the same pixels,
#: and a product of terms that aren't independent is overconfident.
_TEMPERED = 0.3
#: Share of the usual response below which the particles' rotation is tried for the search window.
_LOW_RESPONSE = 0.9
#: Least difference of the particles' rotation from the localiser's for it to be tried, [rad].
_LEAST_TURN = 0.06
#: Least ratio of the peak with the particles' rotation to the peak without for it to be used.
_LEAST_GAIN = 1.05
#: Samples along each side of a patch.
_SIDE = 24
#: Bounds of the particles' scale: beyond the localiser's, which they follow.
_SCALES = SMALLEST / 2, 2 * LARGEST


class AffineParticleFilter(LocalisedTracker):
    """
    APPF: autoregression on the affine group, weighted by colours and a subspace [Xiang].

    In the paper a share of the particles moves by a pose measured from keypoints. Here the pose is
    measured otherwise: a share of the particles is moved to the place that the guided search
    finds, and all turn by the rotation of the target's own points. Keypoints beside these helped a
    little where the picture rolls far and nowhere else, for a third of the computing time
    (decision 43). `appf_paper` has them.

    The response of a discriminative model is one more term of the likelihood. Place, size and box
    are the model's, since the response's maximum is more exact than a mean over six dimensions.
    Rotation and shape are the particles', and the search window takes the particles' rotation if
    that gives a higher response. If the target is found elsewhere, the particles restart there.
    """

    NAME = 'appf'
    SUMMARY = 'affine-group particle filter with an appearance subspace (APPF)'
    PARAMETERS = AFFINE + ParameterTable([
        Parameter('temperature', 0.1, 'Temperature of the likelihood exp(response / (temperature '
                  '* r)), where r is the running mean of the response at the target. A larger '
                  'value weights the particles more equally.', 0.01, 1.0),
        Parameter('response_share', 0.3, 'Fraction of the particles that are shifted to the '
                  'position found by the localiser.', 0.0, 1.0),
    ]) + AFFINE_GROUP + LOCALISER

    def _configure(self) -> None:
        values = self._parameters
        self._sigmas = np.array([float(values[name]) for name in AFFINE_NOISES])
        self._widths = float(values['colour_sigma']), float(values['subspace_sigma'])

    def _start(self, frame: Frame, box: Box) -> Estimate:
        side = float(np.sqrt(box.area))
        self._size = box.width / side, box.height / side
        self._state = np.array([[side, 0, box.center[0]], [0, side, box.center[1]], [0, 0, 1.0]])
        count = int(self._parameters['particles'])
        self._particles = GroupParticles(
            self._state, count, np.array(frame.shape[1::-1]), self._rng, _SCALES)
        self._likelihood = AffineLikelihood(
            frame, self._state, self._size, int(self._parameters['eigenvectors']), True, _SIDE)
        self._begin(frame, box)
        return self._estimate(np.full(count, 1 / count))

    def _update(self, frame: Frame, dt: float) -> Estimate:
        self._adjust()
        values, particles, localiser = self._parameters, self._particles, self._localiser
        before = localiser.angle
        found = self._search.search(frame, dt)
        # the particles turn by the rotation that was measured from the target's points
        if turn := localiser.angle - before:
            self._state[:2, :2] = affine.rotation(np.asarray(turn)) @ self._state[:2, :2]
            particles.turn(turn)
        found = self._turned(frame, found)
        weights = self._weigh(frame, dt, found)
        self._state = particles.mean(weights)
        elsewhere = localiser.update(frame, found, dt)
        self._search.follow(dt, elsewhere)
        self._place(elsewhere)
        if not (localiser.uncertain or found.hidden):
            self._likelihood.update(
                self._likelihood.patch(frame, self._state), int(values['update_interval']),
                float(values['forgetting']), int(values['eigenvectors']))
        count = int(values['particles'])
        if elsewhere:
            particles.restart(self._state, count)
            return self._estimate(np.full(count, 1 / count))
        estimate = self._estimate(weights)
        particles.resample(weights, count)
        return estimate

    def _turned(self, frame: Frame, found: Found) -> Found:
        """Return the place found, or that in a window with the particles' rotation, if better."""
        localiser, response = self._localiser, found.response
        angle = float(affine.angle(self._state))
        if (found.hidden or response.peak >= _LOW_RESPONSE * localiser.response_unit
                or localiser.network is not None
                or abs(angle - localiser.angle) <= _LEAST_TURN):
            return found
        other = localiser.localise(frame, found.place, angle)
        if other.peak < _LEAST_GAIN * response.peak:
            return found
        return replace(found, response=other, place=other.center)

    def _weigh(self, frame: Frame, dt: float, found: Found) -> Array:
        """Move the particles, and return their normalised weights, shape (N,)."""
        values, particles = self._parameters, self._particles
        particles.propose(dt, self._sigmas, float(values['ar']))
        particles.gather(np.array(found.place), float(values['response_share']))
        logs = self._likelihood.log_likelihood(frame, particles.states, *self._widths)
        logs *= _TEMPERED
        if not found.hidden:
            # while a distractor hides the target, the response doesn't measure its place
            scale = float(values['temperature']) * self._localiser.response_unit
            response = found.response
            logs += (response.sample(particles.states[:, :2, 2]) - response.peak) / scale
        weights: Array = np.exp(logs - logs.max())
        return weights / weights.sum()

    def _place(self, elsewhere: bool) -> None:
        """Take place and size from the localiser, and if the target is elsewhere its rotation."""
        if elsewhere:
            self._state = np.eye(3)
            self._state[:2, :2] = affine.rotation(np.asarray(self._localiser.angle))
        width, height = self._localiser.size
        growth = np.sqrt(width * height) / float(affine.scale(self._state))
        self._state[:2, :2] *= growth
        self._state[:2, 2] = self._localiser.center
        self._particles.grow(growth)

    def _estimate(self, weights: Array) -> Estimate:
        boxes = affine.ellipse_bounds(self._particles.states, self._size)
        # about the reported box, which isn't the particles' mean
        shown = self._localiser.box
        spread = spread_about(np.array([*shown.center, shown.width, shown.height]), boxes, weights)
        return replace(
            self._localiser.estimate(spread, boxes), angle=float(affine.angle(self._state)),
            affine=self._state @ np.diag([*self._size, 1.0]))
