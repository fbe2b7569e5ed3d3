"""Particle filters on the affine group: APPF and its two baselines."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.affine_likelihood import AffineLikelihood, Widths
from vtrack_ros.appearance.keypoint_memory import KeypointMemory
from vtrack_ros.appearance.keypoints import KeypointDetector, PoseChange
from vtrack_ros.estimation import spread_about
from vtrack_ros.estimation.affine_particles import (
    AffineParticles, GroupParticles, VectorParticles)
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import affine, Box
from vtrack_ros.localisation import Localiser
from vtrack_ros.localisation.presence import state_after, unknown_covariance
from vtrack_ros.localisation.upright_search import UprightResponse, UprightSearch
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Estimate, Tracker

Array = NDArray[np.float64]

#: The window that keypoints are looked for in, in units of the target's bound: about its last
#: place, and about the place of most evidence. It's twice as wide where there is so much doubt.
_KEYPOINT_REACH, _KEYPOINT_REACH_ABOUT_EVIDENCE = 1.6, 1.3
_DOUBTFUL = 10.0
#: Power of the paper's likelihood beside the evidence: both see the same pixels, and a product of
#: terms that aren't independent is too sure of itself.
_TEMPERED = 0.3
#: Samples along each side of a look: the paper's, and what does beside the evidence.
_SIDE = {'paper': 32, 'default': 24}
#: Samples along a side of the target, at most, that keypoints are looked for in.
_KEYPOINT_SIDE = {'paper': 50, 'default': 40}

_SHARED = ParameterTable([
    Parameter('preset', 'default', 'As printed (paper), or steered by a discriminative model that '
              'also searches (default); in force at the next start.',
              choices=('default', 'paper')),
    Parameter('particles', 400, 'Number of particles.', 2, 5000),
    Parameter('scale_noise', 0.02, 'Standard deviation of the relative change of scale a frame.',
              0.0, 0.5),
    Parameter('aspect_noise', 0.005, 'Standard deviation of the relative change of aspect ratio '
              'a frame.', 0.0, 0.5),
    Parameter('rotation_noise', 0.02, 'Standard deviation of the rotation a frame.', 0.0, 1.5,
              unit='rad'),
    Parameter('skew_noise', 0.005, 'Standard deviation of the change of skew a frame.', 0.0, 0.5),
    Parameter('x_noise', 0.06, 'Standard deviation of the step along x a frame, as a share of '
              "the target's mean side.", 0.0, 2.0),
    Parameter('y_noise', 0.06, 'Standard deviation of the step along y a frame, as a share of '
              "the target's mean side.", 0.0, 2.0),
    Parameter('subspace_sigma', 0.05, 'Width of the subspace likelihood exp(-e / (2 sigma^2)), e '
              'the robust error from 0 to 1.', 0.005, 1.0),
    Parameter('eigenvectors', 16, "Principal components of the target's looks.", 1, 64),
    Parameter('forgetting', 0.95, 'What the looks before are worth at each update.', 0.5, 1.0),
    Parameter('update_interval', 5, 'Looks between updates of the subspace.', 1, 100,
              unit='frames'),
    Parameter('temperature', 0.1, 'Share of the usual evidence that makes a factor of e in the '
              'likelihood (default preset).', 0.01, 1.0),
    Parameter('evidence_share', 0.3, 'Share of the particles that are moved to where there is '
              'most evidence (default preset).', 0.0, 1.0),
])
_GROUP = ParameterTable([
    Parameter('ar', 0.5, 'Share a of the last step that the autoregressive process repeats.',
              0.0, 1.0),
    Parameter('colour_sigma', 0.12, 'Width of the colour likelihood '
              'exp(-(1 - rho) / (2 sigma^2)).', 0.01, 1.0),
])
_KEYPOINTS = ParameterTable([
    Parameter('keypoints', True, 'Whether keypoints measure the pose.'),
    Parameter('keypoint_share', 0.5, 'Share of the particles that the measured pose moves in '
              'place of the autoregressive process.', 0.0, 1.0),
    Parameter('keypoint_sigma', 0.05, 'Width of the keypoint likelihood, as a share of the '
              "target's mean side.", 0.001, 1.0),
])
#: Correlation with the first look at which on and off the target are even, the width of the
#: transition, and what doesn't count as seen (paper preset).
_EVEN_LIKENESS, _LIKENESS_SPREAD, _UNLIKE = 0.25, 0.07, 0.15
#: Standard deviations that the particles don't know of, as shares of the mean side (paper preset).
_CENTER_ERROR, _SIZE_ERROR = 0.08, 0.12
_NOISES = ('scale_noise', 'aspect_noise', 'rotation_noise', 'skew_noise', 'x_noise', 'y_noise')


class AffineTracker(Tracker):
    """
    A particle filter over affine frames; a subclass says which terms and dynamics it has.

    In the `paper` preset a frame's likelihood is the product of the paper's terms, the estimate
    is the particles' mean, and the box its axis-aligned bound. Nothing in the paper notices a
    loss: confidence and state come from the correlation with the first look and change nothing.

    In the `default` preset a discriminative target looks at the frame too. Its evidence is one
    more term of the likelihood, and where there's most of it is one more measured pose, which a
    share of the particles moves to. Place, size and box are the discriminative target's, whose
    own maximum is more exact than a mean over six dimensions; rotation and shape are the
    particles', and when a rotation brings more evidence the discriminative target is shown the
    frame turned back by it. When it finds the target elsewhere the particles start again there.
    """

    PARAMETERS = _SHARED
    _particle_type: ClassVar[type[AffineParticles]] = GroupParticles

    def _configure(self) -> None:
        values = self._parameters
        self._sigmas = np.array([float(values[name]) for name in _NOISES])
        self._widths = Widths(
            float(values.get('colour_sigma', np.inf)), float(values['subspace_sigma']),
            float(values.get('keypoint_sigma', np.inf)))

    def _start(self, frame: Frame, box: Box) -> Estimate:
        side = float(np.sqrt(box.area))
        self._size = box.width / side, box.height / side
        self._state = np.array(
            [[side, 0, box.center[0]], [0, side, box.center[1]], [0, 0, 1.0]])
        self._particles = self._particle_type(
            self._state, int(self._parameters['particles']), np.array(frame.shape[1::-1]),
            self._rng)
        self._appearance = AffineLikelihood(
            frame, self._state, self._size, int(self._parameters['eigenvectors']),
            'colour_sigma' in self._parameters,
            _SIDE[str(self._parameters['preset'])])
        self._detector = KeypointDetector(_KEYPOINT_SIDE[str(self._parameters['preset'])])
        self._memory: KeypointMemory | None = None
        self._measure_movement(frame)
        self._remember_keypoints()
        self._target: Localiser | None = None
        if self._parameters['preset'] == 'default':
            self._target = Localiser(frame, box.center, (box.width, box.height), self._rng)
            self._upright = UprightSearch(self._target)
        self._doubtful_frames = 0.0
        count = len(self._particles.states)
        return self._estimate(np.full(count, 1 / count), 1.0, 0.0)

    def _update(self, frame: Frame, dt: float) -> Estimate:
        target = self._target
        seen = None if target is None else self._upright.localise(
            frame, float(affine.angle(self._state)))
        weights = self._weigh(frame, dt, seen)
        self._state = self._particles.mean(weights)
        found = target is not None and seen is not None and self._settle(target, seen, dt)
        self._remember_keypoints()
        look = self._appearance.look(frame, self._state)
        if target is None or not target.uncertain:
            self._appearance.learn(
                look, int(self._parameters['update_interval']),
                float(self._parameters['forgetting']), int(self._parameters['eigenvectors']))
        count = int(self._parameters['particles'])
        if found:
            self._particles.restart(self._state, count)
            weights = np.full(count, 1 / count)
        estimate = self._estimate(weights, self._appearance.likeness(look), dt)
        if not found:
            self._particles.resample(weights, count)
        return estimate

    def _weigh(self, frame: Frame, dt: float, seen: UprightResponse | None) -> Array:
        """Move the particles, and return their normalised weights, shape (N,)."""
        values, particles = self._parameters, self._particles
        change = self._measure_movement(frame, None if seen is None else seen.center)
        particles.propose(
            dt, self._sigmas, float(values.get('ar', 0.0)),
            None if change is None else change.matrix, float(values.get('keypoint_share', 0.0)))
        if seen is not None:
            particles.gather(seen.center, float(values['evidence_share']))
        logs = self._appearance.log_likelihood(
            frame, particles.states, self._widths, change, self._state)
        if self._target is not None and seen is not None:
            logs *= _TEMPERED
            scale = float(values['temperature']) * self._target.usual_response
            logs += (seen.sample(particles.states[:, :2, 2]) - seen.peak) / scale
        weights: Array = np.exp(logs - logs.max())
        return weights / weights.sum()

    def _settle(self, target: Localiser, seen: UprightResponse, dt: float) -> bool:
        """
        Let the discriminative target settle, and take place and size from it.

        The evidence's own maximum is more exact than the mean of particles that are spread over
        six dimensions; what they add is rotation and shape.
        """
        found = self._upright.update(seen, seen.center, dt)
        live = target
        if found:
            self._state = np.eye(3)
            self._state[:2, :2] = affine.rotation(np.asarray(self._upright.angle))
        growth = np.sqrt(live.size[0] * live.size[1]) / float(affine.scale(self._state))
        self._state[:2, :2] *= growth
        self._state[:2, 2] = live.center
        self._particles.grow(growth)
        return found

    def _measure_movement(self, frame: Frame, place: Array | None = None) -> PoseChange | None:
        """Return how the target's keypoints moved from where the last estimate has them."""
        if not self._parameters.get('keypoints', False):
            self._memory = None
            return None
        memory = self._memory = self._memory or KeypointMemory(self._size)
        x, y, width, height = affine.bounds(self._state, self._size)
        reach = _KEYPOINT_REACH
        if place is not None:
            (x, y), reach = place, _KEYPOINT_REACH_ABOUT_EVIDENCE
        reach *= 1 + min(memory.doubt / _DOUBTFUL, 1.0)
        seen = self._detector.detect(frame, (float(x), float(y)), (width, height), reach)
        return memory.measure(seen, self._state, self._rng)

    def _remember_keypoints(self) -> None:
        """Learn which keypoints moved with the target."""
        if self._memory is not None:
            self._memory.learn(self._state)

    def _estimate(self, weights: Array, likeness: float, dt: float) -> Estimate:
        frame = self._state @ np.diag([*self._size, 1.0])
        angle = float(affine.angle(self._state))
        if self._target is not None:
            boxes = affine.ellipse_bounds(self._particles.states, self._size)
            live = self._target
            pose = np.eye(3)
            pose[:2, :2] = affine.rotation(np.asarray(self._upright.angle))
            pose[:2, 2] = live.center
            shown = affine.ellipse_bounds(pose, live.size)
            # about the box that's reported, which isn't the particles' mean
            return self._target.estimate(
                spread_about(shown, boxes, weights), angle, boxes, frame, Box.from_center(*shown))
        boxes = affine.bounds(self._particles.states, self._size)
        bound = affine.bounds(self._state, self._size)
        covariance = spread_about(bound, boxes, weights)
        assert self._frame_shape is not None
        box = Box.from_center(*bound)
        visible = box.clipped(self._frame_shape[1], self._frame_shape[0])
        # patches repeat the border beyond it, and may look like anything there
        likeness *= 0.0 if visible is None else visible.area / box.area
        confidence = float(1 / (1 + np.exp(-(likeness - _EVEN_LIKENESS) / _LIKENESS_SPREAD)))
        self._doubtful_frames = self._doubtful_frames + dt if likeness < _UNLIKE else 0.0
        covariance += unknown_covariance(
            _CENTER_ERROR, _SIZE_ERROR, box.area, self._doubtful_frames)
        return Estimate(
            box=box, angle=angle, covariance=covariance,
            confidence=confidence, particles=boxes, affine=frame,
            state=state_after(self._doubtful_frames))


class AffineKeypointParticleFilter(AffineTracker):
    """
    APPF: autoregression on the affine group, steered by the keypoints' pose [Xiang].

    The paper has the pose steer the sampling, but doesn't say how: here `keypoint_share` of the
    particles move by the measured pose plus noise and the rest by the autoregressive process, so
    that a wrong pose costs particles and not the target. Without a pose all follow the process.

    The paper matches the keypoints of consecutive frames. As printed that loses targets that pass
    behind something: the occluder's keypoints in the box agree on a movement, its own, and the
    error of each step adds to the last. Here the keypoints of the target are remembered, see
    `KeypointMemory`, and the pose is measured against the places that they had on it.
    """

    NAME = 'appf'
    SUMMARY = 'affine-group particle filter with appearance subspace and keypoints (APPF)'
    PARAMETERS = _SHARED + _GROUP + _KEYPOINTS


class AffineParticleFilter(AffineTracker):
    """The affine-group particle filter without keypoints [Kwon and Park 2010]."""

    NAME = 'affine_pf'
    SUMMARY = 'affine-group particle filter'
    PARAMETERS = _SHARED + _GROUP


class SubspaceParticleFilter(AffineTracker):
    """PPCA: a particle filter over geometric parameters and a subspace of looks [Ross2008]."""

    NAME = 'ppca'
    SUMMARY = 'particle filter with an incremental appearance subspace (PPCA)'
    _particle_type = VectorParticles
