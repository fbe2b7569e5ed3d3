"""The particle filter's loop: convergence to the Kalman filter, recovery, state, errors."""

import doctest
import math

from example_filter import make
import numpy as np
import pytest

from vtrack_ros import estimation
from vtrack_ros.estimation import (
    Belief, ConstantVelocity, GaussianFilterProposal, GreyProposal, KalmanFilter, ParticleFilter,
    PriorProposal, Weights)


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
    """The measurement is ignored and counted, and the filter goes on."""
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


def test_particles_that_are_refused_change_nothing():
    particle_filter = make(particles=30, threshold=1.0)
    kept = particle_filter.belief
    with pytest.raises(ValueError, match='states must have the shape'):
        particle_filter.set_particles(kept.states[:5], np.zeros(4))
    assert particle_filter.belief is kept and particle_filter.particles == 30
    particle_filter.step(np.zeros(2))
    assert len(particle_filter.belief) == 30


@pytest.mark.parametrize('arguments, words', [
    ({'proposal': GreyProposal}, 'proposal must be a Proposal'), ({'rng': 1}, 'rng must be a')])
def test_a_class_or_a_seed_is_told(arguments, words):
    """Before, the first step raised an error that named neither."""
    with pytest.raises(TypeError, match=words):
        ParticleFilter(ConstantVelocity(1), **{'rng': np.random.default_rng(1), **arguments})


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
