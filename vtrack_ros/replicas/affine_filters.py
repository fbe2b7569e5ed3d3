"""APPF [Xiang] and its baselines: particle filters over affine frames."""

from typing import ClassVar

import numpy as np

from vtrack_ros.appearance.affine_likelihood import AffineLikelihood
from vtrack_ros.estimation import spread_about
from vtrack_ros.estimation.affine_particles import (
    AffineParticles, GroupParticles, VectorParticles)
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import affine, Box
from vtrack_ros.localisation.filter_parameters import AFFINE, AFFINE_GROUP, AFFINE_NOISES
from vtrack_ros.localisation.presence import logistic, state_after, unknown_covariance
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.replicas.keypoint_memory import KeypointMemory
from vtrack_ros.replicas.keypoints import (
    detected, keypoint_error, Keypoints, nearest, pose_change, PoseChange)
from vtrack_ros.tracker import Estimate, Tracker

#: Side of the window that keypoints are detected in, relative to the target's bound; and the pose
#: uncertainty from which on it's twice as wide (it grows linearly up to that).
_KEYPOINT_REACH, _UNCERTAIN = 1.6, 10.0
#: Inlier tolerance of matched keypoints, as a share of the target's mean side; one pixel at least.
_TOLERANCE = 0.04
#: Of the correlation with the first patch: the value at which the confidence is 0.5, the width of
#: its logistic function, and the threshold below which the target counts as not seen.
_EVEN, _WIDTH, _UNLIKE = 0.25, 0.07, 0.15
#: Standard deviations (centre, size) of errors that the particles' spread doesn't contain, as
#: shares of the mean side; their variances are added to the covariance.
_CENTER_ERROR, _SIZE_ERROR = 0.08, 0.12

_KEYPOINTS = ParameterTable([
    Parameter('keypoints', True, 'Measure the change of pose from keypoints.'),
    Parameter('keypoint_share', 0.5, 'Fraction of the particles that move by the measured change '
              'of pose instead of the autoregressive process.', 0.0, 1.0),
    Parameter('keypoint_sigma', 0.05, "Standard deviation of the keypoints' positions in the "
              'likelihood, as a fraction of the target size sqrt(width * height). A larger value '
              'weights the particles more equally.', 0.001, 1.0),
    Parameter('as_printed', False, 'Match the keypoints of consecutive frames, instead of '
              'matching with stored keypoints of the target. Takes effect with the next target '
              'or ~/reinit.'),
])


class AffineParticleTracker(Tracker):
    """
    A particle filter over affine frames; a subclass chooses likelihood terms and dynamics.

    A frame's likelihood is the product of the paper's terms, the estimate is the particles' mean,
    and the box its axis-aligned bound. The paper doesn't detect failures: confidence and state
    come from the correlation with the first patch and don't influence the tracking.
    """

    PARAMETERS = AFFINE
    _particle_type: ClassVar[type[AffineParticles]] = GroupParticles

    def _configure(self) -> None:
        values = self._parameters
        self._sigmas = np.array([float(values[name]) for name in AFFINE_NOISES])
        self._widths = (
            float(values.get('colour_sigma', np.inf)), float(values['subspace_sigma']))

    def _start(self, frame: Frame, box: Box) -> Estimate:
        side, count = float(np.sqrt(box.area)), int(self._parameters['particles'])
        self._size = box.width / side, box.height / side
        self._state = np.array([[side, 0, box.center[0]], [0, side, box.center[1]], [0, 0, 1.0]])
        self._particles = self._particle_type(
            self._state, count, np.array(frame.shape[1::-1]), self._rng)
        self._likelihood = AffineLikelihood(
            frame, self._state, self._size, int(self._parameters['eigenvectors']),
            'colour_sigma' in self._parameters)
        self._unlike_frames = 0.0
        return self._estimate(np.full(count, 1 / count), 1.0, 0.0)

    def _update(self, frame: Frame, dt: float) -> Estimate:
        values, particles = self._parameters, self._particles
        change = self._measured(frame)
        particles.propose(
            dt, self._sigmas, float(values.get('ar', 0.0)),
            None if change is None else change.matrix, float(values.get('keypoint_share', 0.0)))
        logs = self._likelihood.log_likelihood(frame, particles.states, *self._widths)
        if change is not None:
            width = float(values['keypoint_sigma']) * float(affine.scale(self._state))
            logs -= keypoint_error(particles.states, self._state, change) / (2 * width**2)
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        self._state = particles.mean(weights)
        self._settled()
        patch = self._likelihood.patch(frame, self._state)
        self._likelihood.update(
            patch, int(values['update_interval']), float(values['forgetting']),
            int(values['eigenvectors']))
        estimate = self._estimate(weights, self._likelihood.similarity(patch), dt)
        particles.resample(weights, int(values['particles']))
        return estimate

    def _measured(self, frame: Frame) -> PoseChange | None:
        """Return the measured movement since the last estimate; None where there is none."""
        return None

    def _settled(self) -> None:
        """Learn from the new estimate."""

    def _estimate(self, weights: Array, similarity: float, dt: float) -> Estimate:
        boxes = affine.bounds(self._particles.states, self._size)
        bound = affine.bounds(self._state, self._size)
        covariance = spread_about(bound, boxes, weights)
        assert self._frame_shape is not None
        box = Box.from_center(*bound)
        visible = box.clipped(self._frame_shape[1], self._frame_shape[0])
        # outside the image patches repeat its border, and their correlation means nothing
        similarity *= 0.0 if visible is None else visible.area / box.area
        confidence = logistic((similarity - _EVEN) / _WIDTH)
        self._unlike_frames = self._unlike_frames + dt if similarity < _UNLIKE else 0.0
        covariance += unknown_covariance(_CENTER_ERROR, _SIZE_ERROR, box.area, self._unlike_frames)
        return Estimate(
            box=box, angle=float(affine.angle(self._state)), covariance=covariance,
            confidence=confidence, state=state_after(self._unlike_frames), particles=boxes,
            affine=self._state @ np.diag([*self._size, 1.0]))


class ConsecutiveKeypoints:
    """
    Matches the keypoints of two consecutive frames on the target [Xiang, sec. 2].

    `size` is that of the rectangle that affine frames map onto the target, as in `KeypointMemory`.
    """

    uncertainty = 0.0

    def __init__(self, size: tuple[float, float]) -> None:
        self._half = np.array(size) / 2
        self._before = self._seen = Keypoints(np.zeros((0, 2)), np.zeros((0, 128), np.float32))

    def measure(self, seen: Keypoints, state: Array,
                rng: np.random.Generator) -> PoseChange | None:
        """Return the movement that most keypoints of the last frame agree with."""
        self._seen = seen
        which, seen_as = nearest(self._before.descriptors, seen.descriptors)
        return pose_change(
            self._before.points[which], seen.points[seen_as],
            max(1.0, _TOLERANCE * float(affine.scale(state))), rng)

    def learn(self, state: Array) -> None:
        """Keep the keypoints that are on the target."""
        inverse = affine.inverse(state)
        places = self._seen.points @ inverse[:2, :2].T + inverse[:2, 2]
        inside = (np.abs(places) < self._half).all(1)
        self._before = Keypoints(self._seen.points[inside], self._seen.descriptors[inside])


class AffineKeypointReplica(AffineParticleTracker):
    """
    APPF: autoregression on the affine group, steered by the keypoints' pose [Xiang].

    Printed: particles move by X_t = X_{t-1} exp(a log(X_{t-2}^-1 X_{t-1}) + dW) (sec. 3.2) and are
    weighted by colour, the subspace of patches and keypoints (sec. 3.3). The keypoints' pose, from
    SIFT matches of consecutive frames, RANSAC and a Sylvester equation (eqs 1-4), steers the
    sampling, but the paper doesn't say how: here `keypoint_share` of the particles move by it plus
    noise and the rest by the process, so that a wrong pose costs particles and not the target.

    Corrected: matches of consecutive frames lose targets during occlusions, for the occluder's
    keypoints in the box agree on its own movement, and the errors of the steps accumulate. Here
    the target's keypoints are remembered by their positions on it, a new algorithm, see
    `KeypointMemory`. `as_printed` matches consecutive frames.

    The only available text of the paper lacks its formulas. In addition to what it describes, the
    pose has a change of scale, for the paper's own targets come nearer, and the keypoints' errors
    are averaged, not summed.
    """

    NAME = 'appf_paper'
    SUMMARY = 'affine-group particle filter with subspace and keypoints (APPF) of Xiang et al.'
    PARAMETERS = AFFINE + AFFINE_GROUP + _KEYPOINTS

    def _start(self, frame: Frame, box: Box) -> Estimate:
        self._as_printed = bool(self._parameters['as_printed'])
        self._meter: KeypointMemory | ConsecutiveKeypoints | None = None
        estimate = super()._start(frame, box)
        self._measured(frame)
        self._settled()
        return estimate

    def _measured(self, frame: Frame) -> PoseChange | None:
        if not self._parameters['keypoints']:
            self._meter = None
            return None
        if self._meter is None:
            self._meter = (ConsecutiveKeypoints(self._size) if self._as_printed
                           else KeypointMemory(self._size))
        x, y, width, height = affine.bounds(self._state, self._size)
        reach = _KEYPOINT_REACH * (1 + min(self._meter.uncertainty / _UNCERTAIN, 1.0))
        seen = detected(frame, (float(x), float(y)), (width, height), reach)
        return self._meter.measure(seen, self._state, self._rng)

    def _settled(self) -> None:
        if self._meter is not None:
            self._meter.learn(self._state)


class AffineReplica(AffineParticleTracker):
    """The affine-group particle filter without keypoints [Kwon and Park 2010], as printed."""

    NAME = 'affine_pf_paper'
    SUMMARY = 'affine-group particle filter, a baseline of Xiang et al.'
    PARAMETERS = AFFINE + AFFINE_GROUP


class SubspaceReplica(AffineParticleTracker):
    """
    PPCA: a particle filter over geometric parameters and a subspace of patches [Ross2008].

    Independent random walks; the estimate is the most likely particle (sec. 4.1). Nothing had to
    be corrected. For the forgetting of old patches see `Subspace`.
    """

    NAME = 'ppca_paper'
    SUMMARY = 'particle filter with an incremental subspace (PPCA), a baseline of Xiang et al.'
    _particle_type = VectorParticles
