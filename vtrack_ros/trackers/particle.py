"""Particle filters over boxes: one tracker, six proposals."""

from __future__ import annotations

from abc import abstractmethod
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.fusion import FUSION_RULES
from vtrack_ros.estimation import (
    ConstantVelocity, gauss_hermite, GaussianFilterProposal, GaussianNoise, GreyProposal,
    KalmanFilter, ParticleFilter, PriorProposal, Proposal, pruned_gauss_hermite, SigmaPointFilter,
    spread_about, unscented)
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.presence import state_after, unknown_covariance
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Estimate, Tracker
from vtrack_ros.trackers.discriminative_observation import DiscriminativeObservation
from vtrack_ros.trackers.observation import Conclusion, CueObservation, Observation

Array = NDArray[np.float64]

_VELOCITIES = {2: 0, 3: 1}
_SIZES = (4, 5)

PARTICLE_PARAMETERS = ParameterTable([
    Parameter('preset', 'default', "The paper's own cues, or the strongest that there are; in "
              'force at the next start.', choices=('default', 'paper')),
    Parameter('particles', 150, 'Number of particles.', 2, 5000),
    Parameter('acceleration', 0.2, 'Standard deviation of the change of velocity a frame, as a '
              "share of the target's mean side.", 0.001, 2.0),
    Parameter('size_noise', 0.01, 'Standard deviation of the change of size a frame, as a share '
              'of the mean side (paper preset).', 0.001, 0.5),
    Parameter('cues', 'colour', 'Cues of the paper preset; in force at the next start.',
              choices=('colour', 'colour+motion_edge')),
    Parameter('kernel', 'flat', "Weights of a box's pixels in the colour histogram (paper "
              'preset); in force at the next start.', choices=('flat', 'epanechnikov')),
    Parameter('fusion', 'dempster_shafer', 'How the cues are fused (paper preset).',
              choices=tuple(FUSION_RULES)),
    Parameter('sigma', 0.1, 'Width of the likelihood exp(-(1 - rho) / (2 sigma^2)) (paper '
              'preset).', 0.01, 1.0),
    Parameter('temperature', 0.07, 'Share of the usual evidence that makes a factor of e in the '
              'likelihood (default preset).', 0.01, 1.0),
    Parameter('weighting', 'simplified', 'Weights by the likelihood alone, or times prior over '
              'proposal.', choices=('simplified', 'full')),
    Parameter('threshold', 1.0, 'Resample when the effective sample size falls below this share '
              'of the particles.', 0.0, 1.0),
])


class ParticleTracker(Tracker):
    """
    A particle filter over the target's box.

    The state is (cx, cy, vx, vy), and (w, h) beside it in the paper preset, in pixels and frames;
    it moves at nearly constant velocity [Zhu2012, eq. 19]. In the default preset the size is the
    scale regression's. A subclass gives the proposal, and says whether a measurement steers it.
    """

    PARAMETERS = PARTICLE_PARAMETERS
    _steered = False
    _filter: ParticleFilter

    @abstractmethod
    def _proposal(self, model: ConstantVelocity) -> Proposal:
        """Return the proposal for a model of motion."""

    def _configure(self) -> None:
        if self._frame_shape is None:
            return
        self._side = 0.0  # the model of motion and the filter are made anew
        if isinstance(self._observation, CueObservation):
            self._observation.sigma = float(self._parameters['sigma'])
            self._observation.fusion = str(self._parameters['fusion'])
        elif isinstance(self._observation, DiscriminativeObservation):
            self._observation.temperature = float(self._parameters['temperature'])

    def _start(self, frame: Frame, box: Box) -> Estimate:
        parameters = self._parameters
        if parameters['preset'] == 'paper':
            self._observation: Observation = CueObservation(
                str(parameters['cues']), str(parameters['fusion']), float(parameters['sigma']),
                str(parameters['kernel']), self._steered)
        else:
            self._observation = DiscriminativeObservation(
                self._rng, float(parameters['temperature']), self._steered)
        self._box = np.array([*box.center, box.width, box.height])
        self._observation.start(frame, self._box)
        self._side = 0.0
        self._restart()
        return self._estimate(
            Conclusion(self._box, 1.0), np.zeros((4, 4)), self._boxes(
                self._filter.belief.states))

    def _update(self, frame: Frame, dt: float) -> Estimate:
        self._adapt()
        belief = self._filter.belief
        predicted = self._box.copy()
        predicted[:2] += dt * belief.mean[2:4]
        measured = self._observation.look(frame, self._box, predicted)
        center, error = None, None
        if measured is not None:
            center, error = measured.center, GaussianNoise.from_covariance(measured.covariance)
        proposed = self._filter.propose(center, dt, error)
        boxes = self._boxes(proposed.states)
        step = self._filter.weight(proposed, self._observation.log_likelihood(boxes), dt)
        weights = step.belief.weights.values
        mean = weights @ boxes
        conclusion = self._observation.conclude(frame, mean, dt)
        self._box = conclusion.box
        if conclusion.jumped:
            self._restart()
        else:
            self._correct(conclusion.box)
        return self._estimate(conclusion, spread_about(mean, boxes, weights), boxes)

    def _adapt(self) -> None:
        """Make the model of motion anew when the target's size, or a parameter, has changed."""
        side = float(np.sqrt(self._box[2] * self._box[3]))
        if self._side and abs(side - self._side) < 0.1 * self._side:
            return
        belief = self._filter.belief
        self._filter = self._create_filter(side)
        self._filter.belief = belief
        if len(belief) != self._filter.particles:
            picked = self._rng.choice(len(belief), self._filter.particles, p=belief.weights.values)
            self._filter.set_particles(belief.states[picked])

    def _create_filter(self, side: float) -> ParticleFilter:
        parameters = self._parameters
        self._side = side
        model = ConstantVelocity(
            2, 2 if self._observation.sized else 0,
            (float(parameters['acceleration']) * side)**2,
            (float(parameters['size_noise']) * side)**2)
        return ParticleFilter(
            model, self._proposal(model), particles=int(parameters['particles']),
            threshold=float(parameters['threshold']), weighting=str(parameters['weighting']),
            rng=self._rng)

    def _restart(self) -> None:
        """Put the particles about the box, at rest."""
        side = float(np.sqrt(self._box[2] * self._box[3]))
        self._filter = self._create_filter(side)
        mean = np.array([*self._box[:2], 0.0, 0.0, *self._box[2:]])
        spread = np.array([0.03, 0.03, 0.05, 0.05, 0.02, 0.02]) * side
        n = self._filter.model.state_dimension
        self._filter.start(mean[:n], np.diag(spread[:n]**2))

    def _correct(self, box: Array) -> None:
        """Let the forecast build on the concluded place, not on the particles' mean."""
        estimates = self._filter.belief.estimates
        if estimates and not self._observation.sized:
            latest = estimates[-1].copy()
            latest[:2] = box[:2]
            self._filter.correct_estimate(latest)

    def _boxes(self, states: Array) -> Array:
        """Return the states' boxes, shape (N, 4)."""
        boxes = np.empty((len(states), 4))
        boxes[:, :2] = states[:, :2]
        boxes[:, 2:] = states[:, 4:] if self._observation.sized else self._box[2:]
        return boxes

    def _estimate(self, conclusion: Conclusion, covariance: Array, boxes: Array) -> Estimate:
        center_x, center_y, width, height = conclusion.box.tolist()
        unseen = conclusion.unseen_frames
        unknown = unknown_covariance(*self._observation.errors, width * height, unseen)
        return Estimate(
            box=Box.from_center(center_x, center_y, width, height), angle=0.0,
            covariance=covariance + unknown, confidence=conclusion.confidence,
            state=state_after(unseen), particles=boxes)


class ColourParticleFilter(ParticleTracker):
    """PF: the transition prior as the proposal (Condensation), the papers' baseline."""

    NAME = 'pf'
    SUMMARY = 'particle filter (Condensation), the baseline of the papers'

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        return PriorProposal()


class GreyParticleFilter(ParticleTracker):
    """
    GMPF: a grey forecast of the past estimates as the proposal [Zhu2012].

    Printed otherwise, and mended: eqs 14 and 16, see `estimation.grey`; the spread of eq. 17
    holds the square of the motion but not the doubt about it, here it's that of the particles
    moved on by the model; sizes aren't forecast, for what moves their series is noise; a share of
    the particles comes from the transition prior, as in Chen et al. (2009), which the paper
    cites, for a few wrong forecasts in a row carry all others away. The default preset moves the
    particles to the forecast in place of drawing from their Gaussian.
    """

    NAME = 'gmpf'
    SUMMARY = 'grey-prediction particle filter (GMPF)'
    PARAMETERS = PARTICLE_PARAMETERS + ParameterTable([
        Parameter('window', 5, 'Length m of the series that the grey model is fitted to.', 4, 20,
                  unit='frames'),
        Parameter('prior_share', 0.3, 'Share of the particles that the transition prior draws; '
                  'the paper has none.', 0.0, 0.9),
        Parameter('floor', 1.0, "How much of the process noise is added to the proposal's "
                  'covariance.', 0.001, 100.0),
    ])

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        parameters = self._parameters
        return GreyProposal(
            int(parameters['window']), float(parameters['floor']),
            spread='predicted' if self._observation.sized else 'moved',
            prior_share=float(parameters['prior_share']),
            densities=parameters['weighting'] == 'full', velocities=_VELOCITIES,
            steady=_SIZES if self._observation.sized else ())


class KalmanParticleFilter(ParticleTracker):
    """KPF: a Kalman filter for each particle as the proposal [Zhu2012, sec. 5]."""

    NAME = 'kpf'
    SUMMARY = 'Kalman particle filter (KPF)'
    _steered = True

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        return GaussianFilterProposal(KalmanFilter(model))


class UnscentedParticleFilter(ParticleTracker):
    """UPF: an unscented Kalman filter for each particle as the proposal [Zhu2012, sec. 5]."""

    NAME = 'upf'
    SUMMARY = 'unscented particle filter (UPF)'
    _steered = True

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        return GaussianFilterProposal(SigmaPointFilter(model, unscented))


class QuadratureParticleFilter(ParticleTracker):
    """QKPF: a quadrature Kalman filter for each particle as the proposal [Qi2012]."""

    NAME = 'qkpf'
    SUMMARY = 'quadrature Kalman particle filter (QKPF)'
    PARAMETERS = PARTICLE_PARAMETERS + ParameterTable([
        Parameter('cues', 'colour+motion_edge', 'Cues of the paper preset; in force at the '
                  'next start.',
                  choices=('colour', 'colour+motion_edge')),
        Parameter('kernel', 'epanechnikov', "Weights of a box's pixels in the colour histogram "
                  '(paper preset); in force at the next start.',
                  choices=('flat', 'epanechnikov')),
        Parameter('order', 3, 'Gauss-Hermite points in each dimension.', 2, 7),
        Parameter('threshold', 0.5, 'Resample when the effective sample size falls below this '
                  'share of the particles.', 0.0, 1.0),
    ])
    _steered = True

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        rule = partial(gauss_hermite, order=int(self._parameters['order']))
        return GaussianFilterProposal(SigmaPointFilter(model, rule))


class PrunedQuadratureParticleFilter(QuadratureParticleFilter):
    """P-QKPF: the quadrature filter without its light points [Qi2012, eqs 20-22]."""

    NAME = 'pqkpf'
    SUMMARY = 'pruned quadrature Kalman particle filter (P-QKPF)'

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        rule = partial(pruned_gauss_hermite, order=int(self._parameters['order']))
        return GaussianFilterProposal(SigmaPointFilter(model, rule))
