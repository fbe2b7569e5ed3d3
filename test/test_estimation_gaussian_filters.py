"""Gaussian filters: equal to Kalman's where it is exact, definite everywhere, right moments."""

from functools import partial
import math

from hypothesis import given, settings
from hypothesis import strategies as st
from nonlinear_models import (
    BearingRange, simulate, UnivariateNonstationaryGrowth, VanDerMerweModel)
import numpy as np
import pytest
from random_walk import RandomWalk

from vtrack_ros.estimation import (
    ConstantVelocity, covariance_factors, cubature, ExtendedKalmanFilter, gauss_hermite, Gaussian,
    GaussianNoise, KalmanFilter, LinearModel, pruned_gauss_hermite, SigmaPointFilter, unscented)

RULES = {
    'unscented': unscented,
    'unscented, signed': partial(unscented, alpha=0.5, kappa=0.0),
    'gauss-hermite 3': gauss_hermite,
    'gauss-hermite 4': partial(gauss_hermite, order=4),
    'pruned': pruned_gauss_hermite,
    'regrouped': partial(pruned_gauss_hermite, regroup=True),
    'cubature': cubature,
}
FILTERS = {
    'ekf': ExtendedKalmanFilter,
    **{name: partial(SigmaPointFilter, rule=rule) for name, rule in RULES.items()},
    **{f'{name}, all components': partial(SigmaPointFilter, rule=rule, measured_only=False)
       for name, rule in RULES.items()},
}
LINEAR = {
    'constant velocity': ConstantVelocity(2, 1, 0.5, 0.3, [[2.0, 0.5], [0.5, 1.0]]),
    'sizes measured': ConstantVelocity(1, 1, 0.5, 0.3, [[2.0, 0.5], [0.5, 1.0]]),
    'walk about a mean': RandomWalk(0.9, 0.5, 1.0, mean=-2.0),
}


def textbook(model, mean, covariance, measurement, dt):
    """Run one step of the textbook Kalman filter, for a single belief."""
    mean = model.transition(mean[np.newaxis], dt)[0]
    matrix, h = model.transition_matrix(dt), model.measurement_matrix
    covariance = matrix @ covariance @ matrix.T + model.process_noise(dt)
    s = h @ covariance @ h.T + model.measurement_noise
    gain = covariance @ h.T @ np.linalg.inv(s)
    innovation = measurement - h @ mean
    log_evidence = -0.5 * (innovation @ np.linalg.solve(s, innovation)
                           + np.linalg.slogdet(2 * math.pi * s)[1])
    return mean + gain @ innovation, covariance - gain @ s @ gain.T, log_evidence


@pytest.mark.parametrize('model_name', sorted(LINEAR))
@pytest.mark.parametrize('name', ['kf', *sorted(FILTERS)])
def test_every_filter_is_the_kalman_filter_on_a_linear_model(name, model_name):
    model = LINEAR[model_name]
    gaussian_filter = KalmanFilter(model) if name == 'kf' else FILTERS[name](model)
    n = model.state_dimension
    _, measurements = simulate(model, np.zeros(n), 30, np.random.default_rng(1))
    mean, covariance = np.zeros(n), np.eye(n) + 0.2
    belief = Gaussian.from_moments(mean, covariance)
    for measurement, dt in zip(measurements, [1.0, 2.0, 1.0] * 10):
        mean, covariance, log_evidence = textbook(model, mean, covariance, measurement, dt)
        correction = gaussian_filter.update(gaussian_filter.predict(belief, dt), measurement)
        belief = correction.posterior
        np.testing.assert_allclose(belief.mean[0], mean, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(belief.covariance[0], covariance, rtol=1e-7, atol=1e-9)
        assert correction.log_evidence[0] == pytest.approx(log_evidence, rel=1e-8)


@pytest.mark.parametrize('name', sorted(FILTERS))
def test_a_linear_transition_without_a_matrix_is_predicted_exactly(name):
    """The model hides its matrix, so that each filter predicts as for a nonlinear one."""
    class Hidden(ConstantVelocity):

        def transition_matrix(self, dt):
            return None

    linear = ConstantVelocity(2, 1, 0.5, 0.3)
    hidden = Hidden(2, 1, 0.5, 0.3)
    rng = np.random.default_rng(2)
    root = rng.normal(size=(4, 5, 5))
    belief = Gaussian(rng.normal(size=(4, 5)), root @ root.swapaxes(1, 2))
    expected = KalmanFilter(linear).predict(belief, 0.7)
    predicted = FILTERS[name](hidden).predict(belief, 0.7)
    np.testing.assert_allclose(predicted.mean, expected.mean, atol=1e-7)
    np.testing.assert_allclose(predicted.covariance, expected.covariance, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize('name', sorted(FILTERS))
@pytest.mark.parametrize('model', [
    BearingRange(2), BearingRange(3), UnivariateNonstationaryGrowth()], ids=lambda m: str(
        type(m).__name__) + str(m.state_dimension))
def test_many_beliefs_at_once_are_as_each_alone(name, model):
    """There are more beliefs than fit a block, so that the assembly of blocks is tested."""
    if model.state_dimension == 6 and 'all components' in name and 'hermite' in name:
        count = 5
    else:
        count = 400
    rng = np.random.default_rng(3)
    n = model.state_dimension
    root = rng.normal(size=(count, n, n)) + 2 * np.eye(n)
    belief = Gaussian(rng.normal(size=(count, n)) + 20, root @ root.swapaxes(1, 2))
    measurement = model.measure(belief.mean[:1])[0]
    gaussian_filter = FILTERS[name](model)
    together = gaussian_filter.update(gaussian_filter.predict(belief, 1.0), measurement)
    for i in (0, 1, count // 2, count - 1):
        one = Gaussian(belief.mean[i:i + 1], belief.covariance[i:i + 1])
        alone = gaussian_filter.update(gaussian_filter.predict(one, 1.0), measurement)
        np.testing.assert_allclose(together.posterior.mean[i], alone.posterior.mean[0],
                                   rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(together.posterior.covariance[i],
                                   alone.posterior.covariance[0], rtol=1e-7, atol=1e-9)
        assert together.log_evidence[i] == pytest.approx(alone.log_evidence[0], rel=1e-9)


@pytest.mark.parametrize('order', [2, 3, 6])
def test_integrating_over_the_measured_components_alone_loses_nothing(order):
    """
    Bearing and range depend on the position alone: the product rule's other factors are one.

    A position that isn't stored first needs the covariance reordered.
    """
    class Turned(BearingRange):
        """The same radar with velocities stored first."""

        def __init__(self):
            super().__init__(2)
            self.measured_components = (2, 3)

        def measure(self, states, time=0.0):
            return super().measure(states[:, [2, 3, 0, 1]], time)

    rng = np.random.default_rng(4)
    root = rng.normal(size=(6, 4, 4))
    covariance = root @ root.swapaxes(1, 2) + np.eye(4)
    mean = np.array([40.0, 30.0, 1.0, 2.0]) + rng.normal(size=(6, 4))
    order_of_turned = [2, 3, 0, 1]
    straight = Gaussian(mean, covariance)
    turned = Gaussian(mean[:, order_of_turned],
                      covariance[:, order_of_turned][:, :, order_of_turned])
    z = np.array([51.0, 0.63])
    rule = partial(gauss_hermite, order=order)
    expected = SigmaPointFilter(BearingRange(2), rule, measured_only=False)
    expected = expected.update(straight, z).posterior
    reduced = SigmaPointFilter(BearingRange(2), rule)
    assert len(reduced.update_rule) == order ** 2
    reduced = reduced.update(straight, z).posterior
    np.testing.assert_allclose(reduced.mean, expected.mean, rtol=1e-9)
    np.testing.assert_allclose(reduced.covariance, expected.covariance, rtol=1e-7, atol=1e-9)
    other = SigmaPointFilter(Turned(), rule).update(turned, z).posterior
    np.testing.assert_allclose(other.mean, reduced.mean[:, order_of_turned], rtol=1e-9)
    np.testing.assert_allclose(
        other.covariance, reduced.covariance[:, order_of_turned][:, :, order_of_turned],
        rtol=1e-7, atol=1e-9)


def test_a_linear_transition_needs_no_rule_over_all_components():
    """In fourteen dimensions it would have millions of points, of which none is ever used."""
    model = ConstantVelocity(2, 10)
    prior = Gaussian.from_moments(np.arange(14.0), np.eye(14))
    filters = SigmaPointFilter(model, gauss_hermite), KalmanFilter(model)
    ours, expected = (one.update(one.predict(prior, 0.5), np.array([2.0, 1.0])).posterior
                      for one in filters)
    np.testing.assert_allclose(ours.mean, expected.mean, rtol=1e-9)
    np.testing.assert_allclose(ours.covariance, expected.covariance, rtol=1e-9, atol=1e-12)
    with pytest.raises(ValueError, match='points'):
        SigmaPointFilter(model, gauss_hermite, measured_only=False)


def test_the_quadratic_measurement_by_hand():
    """
    The best linear estimate for z = x^2 / 20 + w with x ~ N(m, p).

    E z = (m^2 + p) / 20, cov(x, z) = m p / 10, var z = (4 m^2 p + 2 p^2) / 400 + r. Order 3
    integrates them exactly, so more points change nothing.
    """
    model = UnivariateNonstationaryGrowth(measurement_variance=0.3)
    m, p, z = 3.0, 2.0, 1.1
    cross, variance = m * p / 10, (4 * m ** 2 * p + 2 * p ** 2) / 400 + 0.3
    mean = m + cross / variance * (z - (m ** 2 + p) / 20)
    for factory in (unscented, gauss_hermite, partial(gauss_hermite, order=5),
                    partial(gauss_hermite, order=7), pruned_gauss_hermite):
        posterior = SigmaPointFilter(model, factory).update(
            Gaussian.from_moments([m], [[p]]), np.array([z])).posterior
        assert posterior.mean[0, 0] == pytest.approx(mean)
        assert posterior.covariance[0, 0, 0] == pytest.approx(p - cross ** 2 / variance)


def test_regrouping_without_matching_is_an_inflation():
    """A rule whose second moment is below one leaves the posterior variance too large."""
    model = UnivariateNonstationaryGrowth(measurement_variance=0.3)
    belief = Gaussian.from_moments([3.0], [[2.0]])
    variances = [
        SigmaPointFilter(model, partial(
            pruned_gauss_hermite, order=5, threshold=0.2, regroup=True, matched=matched)).update(
                belief, np.array([1.1])).posterior.covariance[0, 0, 0]
        for matched in (False, True)]
    full = SigmaPointFilter(model, partial(gauss_hermite, order=5)).update(
        belief, np.array([1.1])).posterior.covariance[0, 0, 0]
    assert variances[0] > full * 1.05
    assert variances[1] < variances[0]


@pytest.mark.parametrize('dimension, order, threshold', [(1, 9, 1e-4), (2, 7, None)])
def test_a_regrouped_rule_that_is_too_wide_leaves_no_negative_variance(
        dimension, order, threshold):
    """Its second moment is above one: an exact measurement would subtract more than there is."""
    model = ConstantVelocity(dimension, measurement_noise=1e-6 * np.eye(dimension))
    rule = partial(pruned_gauss_hermite, order=order, threshold=threshold, regroup=True,
                   matched=False)
    prior = Gaussian.from_moments(np.zeros(2 * dimension), np.eye(2 * dimension))
    posterior = SigmaPointFilter(model, rule).update(prior, np.zeros(dimension)).posterior
    assert (np.linalg.eigvalsh(posterior.covariance) > 0).all()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 10 ** 6), st.floats(-12, 3), st.floats(-6, 6),
       st.sampled_from(sorted(FILTERS)))
def test_covariances_stay_positive_definite(seed, log_noise, log_prior, name):
    """From precise to vague in prior and measurement, over many updates without a prediction."""
    model = BearingRange(2, measurement_noise=10.0 ** log_noise * np.diag([1.0, 1e-2]))
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, 4))
    covariance = 10.0 ** log_prior * (root @ root.T + 1e-3 * np.eye(4))
    belief = Gaussian.from_moments(rng.normal(size=4) * 20, covariance)
    gaussian_filter = FILTERS[name](model)
    for _ in range(10):
        belief = gaussian_filter.update(
            belief, model.measure(belief.mean)[0] + 0.01 * rng.normal(size=2)).posterior
        assert np.isfinite(belief.mean).all()
        np.testing.assert_array_equal(belief.covariance, belief.covariance.swapaxes(1, 2))
        values = np.linalg.eigvalsh(belief.covariance[0])
        assert values[0] >= -1e-12 * values[-1]
    belief = gaussian_filter.predict(belief, 1.0)
    assert np.linalg.eigvalsh(belief.covariance[0])[0] > 0


def test_a_bearing_behind_the_sensor_doesn_t_jump():
    """The sigma points straddle the cut at pi, where plain averages of angles would be wrong."""
    model = BearingRange(2, measurement_noise=np.diag([0.01, 1e-4]))
    prior = Gaussian.from_moments([-10.0, 0.1, 0.0, 0.0], np.diag([1.0, 1.0, 0.1, 0.1]))
    for name, factory in FILTERS.items():
        posterior = factory(model).update(prior, np.array([10.0, -math.pi + 0.01])).posterior
        np.testing.assert_allclose(posterior.mean[0, :2], [-10.0, -0.1], atol=0.15, err_msg=name)


def test_a_measurement_may_bring_its_own_error():
    """A variance given with the measurement acts like a model that has it."""
    sharp, blunt = ConstantVelocity(1), ConstantVelocity(1, measurement_noise=[[100.0]])
    prior = Gaussian.from_moments([0.0, 1.0], np.eye(2))
    error = GaussianNoise.from_covariance(np.array([[100.0]]))
    for factory in FILTERS.values():
        given_error = factory(sharp).update(prior, np.array([2.0]), error=error).posterior
        own = factory(blunt).update(prior, np.array([2.0])).posterior
        np.testing.assert_allclose(given_error.mean, own.mean)
        np.testing.assert_allclose(given_error.covariance, own.covariance)


def test_factors_of_indefinite_matrices_are_those_of_the_nearest_definite():
    rng = np.random.default_rng(5)
    root = rng.normal(size=(3, 4, 4))
    good = root @ root.swapaxes(1, 2)
    bad = good.copy()
    vector = np.linalg.eigh(good[1])[1][:, 0]
    bad[1] -= (np.linalg.eigvalsh(good[1])[0] + 1e-13) * np.outer(vector, vector)
    bad[2] = 0.0
    factors = covariance_factors(bad)
    np.testing.assert_allclose(factors @ factors.swapaxes(1, 2), bad, atol=1e-12)
    np.testing.assert_array_equal(np.triu(factors, 1), 0.0)


def test_wrong_beliefs_and_measurements_are_refused():
    model = ConstantVelocity(1)
    gaussian_filter = SigmaPointFilter(model, unscented)
    good = Gaussian.from_moments([0.0, 0.0], np.eye(2))
    with pytest.raises(ValueError, match='measurement'):
        gaussian_filter.update(good, np.zeros(2))
    with pytest.raises(ValueError, match='measurement must be finite'):
        gaussian_filter.update(good, np.array([math.nan]))
    for dt in (-1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match='dt'):
            gaussian_filter.predict(good, dt)
    other = Gaussian.from_moments([0.0], [[1.0]])
    with pytest.raises(ValueError, match='dimension'):
        gaussian_filter.update(other, np.zeros(1))
    with pytest.raises(ValueError, match='dimension'):
        gaussian_filter.predict(other, 1.0)
    with pytest.raises(ValueError, match='LinearModel'):
        KalmanFilter(VanDerMerweModel())
    assert isinstance(model, LinearModel)
    for mean, covariance, name in [
            ([0.0, 0.0], np.eye(3), 'covariance'), ([0.0, 0.0], -np.eye(2), 'covariance'),
            ([[0.0, 0.0]], np.ones((2, 2, 2)), 'covariance'), ([math.nan], [[1.0]], 'mean')]:
        with pytest.raises(ValueError, match=name):
            Gaussian.from_moments(mean, covariance)
    with pytest.raises(ValueError, match='mean'):
        Gaussian(np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match='covariance'):
        Gaussian(np.zeros((3, 2)), np.eye(2))


def test_an_error_of_another_dimension_is_refused():
    """A number instead of a matrix would be taken for a covariance between all components."""
    model = ConstantVelocity(2)
    error = GaussianNoise.from_covariance(np.eye(1))
    for one in (KalmanFilter(model), SigmaPointFilter(model, unscented)):
        with pytest.raises(ValueError, match=r'error .*\(2, 2\), not \(1, 1\)'):
            one.update(Gaussian.from_moments(np.zeros(4), np.eye(4)), np.ones(2), error=error)
