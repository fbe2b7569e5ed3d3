"""Proposals of the particle filter: what they sample, and the density that they return."""

import math

from example_filter import make
from nonlinear_models import VanDerMerweModel
import numpy as np
import pytest
from random_walk import RandomWalk

from vtrack_ros.estimation import (
    Belief, ConstantVelocity, ExtendedKalmanFilter, Gaussian, GaussianFilterProposal,
    GaussianNoise, GreyProposal, KalmanFilter, ParticleFilter, spread_about, Weights)


def test_the_grey_proposal_is_the_prior_until_there_are_enough_estimates():
    grey, prior = make(proposal=GreyProposal(window=5)), make()
    target = np.array([1.0, 0.0])
    for step in range(8):
        # The start counts as the first estimate: the fifth step, k = m, is the first grey one.
        assert (grey.propose(target).log_density is None) == (step < 4)
        grey.belief, prior.belief = prior.belief, prior.belief
        grey, prior = make(proposal=GreyProposal(window=5)), make()
        for _ in range(step + 1):
            same = np.array_equal(grey.step(target).mean, prior.step(target).mean)
        assert same == (step < 4)


def test_the_grey_density_is_the_one_that_it_samples():
    model = RandomWalk(1.0, 0.5, 1.0)
    states = np.random.default_rng(2).normal(10.0, 2.0, (40000, 1))
    estimates = tuple(np.array([value]) for value in (6.0, 7.0, 8.0, 9.0, 10.0))
    belief = Belief(states, Weights.uniform(40000), 5.0, None, estimates,
                    (1.0, 2.0, 3.0, 4.0, 5.0))
    proposal = GreyProposal(floor=2.0)
    forecast = proposal.forecast(belief, 1.0)
    proposed = proposal.propose(model, belief, 1.0, np.random.default_rng(3))
    variance = ((states - forecast) ** 2).mean() + 2.0 * 0.5
    drawn = proposed.states[:, 0]
    assert abs(drawn.mean() - forecast[0]) < 5 * math.sqrt(variance / 40000)
    assert drawn.var() == pytest.approx(variance, rel=5 * math.sqrt(2 / 40000))
    expected = (-0.5 * (drawn - forecast[0]) ** 2 / variance
                - 0.5 * math.log(2 * math.pi * variance))
    np.testing.assert_allclose(proposed.log_density, expected, rtol=1e-9)


def _two_modes():
    """Return a moving belief of two modes, whose past estimates give a forecast elsewhere."""
    rng = np.random.default_rng(2)
    states = rng.normal((0.0, 1.0), (0.5, 0.1), (20000, 2))
    states[::2, 0] += 30.0
    weights = Weights.from_log(np.where(np.arange(20000) % 2, 0.0, math.log(3.0)))
    estimates = tuple(np.array([10.0 * step, 10.0]) for step in range(5))
    return Belief(states, weights, 4.0, None, estimates, tuple(np.arange(5.0)))


@pytest.mark.parametrize('floor', [1.0, 4.0])
@pytest.mark.parametrize('spread', ['predicted', 'moved'])
def test_the_grey_density_has_the_predicted_particles_spread(spread, floor):
    """Its mean is g_k, its covariance theirs plus the floor; only 'moved' keeps the modes."""
    belief = _two_modes()
    model = ConstantVelocity(1, acceleration_density=0.3)
    proposal = GreyProposal(floor=floor, spread=spread, velocities={1: 0})
    drawn = proposal.propose(model, belief, 1.0, np.random.default_rng(3)).states
    weights = belief.weights.values
    forecast = proposal.forecast(belief, 1.0)
    np.testing.assert_allclose(weights @ drawn, forecast, atol=0.05)
    moved = model.transition(belief.states, 1.0)
    expected = spread_about(weights @ moved, moved, weights) + floor * model.process_noise(1.0)
    np.testing.assert_allclose(spread_about(weights @ drawn, drawn, weights), expected,
                               rtol=0.05, atol=0.05)
    apart = 30.0 if spread == 'moved' else 0.0
    np.testing.assert_allclose(drawn[::2, 0].mean() - drawn[1::2, 0].mean(), apart, atol=0.6)


@pytest.mark.parametrize('share', [0.0, 0.3])
def test_the_density_of_moved_particles_is_that_of_each_one_s_own_successor(share):
    """Weighted by prior over proposal density, the moved particles have the prior's mean."""
    belief = _two_modes()
    model = ConstantVelocity(1, acceleration_density=400.0)
    proposal = GreyProposal(floor=2.0, spread='moved', prior_share=share, velocities={1: 0})
    proposed = proposal.propose(model, belief, 1.0, np.random.default_rng(3))
    log_ratio = model.log_transition(proposed.states, belief.states, 1.0) - proposed.log_density
    weights = belief.weights.values * np.exp(log_ratio)
    assert weights.sum() == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(
        weights @ proposed.states / weights.sum(),
        belief.weights.values @ model.transition(belief.states, 1.0), atol=1.5)


def test_the_floor_keeps_a_collapsed_set_alive():
    """The spread of one point about its own forecast is zero: without a floor nothing moves."""
    model = ConstantVelocity(1, acceleration_density=4.0)
    state = np.array([5.0, 0.0])
    belief = Belief(np.tile(state, (1000, 1)), Weights.uniform(1000), 4.0, None, (state,) * 5,
                    (0.0, 1.0, 2.0, 3.0, 4.0))
    drawn = GreyProposal().propose(model, belief, 1.0, np.random.default_rng(4)).states
    np.testing.assert_allclose(np.cov(drawn.T), model.process_noise(1.0), rtol=0.25)


def test_without_a_floor_the_spread_is_that_of_the_paper():
    """Equation 17 alone; a collapsed set is then moved by the transition prior."""
    model = ConstantVelocity(1, acceleration_density=4.0)
    states = np.random.default_rng(5).normal((5.0, 0.0), (2.0, 0.5), (40000, 2))
    past = tuple(np.array([5.0 - 4 + step, 0.0]) for step in range(5))
    belief = Belief(states, Weights.uniform(len(states)), 4.0, None, past, tuple(np.arange(5.0)))
    proposal = GreyProposal(floor=0.0)
    drawn = proposal.propose(model, belief, 1.0, np.random.default_rng(6))
    about = states - proposal.forecast(belief, 1.0)
    np.testing.assert_allclose(np.cov(drawn.states.T), about.T @ about / len(about), atol=0.1)
    collapsed = Belief(np.tile(past[-1], (4, 1)), Weights.uniform(4), 4.0, None, past[-1:] * 5,
                       tuple(np.arange(5.0)))
    assert proposal.propose(model, collapsed, 1.0, np.random.default_rng(7)).log_density is None


def test_a_dropped_frame_is_forecast_as_two_steps():
    positions = 10.0 + 3.0 * np.arange(5)
    estimates = tuple(np.array([position, 3.0]) for position in positions)
    belief = Belief(np.zeros((1, 2)), Weights.uniform(1), 9.0, None, estimates,
                    (7.0, 7.5, 8.0, 8.5, 9.0))
    proposal = GreyProposal(margin=1000.0, velocities={1: 0})
    once, twice = proposal.forecast(belief, 0.5), proposal.forecast(belief, 1.0)
    np.testing.assert_allclose(once, [25.0, 6.0], atol=0.1)
    np.testing.assert_allclose(twice, [28.0, 6.0], atol=0.1)


def test_a_steady_component_is_expected_to_stay():
    """Its forecast is its last value, whatever its series; the others' are by their series."""
    series = np.array([[3.0, 10.0], [5.0, 11.0], [7.0, 9.0], [9.0, 14.0], [11.0, 12.0]])
    belief = Belief(np.zeros((2, 2)), Weights.uniform(2), 4.0, None,
                    tuple(series), tuple(np.arange(5.0)))
    moving = GreyProposal(margin=1000.0).forecast(belief, 1.0)
    steady = GreyProposal(margin=1000.0, steady=(1,)).forecast(belief, 1.0)
    assert steady[0] == moving[0] == pytest.approx(13.0, abs=0.05)
    assert steady[1] == 12.0 != moving[1]


def test_a_share_of_prior_particles_bounds_the_weights():
    model = ConstantVelocity(2, 2)
    particle_filter = make(model, GreyProposal(prior_share=0.25), particles=500)
    for step in range(6):
        particle_filter.step(np.array([step, 0.0]))
    for _ in range(5):
        belief = particle_filter.belief
        proposed = particle_filter.propose()
        ratio = model.log_transition(proposed.states, belief.states, 1.0) - proposed.log_density
        assert (ratio <= math.log(1 / 0.25) + 1e-9).all()
        particle_filter.weight(proposed, None)


@pytest.mark.parametrize('options, name', [
    ({'covariance': 'lost'}, 'covariance'), ({'inflation': -0.1}, 'inflation'),
    ({'inflation': math.nan}, 'inflation')])
def test_wrong_options_of_the_gaussian_proposal_are_refused(options, name):
    with pytest.raises(ValueError, match=name):
        GaussianFilterProposal(KalmanFilter(ConstantVelocity(1)), **options)


def test_the_gaussian_proposal_s_density_is_the_one_that_it_samples():
    """With a common predecessor, all come from one posterior, inflated by the prediction."""
    model = ConstantVelocity(1, 0, 0.5, 1.0, [[0.4]])
    states = np.tile([3.0, -1.0], (40000, 1))
    belief = Belief(states, Weights.uniform(40000))
    kalman = KalmanFilter(model)
    proposed = GaussianFilterProposal(kalman, inflation=0.3).propose(
        model, belief, 1.0, np.random.default_rng(5), np.array([2.5]))
    noise = model.process_noise(1.0)
    posterior = kalman.update(Gaussian.from_moments([2.0, -1.0], noise), np.array([2.5])).posterior
    covariance = posterior.covariance[0] + 0.3 * noise
    error = proposed.states - posterior.mean[0]
    spread = np.sqrt(covariance.diagonal())
    assert (np.abs(error.mean(axis=0)) < 5 * spread / 200).all()
    np.testing.assert_allclose(np.cov(error.T), covariance,
                               atol=5 * math.sqrt(2 / 40000) * spread.max() ** 2)
    expected = GaussianNoise.from_covariance(covariance).log_density(error)
    np.testing.assert_allclose(proposed.log_density, expected, rtol=1e-9, atol=1e-9)


def test_the_gaussian_proposal_measures_at_the_end_of_the_step():
    """The measurement of van der Merwe's model changes from time 30 to 31."""
    model, measurement = VanDerMerweModel(measurement_variance=0.05), np.array([0.7])
    kalman = ExtendedKalmanFilter(model)
    belief = Belief(np.full((20000, 1), 4.0), Weights.uniform(20000), 30.0)
    predicted = Gaussian(model.transition(belief.states[:1], 1.0, 30.0),
                         model.process_noise(1.0)[np.newaxis])
    posterior = kalman.update(predicted, measurement, 31.0).posterior
    drawn = GaussianFilterProposal(kalman).propose(
        model, belief, 1.0, np.random.default_rng(8), measurement).states
    spread = math.sqrt(posterior.covariance[0, 0, 0])
    assert drawn.mean() == pytest.approx(posterior.mean[0, 0], abs=5 * spread / math.sqrt(20000))
    assert drawn.std() == pytest.approx(spread, rel=0.03)


def test_kept_covariances_are_those_of_each_particle_s_own_filter():
    model = ConstantVelocity(1, 0, 0.5, 1.0, [[0.4]])
    kalman, measurement = KalmanFilter(model), np.array([2.5])
    states, covariances = np.array([[0.0, 0.5], [3.0, -1.0]]), np.array([np.eye(2), 2 * np.eye(2)])
    belief = Belief(states, Weights.uniform(2), 0.0, covariances)
    predicted = kalman.predict(Gaussian(states, covariances), 1.0)
    posterior = kalman.update(predicted, measurement).posterior
    kept, reset = (GaussianFilterProposal(kalman, covariance) for covariance in ('kept', 'reset'))
    for seen, expected in ((measurement, posterior), (None, predicted)):
        rng = np.random.default_rng(6)
        proposed = kept.propose(model, belief, 1.0, rng, seen)
        np.testing.assert_allclose(proposed.covariances, expected.covariance)
        assert reset.propose(model, belief, 1.0, rng, seen).covariances is None


@pytest.mark.parametrize('options, name', [
    ({'window': 3}, 'window'), ({'floor': -0.1}, 'floor'), ({'floor': math.inf}, 'floor'),
    ({'floor': 0.0, 'spread': 'moved'}, 'floor'), ({'margin': -1.0}, 'margin'),
    ({'spread': 'wide'}, 'spread'), ({'prior_share': 1.0}, 'prior_share')])
def test_wrong_options_of_the_grey_proposal_are_refused(options, name):
    with pytest.raises(ValueError, match=name):
        GreyProposal(**options)


@pytest.mark.parametrize('share', [0.0, 0.3])
def test_simplified_weights_need_no_densities_of_the_grey_samples(share):
    """The same random numbers give the same particles and weights, with or without them."""
    runs = []
    for densities in (True, False):
        model = ConstantVelocity()
        proposal = GreyProposal(prior_share=share, densities=densities)
        loop = ParticleFilter(model, proposal, particles=50, weighting='simplified',
                              rng=np.random.default_rng(1))
        loop.start(np.zeros(4), np.eye(4))
        for k in range(8):
            step = loop.step(np.array([1.0 * k, 0.0]))
        runs.append(step)
    np.testing.assert_array_equal(runs[0].states, runs[1].states)
    np.testing.assert_array_equal(runs[0].weights.values, runs[1].weights.values)
