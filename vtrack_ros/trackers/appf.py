"""APPF: a particle filter on the affine group, steered by keypoints and by the response."""

import numpy as np

from vtrack_ros.appearance.affine_likelihood import AffineLikelihood, Widths
from vtrack_ros.appearance.keypoint_memory import KeypointMemory
from vtrack_ros.appearance.keypoints import KeypointDetector, PoseChange
from vtrack_ros.estimation import spread_about
from vtrack_ros.estimation.affine_particles import GroupParticles
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import affine, Box
from vtrack_ros.localisation import Localiser
from vtrack_ros.localisation.upright_search import UprightResponse, UprightSearch
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Estimate, Tracker

#: The window that keypoints are searched in, in units of the target's bound: about its last place
#: in the first frame, then about the highest response. It's twice as wide where there is so much
#: uncertainty.
_FIRST_REACH, _REACH = 1.6, 1.3
_UNCERTAIN = 10.0
#: Power of the paper's likelihood beside the response: both see the same pixels, and a product of
#: terms that aren't independent is too sure of itself.
_TEMPERED = 0.3
#: Samples along each side of a patch, and of the target, at most, for keypoints.
_SIDE, _KEYPOINT_SIDE = 24, 40

_NOISES = ('scale_noise', 'aspect_noise', 'rotation_noise', 'skew_noise', 'x_noise', 'y_noise')


class AffineKeypointParticleFilter(Tracker):
    """
    APPF: autoregression on the affine group, steered by the keypoints' pose [Xiang].

    The paper has the pose steer the sampling, but doesn't say how: here `keypoint_share` of the
    particles move by the measured pose plus noise and the rest by the autoregressive process, so
    that a wrong pose costs particles and not the target. Without a pose all follow the process.

    The paper matches the keypoints of consecutive frames. As printed that loses targets that pass
    behind something: the occluder's keypoints in the box agree on a movement, its own, and the
    error of each step adds to the last. Here the keypoints of the target are remembered, see
    `KeypointMemory`, and the pose is measured against the places that they had on it.

    The response of a discriminative model is one more term of the likelihood, and where it's
    highest is one more measured pose, which a share of the particles moves to. Place, size and box
    are the model's, whose own maximum is more exact than a mean over six dimensions; rotation and
    shape are the particles', and when a rotation brings a higher response the model is shown the
    frame turned back by it. When it finds the target elsewhere the particles start again there.
    """

    NAME = 'appf'
    SUMMARY = 'affine-group particle filter with appearance subspace and keypoints (APPF)'
    PARAMETERS = ParameterTable([
        Parameter('particles', 400, 'Number of particles.', 2, 5000),
        Parameter('scale_noise', 0.02, 'Standard deviation of the relative change of scale a '
                  'frame.', 0.0, 0.5),
        Parameter('aspect_noise', 0.005, 'Standard deviation of the relative change of aspect '
                  'ratio a frame.', 0.0, 0.5),
        Parameter('rotation_noise', 0.02, 'Standard deviation of the rotation a frame.', 0.0, 1.5,
                  unit='rad'),
        Parameter('skew_noise', 0.005, 'Standard deviation of the change of skew a frame.', 0.0,
                  0.5),
        Parameter('x_noise', 0.06, 'Standard deviation of the step along x a frame, as a share of '
                  "the target's mean side.", 0.0, 2.0),
        Parameter('y_noise', 0.06, 'Standard deviation of the step along y a frame, as a share of '
                  "the target's mean side.", 0.0, 2.0),
        Parameter('subspace_sigma', 0.05, 'Width of the subspace likelihood '
                  'exp(-e / (2 sigma^2)), e the robust error from 0 to 1.', 0.005, 1.0),
        Parameter('eigenvectors', 16, "Principal components of the target's patches.", 1, 64),
        Parameter('forgetting', 0.95, 'What the patches before are worth at each update.', 0.5,
                  1.0),
        Parameter('update_interval', 5, 'Frames between updates of the subspace.', 1, 100,
                  unit='frames'),
        Parameter('temperature', 0.1, 'Share of the usual response that makes a factor of e in '
                  'the likelihood.', 0.01, 1.0),
        Parameter('response_share', 0.3, 'Share of the particles that are moved to where the '
                  'response is highest.', 0.0, 1.0),
        Parameter('ar', 0.5, 'Share a of the last step that the autoregressive process repeats.',
                  0.0, 1.0),
        Parameter('colour_sigma', 0.12, 'Width of the colour likelihood '
                  'exp(-(1 - rho) / (2 sigma^2)).', 0.01, 1.0),
        Parameter('keypoints', True, 'Whether keypoints measure the pose.'),
        Parameter('keypoint_share', 0.5, 'Share of the particles that the measured pose moves in '
                  'place of the autoregressive process.', 0.0, 1.0),
        Parameter('keypoint_sigma', 0.05, 'Width of the keypoint likelihood, as a share of the '
                  "target's mean side.", 0.001, 1.0),
    ])

    def _configure(self) -> None:
        values = self._parameters
        self._sigmas = np.array([float(values[name]) for name in _NOISES])
        self._widths = Widths(*(
            float(values[f'{term}_sigma']) for term in ('colour', 'subspace', 'keypoint')))

    def _start(self, frame: Frame, box: Box) -> Estimate:
        side = float(np.sqrt(box.area))
        self._size = box.width / side, box.height / side
        self._state = np.array(
            [[side, 0, box.center[0]], [0, side, box.center[1]], [0, 0, 1.0]])
        count = int(self._parameters['particles'])
        self._particles = GroupParticles(
            self._state, count, np.array(frame.shape[1::-1]), self._rng)
        self._likelihood = AffineLikelihood(
            frame, self._state, self._size, int(self._parameters['eigenvectors']), True, _SIDE)
        self._detector = KeypointDetector(_KEYPOINT_SIDE)
        self._memory = KeypointMemory(self._size)
        self._measured_pose(frame, self._state[:2, 2], _FIRST_REACH)
        self._remember_keypoints()
        self._localiser = Localiser(frame, box.center, (box.width, box.height), self._rng)
        self._upright = UprightSearch(self._localiser)
        return self._estimate(np.full(count, 1 / count))

    def _update(self, frame: Frame, dt: float) -> Estimate:
        values, particles = self._parameters, self._particles
        response = self._upright.localise(frame, float(affine.angle(self._state)))
        weights = self._weigh(frame, dt, response)
        self._state = particles.mean(weights)
        elsewhere = self._upright.update(response, response.center, dt)
        self._place(elsewhere)
        self._remember_keypoints()
        if not self._localiser.uncertain:
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

    def _weigh(self, frame: Frame, dt: float, response: UprightResponse) -> Array:
        """Move the particles, and return their normalised weights, shape (N,)."""
        values, particles = self._parameters, self._particles
        change = self._measured_pose(frame, response.center, _REACH)
        particles.propose(
            dt, self._sigmas, float(values['ar']), None if change is None else change.matrix,
            float(values['keypoint_share']))
        particles.gather(response.center, float(values['response_share']))
        logs = self._likelihood.log_likelihood(
            frame, particles.states, self._widths, change, self._state)
        logs *= _TEMPERED
        scale = float(values['temperature']) * self._localiser.usual_response
        logs += (response.sample(particles.states[:, :2, 2]) - response.peak) / scale
        weights: Array = np.exp(logs - logs.max())
        return weights / weights.sum()

    def _place(self, elsewhere: bool) -> None:
        """Take place and size from the localiser; elsewhere, its rotation too."""
        if elsewhere:
            self._state = np.eye(3)
            self._state[:2, :2] = affine.rotation(np.asarray(self._upright.angle))
        width, height = self._localiser.size
        growth = np.sqrt(width * height) / float(affine.scale(self._state))
        self._state[:2, :2] *= growth
        self._state[:2, 2] = self._localiser.center
        self._particles.grow(growth)

    def _measured_pose(self, frame: Frame, center: Array, reach: float) -> PoseChange | None:
        """Return how the target's keypoints moved from where the last estimate has them."""
        if not self._parameters['keypoints']:
            self._memory = KeypointMemory(self._size)
            return None
        _, _, width, height = affine.bounds(self._state, self._size)
        reach *= 1 + min(self._memory.uncertainty / _UNCERTAIN, 1.0)
        seen = self._detector.detect(
            frame, (float(center[0]), float(center[1])), (width, height), reach)
        return self._memory.measure(seen, self._state, self._rng)

    def _remember_keypoints(self) -> None:
        """Learn which keypoints moved with the target."""
        if self._parameters['keypoints']:
            self._memory.learn(self._state)

    def _estimate(self, weights: Array) -> Estimate:
        boxes = affine.ellipse_bounds(self._particles.states, self._size)
        pose = np.eye(3)
        pose[:2, :2] = affine.rotation(np.asarray(self._upright.angle))
        pose[:2, 2] = self._localiser.center
        shown = affine.ellipse_bounds(pose, self._localiser.size)
        # about the box that's reported, which isn't the particles' mean
        return self._localiser.estimate(
            spread_about(shown, boxes, weights), float(affine.angle(self._state)), boxes,
            self._state @ np.diag([*self._size, 1.0]), Box.from_center(*shown))
