"""The particle filter's loop: convergence to the Kalman filter, recovery, state, errors."""

import doctest
import math

from nonlinear_models import VanDerMerweModel
import numpy as np
import pytest
from random_walk import RandomWalk

from vtrack_ros import estimation
from vtrack_ros.estimation import (
    Belief, ConstantVelocity, ExtendedKalmanFilter, Gaussian, GaussianFilterProposal,
    GaussianNoise, GreyProposal, KalmanFilter, ParticleFilter, PriorProposal, spread_about,
    Weights)


def make(model=None, proposal=None, **options):
    options.setdefault('particles', 200)
    options.setdefault('rng', np.random.default_rng(1))
    particle_filter = ParticleFilter(model or ConstantVelocity(2, 2), proposal, **options)
    dimension = particle_filter.model.state_dimension
    particle_filter.start(np.zeros(dimension), np.eye(dimension))
    return particle_filter


def test_the_example_of_the_overview_runs():
    outcome = doctest.testmod(estimation)
    assert outcome.attempted and not outcome.failed


def test_without_a_likelihood_a_step_is_a_prediction():
    model = ConstantVelocity(1, acceleration_density=0.3)
    particle_filter = make(model, particles=20000)
    mean, covariance = np.array([3.0, -1.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
    particle_filter.start(mean, covariance, time=4.0)
    result = particle_filter.step(dt=0.5)
    matrix = model.transition_matrix(0.5)
    predicted = matrix @ covariance @ matrix.T + model.process_noise(0.5)
    error = np.sqrt(predicted.diagonal() / 20000)
    assert (np.abs(result.mean - matrix @ mean) < 5 * error).all()
    # The standard error of a variance v from N samples is v sqrt(2 / N).
    np.testing.assert_allclose(result.covariance, predicted,
                               atol=5 * math.sqrt(2 / 20000) * predicted.max())
    assert result.time == particle_filter.belief.time == 4.5
    assert result.weights.log_evidence == pytest.approx(0.0)
    assert particle_filter.belief is result


def test_a_likelihood_may_be_any_function_of_the_states():
    particle_filter = make(particles=5000)
    seen = []

    def log_likelihood(states):
        seen.append(states.shape)
        return np.where(states[:, 0] > 0, 0.0, -np.inf)

    result = particle_filter.step(log_likelihood=log_likelihood)
    assert seen == [(5000, 6)]
    inside = result.states[:, 0] > 0
    np.testing.assert_allclose(result.weights.values[~inside], 0.0)
    assert math.exp(result.weights.log_evidence) == pytest.approx(inside.mean())
    assert (particle_filter.belief.states[:, 0] > 0).all() == (
        particle_filter.belief is not result)


def test_propose_and_weight_are_a_step():
    one, two = make(), make()
    for step in range(8):
        target = np.array([step, 0.0])
        result = one.step(target)
        proposed = two.propose(target)
        other = two.weight(proposed, two.model.log_likelihood(proposed.states, target))
        np.testing.assert_array_equal(result.mean, other.mean)
    np.testing.assert_array_equal(one.belief.states, two.belief.states)


def test_the_estimate_is_taken_before_resampling():
    particle_filter = make(threshold=1.0)
    result = particle_filter.step(np.array([1.0, 1.0]))
    assert particle_filter.belief is not result
    weights = result.weights.values
    np.testing.assert_allclose(result.mean, weights @ result.states)
    deviation = result.states - result.mean
    np.testing.assert_allclose(result.covariance, (deviation.T * weights) @ deviation)
    np.testing.assert_allclose(particle_filter.belief.weights.values, 1 / 200)


@pytest.mark.parametrize('threshold, resampled', [(0.0, False), (1.0, True)])
def test_the_threshold_decides_on_resampling(threshold, resampled):
    particle_filter = make(threshold=threshold)
    for _ in range(5):
        result = particle_filter.step(np.array([0.5, 0.5]))
        assert (particle_filter.belief is not result) == resampled


@pytest.mark.parametrize('value', [-math.inf, math.nan])
@pytest.mark.parametrize('proposal', [PriorProposal(), GreyProposal()])
def test_nothing_explains_the_measurement(value, proposal):
    """The measurement is ignored and counted, and the filter lives on."""
    particle_filter = make(proposal=proposal, threshold=0.0)
    for _ in range(6):
        particle_filter.step(np.array([0.1, 0.1]))
    before = particle_filter.belief.weights.values
    result = particle_filter.step(log_likelihood=lambda states: np.full(len(states), value))
    assert result.weights.recovered and particle_filter.recoveries == 1
    np.testing.assert_array_equal(result.weights.values, before)
    assert np.isfinite(result.mean).all() and np.isfinite(result.covariance).all()
    again = particle_filter.step(np.array([0.1, 0.1]))
    assert not again.weights.recovered and particle_filter.recoveries == 1


@pytest.mark.parametrize('proposal', [PriorProposal(), GreyProposal(), GreyProposal(margin=None)])
def test_the_seed_decides(proposal):
    runs = []
    for _ in range(2):
        particle_filter = make(proposal=proposal)
        runs.append([particle_filter.step(np.array([0.2 * k, 0.0])).mean for k in range(12)])
    np.testing.assert_array_equal(*runs)


def test_a_belief_can_be_carried_to_another_filter():
    first = make(proposal=GreyProposal())
    for step in range(7):
        first.step(np.array([step, step]))
    outcomes = []
    for _ in range(2):
        other = make(proposal=GreyProposal(), rng=np.random.default_rng(7))
        other.belief = first.belief
        outcomes.append(other.step(np.array([7.0, 7.0])).mean)
    np.testing.assert_array_equal(*outcomes)


@pytest.mark.parametrize('covariance', ['reset', 'kept'])
def test_particles_put_by_the_caller_keep_time_and_memory(covariance):
    model = ConstantVelocity(2, 2)
    proposals = (GreyProposal(), GaussianFilterProposal(KalmanFilter(model), covariance))
    for proposal in proposals:
        particle_filter = make(model, proposal)
        for step in range(7):
            particle_filter.step(np.array([step, step]))
        kept = particle_filter.belief
        belief = particle_filter.set_particles(
            np.random.default_rng(9).normal(2.0, 1.0, (50, 6)))
        assert len(belief) == 50 and belief.time == kept.time
        assert belief.estimates == kept.estimates
        result = particle_filter.step(np.array([7.0, 7.0]))
        assert len(result) == 50 and np.isfinite(result.mean).all()


def test_particles_may_be_set_without_a_start():
    particle_filter = ParticleFilter(ConstantVelocity(1), rng=np.random.default_rng(1))
    with pytest.raises(ValueError, match='start'):
        particle_filter.step()
    particle_filter.set_particles([[0.0, 1.0], [2.0, 1.0]], np.log([0.25, 0.75]))
    np.testing.assert_allclose(particle_filter.belief.mean, [1.5, 1.0])


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
    """Return a belief of two modes, moving, whose past estimates are forecast elsewhere."""
    rng = np.random.default_rng(2)
    states = rng.normal((0.0, 1.0), (0.5, 0.1), (20000, 2))
    states[::2, 0] += 30.0
    weights = Weights.from_log(np.where(np.arange(20000) % 2, 0.0, math.log(3.0)))
    estimates = tuple(np.array([10.0 * step, 10.0]) for step in range(5))
    return Belief(states, weights, 4.0, None, estimates, tuple(np.arange(5.0)))


@pytest.mark.parametrize('floor', [1.0, 4.0])
@pytest.mark.parametrize('spread', ['predicted', 'moved'])
def test_the_grey_density_has_the_predicted_particles_spread(spread, floor):
    """Its mean is g_k, its covariance theirs and the floor; only moved particles keep modes."""
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
    """Weighted prior over proposal, the moved particles are distributed like the prior's."""
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
    """It is forecast as it was last, whatever its series; the others by their own."""
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


def test_simplified_weights_are_the_likelihood_alone():
    particle_filter = make(proposal=GreyProposal(), weighting='simplified', threshold=1.0)
    for step in range(8):
        target = np.array([0.3 * step, 0.0])
        result = particle_filter.step(target)
    likelihood = np.exp(particle_filter.model.log_likelihood(result.states, target))
    np.testing.assert_allclose(result.weights.values, likelihood / likelihood.sum())


def test_full_weights_are_the_paper_s():
    """The weight of [Zhu2012, eq. 5], from the densities themselves."""
    model = ConstantVelocity(2, 2)
    particle_filter = make(model, GreyProposal(), threshold=0.0)
    for step in range(8):
        target = np.array([0.3 * step, 0.0])
        before = particle_filter.belief
        proposed = particle_filter.propose(target)
        result = particle_filter.weight(proposed, model.log_likelihood(proposed.states, target))
    log_weight = (before.weights.logarithms
                  + model.log_likelihood(proposed.states, target)
                  + model.log_transition(proposed.states, before.states, 1.0)
                  - proposed.log_density)
    expected = np.exp(log_weight - log_weight.max())
    np.testing.assert_allclose(result.weights.values, expected / expected.sum())


@pytest.mark.parametrize('options, name', [
    ({'particles': 0}, 'particles'), ({'particles': 1.5}, 'particles'),
    ({'particles': math.nan}, 'particles'), ({'particles': 'many'}, 'particles'),
    ({'threshold': 1.5}, 'threshold'), ({'threshold': math.nan}, 'threshold'),
    ({'weighting': 'none'}, 'full, simplified')])
def test_wrong_options_are_refused(options, name):
    with pytest.raises(ValueError, match=name):
        make(**options)


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


def test_wrong_input_of_a_step_is_refused_and_changes_nothing():
    particle_filter = make()
    before = particle_filter.belief
    for arguments, name in [
            ({'measurement': [1.0]}, 'measurement'), ({'measurement': [1.0, math.nan]}, 'finite'),
            ({'dt': 0.0}, 'dt'), ({'dt': math.nan}, 'dt'),
            ({'log_likelihood': lambda states: np.zeros(3)}, 'log_likelihood')]:
        with pytest.raises(ValueError, match=name):
            particle_filter.step(**arguments)
    assert particle_filter.belief is before


def test_a_wrong_start_is_refused():
    particle_filter = make()
    not_definite = np.eye(6)
    not_definite[0, 0] = -1.0
    lopsided = np.eye(6)
    lopsided[0, 1] = 0.5
    for mean, covariance, name in [
            (np.zeros(5), np.eye(6), 'mean'), (np.zeros(6), np.eye(5), 'covariance'),
            (np.zeros(6), not_definite, 'covariance'), (np.zeros(6), lopsided, 'covariance'),
            (np.full(6, math.nan), np.eye(6), 'mean')]:
        with pytest.raises(ValueError, match=name):
            particle_filter.start(mean, covariance)
    with pytest.raises(ValueError, match='states'):
        particle_filter.set_particles(np.zeros((3, 5)))
    with pytest.raises(ValueError, match='states'):
        particle_filter.set_particles(np.zeros((0, 6)))


def test_a_belief_of_other_shapes_is_refused():
    with pytest.raises(ValueError, match='states'):
        Belief(np.zeros((3, 2)), Weights.uniform(4))
    with pytest.raises(ValueError, match='covariances'):
        Belief(np.zeros((3, 2)), Weights.uniform(3), 0.0, np.zeros((3, 3, 3)))
    with pytest.raises(ValueError, match='estimate'):
        Belief(np.zeros((3, 2)), Weights.uniform(3), 0.0, None, (np.zeros(2),))


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
