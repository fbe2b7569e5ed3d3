"""The particle filter over boxes that the first two papers and their baselines share."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from vtrack_ros.estimation import (
    ConstantVelocity, GaussianNoise, ParticleFilter, PriorProposal, Proposal, spread_about)
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.filter_parameters import MOTION, RESAMPLING
from vtrack_ros.localisation.presence import state_after, unknown_covariance
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.replicas.cues import BoxCues
from vtrack_ros.replicas.dynamics import DYNAMICS, motion_model
from vtrack_ros.replicas.fusion import FusionRule, FUSIONS
from vtrack_ros.tracker import Estimate, Tracker

#: Standard deviations (centre, size) of errors that the particles' spread doesn't contain, as
#: shares of the target's mean side; their variances are added to the covariance.
_CENTER_ERROR, _SIZE_ERROR = 0.33, 0.3
#: Confidence below which the target counts as not seen.
_SEARCHING_BELOW = 0.5
#: Standard deviations of the first particles' (cx, cy, vx, vy, w, h), in mean sides (per frame).
_FIRST_SPREAD = np.array([0.03, 0.03, 0.05, 0.05, 0.02, 0.02])

BOX_PARAMETERS = ParameterTable([
    MOTION['particles'],
    Parameter('dynamics', 'white_acceleration', 'Motion model of the centre. white_acceleration: '
              'velocity driven by white noise; constant_velocity: independent noise of position '
              'and velocity; random_walk: noise of position alone.', choices=DYNAMICS),
    Parameter('noise', 0.2, 'Process noise, as a fraction of the target size '
              'sqrt(width * height): standard deviation per frame of the change of velocity with '
              'white_acceleration, otherwise of the position.', 0.001, 2.0),
    Parameter('size_noise', 0.01, 'Process noise: standard deviation per frame of width and '
              'height, as a fraction of the target size sqrt(width * height).', 0.001, 0.5),
    Parameter('cues', 'colour', 'What boxes are compared by: the colour histogram, alone or with '
              'moving edges. Takes effect with the next target or ~/reinit.',
              choices=('colour', 'colour+motion_edge')),
    Parameter('kernel', 'flat', 'Weights of the pixels of a box in the colour histogram. flat: '
              'all equal; epanechnikov: largest in the centre. Takes effect with the next target '
              'or ~/reinit.', choices=('flat', 'epanechnikov')),
    Parameter('fusion', 'dempster_shafer', 'How the likelihoods of two cues are combined; '
              'normalised: by eqs 16 to 19 of Qi and Li 2012, eq. 18 without its misprint.',
              choices=tuple(FUSIONS)),
    Parameter('grid', 12, 'Number of sample points along each side of a box for the colour '
              'histogram. Takes effect with the next target or ~/reinit.', 4, 64),
    Parameter('sigma', 0.1, 'Width sigma of the likelihood exp(-(1 - rho) / (2 sigma^2)), where '
              'rho is the Bhattacharyya coefficient of the histograms. A larger value weights '
              'the particles more equally.', 0.01, 1.0),
]) + RESAMPLING


class BoxParticleFilter(Tracker):
    """
    A particle filter over (cx, cy, vx, vy, w, h), in pixels and frames [Zhu2012, eq. 19].

    The papers' model of motion is "first-order autoregressive", x = A x_prev + u, with neither A
    nor u given: `dynamics` and `noise` choose them; sizes do a random walk. A subclass gives the
    proposal, and says whether it uses a measured centre.
    """

    PARAMETERS = BOX_PARAMETERS
    _measures: ClassVar[bool] = False
    _filter: ParticleFilter

    @abstractmethod
    def _proposal(self, model: ConstantVelocity) -> Proposal:
        """Return the proposal for a model of motion."""

    def _weighting(self) -> str:
        """Return the weighting of the filter, see `ParticleFilter`."""
        return str(self._parameters.get('weighting', 'simplified'))

    def _fusion(self) -> FusionRule:
        """Return how the cues are fused."""
        return FUSIONS[str(self._parameters['fusion'])]

    def _configure(self) -> None:
        if self._frame_shape is None:
            return
        self._side = 0.0  # `_adapt` makes the model of motion and the filter anew
        self._cues.sigma = float(self._parameters['sigma'])
        self._cues.fusion = self._fusion()

    def _start(self, frame: Frame, box: Box) -> Estimate:
        parameters = self._parameters
        self._as_printed = bool(parameters.get('as_printed', False))
        self._cues = BoxCues('motion_edge' in str(parameters['cues']), str(parameters['kernel']),
                             int(parameters['grid']))
        self._configure()
        self._box = np.array([*box.center, box.width, box.height])
        self._cues.start(frame, self._box)
        self._unseen_frames = 0.0
        side = float(np.sqrt(self._box[2] * self._box[3]))
        self._filter = self._create_filter(side)
        mean = np.array([*self._box[:2], 0.0, 0.0, *self._box[2:]])
        self._filter.start(mean, np.diag((_FIRST_SPREAD * side)**2))
        return self._estimate(1.0, np.zeros((4, 4)), _boxes(self._filter.belief.states))

    def _update(self, frame: Frame, dt: float) -> Estimate:
        self._adapt()
        predicted = self._box.copy()
        before = self._filter.belief.mean[None]
        predicted[:2] += (self._filter.model.transition(before, dt) - before)[0, :2]
        self._cues.observe(frame, predicted)
        center, error = None, None
        if self._measures:
            side = float(np.sqrt(self._box[2] * self._box[3]))
            center, covariance = self._cues.measure(predicted, side)
            error = GaussianNoise.from_covariance(covariance)
        proposed = self._filter.propose(center, dt, error)
        boxes = _boxes(proposed.states)
        belief = self._filter.weight(proposed, self._cues.log_likelihood(boxes), dt)
        weights = belief.weights.values
        mean = weights @ boxes
        self._box = self._cues.bounded(mean[None])[0]
        confidence = self._cues.confidence(self._box)
        self._cues.update(self._box)
        seen = confidence >= _SEARCHING_BELOW
        self._unseen_frames = 0.0 if seen else self._unseen_frames + dt
        return self._estimate(confidence, spread_about(mean, boxes, weights), boxes)

    def _adapt(self) -> None:
        """Make the model of motion anew when the target's size, or a parameter, has changed."""
        side = float(np.sqrt(self._box[2] * self._box[3]))
        if self._side and abs(side - self._side) < 0.1 * self._side:
            return
        belief = self._filter.belief
        self._filter = self._create_filter(side)
        self._filter.resume(belief)

    def _create_filter(self, side: float) -> ParticleFilter:
        parameters = self._parameters
        self._side = side
        model = motion_model(
            str(parameters['dynamics']), float(parameters['noise']) * side,
            float(parameters['size_noise']) * side)
        return ParticleFilter(
            model, self._proposal(model), particles=int(parameters['particles']),
            threshold=float(parameters['threshold']), weighting=self._weighting(), rng=self._rng)

    def _estimate(self, confidence: float, covariance: Array, boxes: Array) -> Estimate:
        center_x, center_y, width, height = self._box.tolist()
        unknown = unknown_covariance(
            _CENTER_ERROR, _SIZE_ERROR, width * height, self._unseen_frames)
        return Estimate(
            box=Box.from_center(center_x, center_y, width, height), angle=0.0,
            covariance=covariance + unknown, confidence=confidence,
            state=state_after(self._unseen_frames), particles=boxes)


class CondensationReplica(BoxParticleFilter):
    """
    PF: the transition prior as the proposal (Condensation), the baseline of all four papers.

    Zhu, Yin and Xiang compare with colour alone, Qi with both cues too (`cues`). Prior and
    proposal cancel in the weight, w = w_prev p(z|x) [Qi2012, eq. 3]; nothing is corrected.
    """

    NAME = 'pf_paper'
    SUMMARY = 'particle filter (Condensation), the baseline of the papers'

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        return PriorProposal()


def _boxes(states: Array) -> Array:
    """Return the boxes (cx, cy, w, h) of states, shape (N, 4)."""
    return np.hstack([states[:, :2], states[:, 4:]])
