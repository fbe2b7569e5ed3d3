"""The interacting multiple model: exact moments, which the interaction preserves."""

import math

import numpy as np
import pytest

from vtrack_ros.estimation import (
    ConstantVelocity, Gaussian, KalmanFilter, mix, moments, switching, VelocityHypotheses)

MODEL = VelocityHypotheses(2, (3.0, 40.0), (math.inf, 0.2))


def beliefs():
    """Return two random beliefs with different means and covariances."""
    rng = np.random.default_rng(3)
    factors = rng.normal(size=(2, 4, 4))
    return Gaussian(rng.normal(size=(2, 4)), factors @ factors.swapaxes(1, 2))


def test_infinite_time_constant_is_constant_velocity():
    """Under the first hypothesis matrices and predictions are those of `ConstantVelocity`."""
    plain = ConstantVelocity(2, acceleration_density=3.0)
    assert MODEL.transition_matrix(0.3)[0] == pytest.approx(plain.transition_matrix(0.3))
    assert MODEL.process_noise(0.3)[0] == pytest.approx(plain.process_noise(0.3))
    prior = beliefs()
    alone = KalmanFilter(plain).predict(Gaussian(prior.mean[:1], prior.covariance[:1]), 0.3)
    both = KalmanFilter(MODEL).predict(prior, 0.3)
    assert both.mean[0] == pytest.approx(alone.mean[0])
    assert both.covariance[0] == pytest.approx(alone.covariance[0])


@pytest.mark.parametrize('densities, constants, message', [
    ([1.0, -1.0], [1.0, 1.0], 'densities'), ([1.0, 0.0], [1.0, 1.0], 'densities'),
    ([1.0], [1.0, 1.0], 'densities'), ([1.0, 1.0], [1.0, 0.0], 'time_constants'),
    ([1.0, 1.0], [1.0, -0.1], 'time_constants'), ([1.0], [math.nan], 'time_constants'),
    ([1.0], 1.0, 'time_constants')])
def test_wrong_hypotheses_are_refused(densities, constants, message):
    """A negative density would give a covariance that isn't one."""
    with pytest.raises(ValueError, match=message):
        VelocityHypotheses(2, densities, constants)


@pytest.mark.parametrize('dt', [1e-5, 0.01, 0.3])
def test_two_steps_are_one_of_twice_the_time(dt):
    """Prediction doesn't depend on the step size: F F = F(2 dt), and F Q F' + Q = Q(2 dt)."""
    step, noise = MODEL.transition_matrix(dt), MODEL.process_noise(dt)
    assert step @ step == pytest.approx(MODEL.transition_matrix(2 * dt), rel=1e-4)
    assert step @ noise @ step.swapaxes(1, 2) + noise == pytest.approx(
        MODEL.process_noise(2 * dt), rel=1e-3)


def test_fading_velocity_has_a_stationary_variance():
    """After a long time an Ornstein-Uhlenbeck process's velocity has the variance q tau / 2."""
    assert MODEL.transition_matrix(50.0)[1, 2:, 2:] == pytest.approx(np.zeros((2, 2)))
    assert MODEL.process_noise(50.0)[1, 2:, 2:] == pytest.approx(4.0 * np.eye(2))


def test_switching_is_a_process_in_time():
    """Rows sum to 1, two steps are one of twice the time, and the limit is uniform."""
    once = switching(3, 0.1, 0.5)
    assert once.sum(axis=1) == pytest.approx(np.ones(3))
    assert once @ once == pytest.approx(switching(3, 0.2, 0.5))
    assert switching(3, 100.0, 0.5) == pytest.approx(np.full((3, 3), 1 / 3))


def test_interaction_keeps_the_moments():
    """Mean and covariance of the mixture are the same before and after the interaction."""
    before, weights = beliefs(), np.array([0.3, 0.7])
    after, predicted = mix(before, weights, switching(2, 0.1, 0.5))
    assert predicted.sum() == pytest.approx(1.0)
    for mine, others in zip(moments(after, predicted), moments(before, weights)):
        assert mine == pytest.approx(others)
    unmixed, same = mix(before, weights, np.eye(2))
    assert unmixed.mean == pytest.approx(before.mean) and same == pytest.approx(weights)
    assert unmixed.covariance == pytest.approx(before.covariance)


def test_an_impossible_hypothesis_that_nothing_switches_to_keeps_its_belief():
    """Its probability stays 0, so it has no effect on the mixture's moments."""
    before, weights = beliefs(), np.array([1.0, 0.0])
    after, predicted = mix(before, weights, switching(2, 0.0, 0.5))
    assert predicted == pytest.approx(weights)
    assert after.mean == pytest.approx(before.mean)
    assert after.covariance == pytest.approx(before.covariance)
    for mine, others in zip(moments(after, predicted), moments(before, weights)):
        assert mine == pytest.approx(others)


def test_moments_are_those_of_samples():
    """They are mean and covariance of samples that are drawn from the mixture."""
    mixture, weights, rng = beliefs(), np.array([0.3, 0.7]), np.random.default_rng(0)
    which = rng.choice(2, 200_000, p=weights)
    factors = np.linalg.cholesky(mixture.covariance)
    drawn = mixture.mean[which] + np.einsum(
        'nab,nb->na', factors[which], rng.standard_normal((len(which), 4)))
    mean, covariance = moments(mixture, weights)
    assert drawn.mean(axis=0) == pytest.approx(mean, abs=0.03)
    assert np.cov(drawn.T) == pytest.approx(covariance, abs=0.15)


def test_as_many_hypotheses_as_one_likes():
    """Each belief of a large bank has the prediction of its own hypothesis."""
    densities = np.linspace(1.0, 4.0, 300)
    bank = KalmanFilter(VelocityHypotheses(2, densities, np.full(300, math.inf)))
    prior = Gaussian.from_moments(np.ones((300, 4)), np.eye(4))
    predicted = bank.predict(prior, 0.5)
    for index in (0, 255, 256, 299):
        alone = KalmanFilter(ConstantVelocity(2, 0, densities[index])).predict(
            Gaussian.from_moments(np.ones(4), np.eye(4)), 0.5)
        assert predicted.mean[index] == pytest.approx(alone.mean[0])
        assert predicted.covariance[index] == pytest.approx(alone.covariance[0])
