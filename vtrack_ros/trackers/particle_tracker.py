"""Particle filters over the target's place: one tracker, three proposals."""

from abc import abstractmethod
from dataclasses import replace
from functools import partial
import math

import numpy as np

from vtrack_ros.estimation import (
    ConstantVelocity, GaussianFilterProposal, GaussianNoise, GreyProposal, ParticleFilter,
    PriorProposal, Proposal, pruned_gauss_hermite, SigmaPointFilter, spread_about)
from vtrack_ros.frame import Array, Frame, Point
from vtrack_ros.geometry import Box
from vtrack_ros.localisation import Found
from vtrack_ros.localisation.filter_parameters import LOCALISER, MOTION, RESAMPLING, WEIGHTING
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Estimate
from vtrack_ros.trackers.localised_tracker import LocalisedTracker

#: Standard deviation of the measured centre, as a share of the target's mean side, where the
#: response is the usual one.
_MEASURED_ERROR = 0.05
#: Relative change of the target's size at which the motion model is made anew.
_OTHER_SIZE = 0.1
#: Distance of the particles' mean from the target, in sides, above which they are shifted to it.
_SHIFT_DISTANCE = 0.25
#: Particles have missed the target if their weighted mean response is below this share of that at
#: the target's place.
_MISSED = 0.8
#: Standard deviations of place and velocity at the start, as shares of the mean side.
_START = np.array([0.03, 0.03, 0.05, 0.05])

_SHARED = MOTION + ParameterTable([
    Parameter('temperature', 0.07, 'Temperature of the likelihood exp(response / (temperature * '
              'r)), where r is the running mean of the response at the target. A larger value '
              'weights the particles more equally.', 0.01, 1.0),
]) + RESAMPLING + LOCALISER


class ParticleTracker(LocalisedTracker):
    """
    A particle filter whose forecast guides the search.

    The state is (cx, cy, vx, vy), in pixels and frames, at nearly constant velocity [Zhu2012, eq.
    19]; the size is the scale regression's. The filter's prediction is one of the forecasts that
    the search weighs against the response, with a weight by its recent errors. The maximum that
    the search finds is the estimate, since a weighted mean is no more exact than the particles are
    dense. The response is the particles' likelihood, and their spread is the covariance; if they
    are far from the estimate, they are shifted to it. Where they have missed a target that is seen
    all the same, as after a pause, their spread isn't used. A subclass gives the proposal.
    """

    PARAMETERS = _SHARED
    _filter: ParticleFilter

    @abstractmethod
    def _proposal(self, model: ConstantVelocity) -> Proposal:
        """Return the proposal for a motion model."""

    def _forecast(self, dt: float) -> Point | None:
        """Return where this filter expects the target, in pixels, or None if it can't say."""
        belief = self._filter.belief
        mean = belief.weights.values @ belief.states
        x, y = self._filter.model.transition(mean[None], dt, belief.time)[0, :2]
        return float(x), float(y)

    def _measured(self, found: Found) -> tuple[Array, GaussianNoise] | tuple[None, None]:
        """Return the measured centre and its error, for a proposal that uses them."""
        return None, None

    def _configure(self) -> None:
        # 0: the motion model and the filter are made anew in the next frame
        self._side = 0.0

    def _start(self, frame: Frame, box: Box) -> Estimate:
        self._begin(frame, box)
        return self._restart()

    def _update(self, frame: Frame, dt: float) -> Estimate:
        self._adjust()
        self._adapt()
        localiser = self._localiser
        found = self._search.search(frame, dt, self._forecast(dt))
        response = found.response
        center, error = self._measured(found)
        proposed = self._filter.propose(center, dt, error)
        _bound(proposed.states, frame, dt)
        boxes = self._boxes(proposed.states[:, :2])
        responses = response.sample(proposed.states[:, :2])
        likelihood = responses * (
            1 / (float(self._parameters['temperature']) * localiser.response_unit))
        # while a distractor hides the target, the response doesn't measure its place
        weights = self._filter.weight(
            proposed, None if found.hidden else likelihood, dt).weights.values
        mean = weights @ boxes
        elsewhere = localiser.update(frame, found, dt)
        self._search.follow(dt, elsewhere)
        if elsewhere:
            return self._restart()
        self._correct(mean[:2])
        seen = not (found.hidden or localiser.uncertain or localiser.unseen_frames)
        missed = seen and weights @ responses < _MISSED * response.sample_one(found.place)
        covariance = np.zeros((4, 4)) if missed else spread_about(mean, boxes, weights)
        return localiser.estimate(covariance, boxes)

    def _adapt(self) -> None:
        """Make the filter anew when the target's size, or a parameter, has changed."""
        side = math.sqrt(math.prod(self._localiser.size))
        if self._side and abs(side - self._side) < _OTHER_SIZE * self._side:
            return
        belief = self._filter.belief
        self._filter = self._create_filter(side)
        self._filter.resume(belief)

    def _create_filter(self, side: float) -> ParticleFilter:
        parameters = self._parameters
        self._side = side
        model = ConstantVelocity(
            2, acceleration_density=(float(parameters['acceleration']) * side)**2)
        return ParticleFilter(
            model, self._proposal(model), particles=int(parameters['particles']),
            threshold=float(parameters['threshold']),
            weighting=str(parameters.get('weighting', 'simplified')), rng=self._rng)

    def _restart(self) -> Estimate:
        """Put the particles about the target's place, at rest, and return the estimate."""
        side = math.sqrt(math.prod(self._localiser.size))
        self._filter = self._create_filter(side)
        self._filter.start(
            np.array([*self._localiser.center, 0.0, 0.0]), np.diag((_START * side)**2))
        return self._localiser.estimate(
            np.zeros((4, 4)), self._boxes(self._filter.belief.states[:, :2]))

    def _correct(self, mean: Array) -> None:
        """Let the next forecast start at the target's place; shift particles far from it there."""
        center, belief = self._localiser.center, self._filter.belief
        if math.dist(center, mean.tolist()) > _SHIFT_DISTANCE * self._side:
            states = belief.states.copy()
            states[:, :2] += center - mean
            belief = self._filter.belief = replace(belief, states=states)
        estimates = belief.estimates
        if estimates:
            latest = estimates[-1].copy()
            latest[:2] = center
            self._filter.correct_estimate(latest)


def _bound(states: Array, frame: Frame, dt: float) -> None:
    """Clamp places to one frame size about the frame, velocities to crossing that in a step."""
    height, width = frame.shape[:2]
    across, down = 3 * width / dt, 3 * height / dt
    np.maximum(states, (-width, -height, -across, -down), out=states)
    np.minimum(states, (2 * width, 2 * height, across, down), out=states)


class PriorParticleFilter(ParticleTracker):
    """PF: the transition prior as the proposal (Condensation), the papers' baseline."""

    NAME = 'pf'
    SUMMARY = 'particle filter (Condensation), the baseline of the papers'

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        return PriorProposal()


class GreyParticleFilter(ParticleTracker):
    """
    GMPF: a grey forecast of the past estimates as the proposal [Zhu2012].

    Differences from the printed method: eqs 14 and 16 are corrected, see `estimation.grey`; the
    particles are moved to the forecast, not drawn from a Gaussian, whose covariance (eq. 17)
    contains the square of the motion but not its uncertainty; a share of them is drawn from the
    transition prior, as in Chen et al. (2009), which the paper cites, since a few wrong forecasts
    in a row carry all the others away.
    """

    NAME = 'gmpf'
    SUMMARY = 'grey-prediction particle filter (GMPF)'
    PARAMETERS = _SHARED + WEIGHTING + ParameterTable([
        Parameter('window', 5, 'Number m of past estimates that the grey model is fitted to.', 4,
                  20, unit='frames'),
        Parameter('prior_share', 0.3, 'Fraction of the particles that are drawn from the '
                  'transition prior instead of the grey forecast; 0 in the paper.', 0.0, 0.9),
        Parameter('floor', 1.0, 'Covariance of the noise added to the particles at the grey '
                  "forecast, as a multiple of the motion model's process noise. A larger value "
                  'spreads them wider.', 0.001, 100.0),
    ])

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        parameters = self._parameters
        self._grey = GreyProposal(
            int(parameters['window']), float(parameters['floor']), spread='moved',
            prior_share=float(parameters['prior_share']),
            densities=parameters['weighting'] == 'full', velocities={2: 0, 3: 1})
        return self._grey

    def _forecast(self, dt: float) -> Point | None:
        forecast = self._grey.forecast(self._filter.belief, dt)
        return None if forecast is None else (float(forecast[0]), float(forecast[1]))


class PrunedQuadratureParticleFilter(ParticleTracker):
    """P-QKPF: a pruned quadrature Kalman filter for each particle [Qi2012, eq. 20]."""

    NAME = 'pqkpf'
    SUMMARY = 'pruned quadrature Kalman particle filter (P-QKPF)'
    PARAMETERS = _SHARED + WEIGHTING + ParameterTable([
        Parameter('order', 3, 'Number of Gauss-Hermite points per dimension; more take more time '
                  'per frame.', 2, 7),
        Parameter('threshold', 0.5, 'Resample when the effective sample size falls below this '
                  'fraction of the number of particles; 0: never.', 0.0, 1.0),
    ])

    def _proposal(self, model: ConstantVelocity) -> Proposal:
        rule = partial(pruned_gauss_hermite, order=int(self._parameters['order']))
        return GaussianFilterProposal(SigmaPointFilter(model, rule))

    def _measured(self, found: Found) -> tuple[Array, GaussianNoise] | tuple[None, None]:
        """Measure the centre where the search has found it, while the target is seen."""
        localiser = self._localiser
        if found.hidden or localiser.unseen_frames:
            return None, None
        quality = min(max(found.response.peak / localiser.response_unit, 0.2), 1.0)
        error = _MEASURED_ERROR * math.sqrt(math.prod(localiser.size)) / quality
        return np.array(found.place), GaussianNoise.from_covariance(error**2 * np.eye(2))
