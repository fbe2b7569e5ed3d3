"""Models: moments, densities and Jacobians agree with one another; dt is honoured."""

import math

from nonlinear_models import (
    BearingRange, simulate, UnivariateNonstationaryGrowth, VanDerMerweModel)
import numpy as np
import pytest
from random_walk import RandomWalk

from vtrack_ros.estimation import (
    central_differences, ConstantVelocity, GaussianNoise, Weights)

MODELS = {
    'constant velocity': ConstantVelocity(2, 2, 0.7, 0.2),
    'walk': RandomWalk(0.9, 0.5, 1.0, mean=3.0),
    'ung': UnivariateNonstationaryGrowth(),
    'van der merwe': VanDerMerweModel(),
    'bearing range 4': BearingRange(2),
    'bearing range 6': BearingRange(3),
}
TIMES = (3.0, 40.0)


@pytest.fixture(params=sorted(MODELS))
def model(request):
    return MODELS[request.param]


def some_states(model, count=5):
    rng = np.random.default_rng(1)
    return rng.normal(2.0, 1.5, (count, model.state_dimension))


@pytest.mark.parametrize('dt', [1.0, 2.0])
def test_transition_and_noise_are_the_moments_of_what_is_sampled(model, dt):
    count = 40000
    start = np.repeat(some_states(model, 1), count, axis=0)
    drawn = model.sample_transition(start, dt, np.random.default_rng(2), TIMES[0])
    noise = model.process_noise(dt)
    spread = np.sqrt(noise.diagonal())
    expected = model.transition(start[:1], dt, TIMES[0])[0]
    assert (np.abs(drawn.mean(axis=0) - expected) < 5 * spread / math.sqrt(count)).all()
    # Five standard errors; those of a Gamma(3) variance are sqrt(2) times the Gaussian ones.
    tolerance = 5 * math.sqrt(4 / count) * np.outer(spread, spread)
    assert (np.abs(np.cov(drawn.T).reshape(noise.shape) - noise) < tolerance).all()


@pytest.mark.parametrize('name', sorted(set(MODELS) - {'van der merwe'}))
def test_the_transition_s_density_is_that_of_its_samples(name):
    """The mean of q / p over samples of p is one for every density q; here a narrower one."""
    model, count = MODELS[name], 20000
    previous = np.repeat(some_states(model, 1), count, axis=0)
    states = model.sample_transition(previous, 1.0, np.random.default_rng(3), TIMES[0])
    narrow = 0.5 * model.process_noise(1.0)
    error = states - model.transition(previous[:1], 1.0, TIMES[0])
    log_q = (-0.5 * np.einsum('ij,jk,ik->i', error, np.linalg.inv(narrow), error)
             - 0.5 * np.linalg.slogdet(2 * math.pi * narrow)[1])
    ratio = np.exp(log_q - model.log_transition(states, previous, 1.0, TIMES[0]))
    assert abs(ratio.mean() - 1) < 5 * ratio.std() / math.sqrt(count)


def test_the_gamma_density_integrates_to_one_and_vanishes_below_zero():
    model = VanDerMerweModel()
    mean = model.shape / model.rate
    grid = np.linspace(-mean - 1, 12, 200001)[:, np.newaxis]
    density = np.exp(model.log_noise_density(grid, 1.0))
    step = grid[1, 0] - grid[0, 0]
    assert density.sum() * step == pytest.approx(1.0, abs=1e-4)
    assert (density * grid[:, 0]).sum() * step == pytest.approx(0.0, abs=1e-4)
    assert (density * grid[:, 0] ** 2).sum() * step == pytest.approx(
        model.process_noise(1.0)[0, 0], abs=1e-3)
    assert (density[grid[:, 0] < -mean] == 0).all()


@pytest.mark.parametrize('time', TIMES)
def test_jacobians_are_the_derivatives(model, time):
    """The model's own, where it has any, against central differences."""
    states = some_states(model)
    transition = central_differences(lambda x: model.transition(x, 1.0, time), states)
    measurement = central_differences(lambda x: model.measure(x, time), states, model.residual)
    matrix = model.transition_matrix(1.0)
    for own, derivative in ((model.transition_jacobian(states, 1.0, time), transition),
                            (matrix, transition),
                            (model.measurement_jacobian(states, time), measurement)):
        if own is not None:
            np.testing.assert_allclose(
                np.broadcast_to(own, derivative.shape), derivative, atol=1e-6)


def test_measured_components_are_those_that_matter(model):
    components = model.measured_components
    if components is None:
        components = range(model.state_dimension)
    jacobian = central_differences(lambda x: model.measure(x, TIMES[0]), some_states(model))
    for component in range(model.state_dimension):
        assert jacobian[:, :, component].any() == (component in components)


@pytest.mark.parametrize('time', TIMES)
def test_the_likelihood_is_gaussian_about_the_measurement(model, time):
    states = some_states(model)
    seen = model.measure(states, time)
    noise = model.measurement_noise
    peak = -0.5 * np.linalg.slogdet(2 * math.pi * noise)[1]
    z = seen[0]
    assert model.log_likelihood(states, z, time)[0] == pytest.approx(peak)
    z = z + np.sqrt(noise[0]) * (np.arange(len(z)) == 0)
    assert model.log_likelihood(states[:1], z, time)[0] == pytest.approx(peak - 0.5)


@pytest.mark.parametrize('name', ['constant velocity', 'walk'])
def test_two_steps_are_one_of_twice_the_length(name):
    model = MODELS[name]
    once, twice = model.transition_matrix(1.0), model.transition_matrix(2.0)
    np.testing.assert_allclose(once @ once, twice, atol=1e-12)
    noise = model.process_noise(1.0)
    np.testing.assert_allclose(once @ noise @ once.T + noise, model.process_noise(2.0),
                               atol=1e-12)
    states = some_states(model)
    np.testing.assert_allclose(
        model.transition(model.transition(states, 1.0), 1.0), model.transition(states, 2.0))


def test_constant_velocity_moves_at_constant_velocity():
    model = ConstantVelocity(2, 2)
    moved = model.transition(np.array([[10.0, 20.0, 3.0, -4.0, 7.0, 8.0]]), 0.5)
    np.testing.assert_allclose(moved, [[11.5, 18.0, 3.0, -4.0, 7.0, 8.0]])
    assert model.measured_components == (0, 1)
    whole = ConstantVelocity(2, 2, measurement_noise=np.eye(4))
    assert whole.measured_components == (0, 1, 4, 5)
    np.testing.assert_allclose(whole.measure(moved), [[11.5, 18.0, 7.0, 8.0]])


def test_ung_by_hand():
    model = UnivariateNonstationaryGrowth()
    expected = 0.5 * 2 + 25 * 2 / 5 + 8 * math.cos(1.2 * 4)
    assert model.transition(np.array([[2.0]]), 1.0, 4.0)[0, 0] == pytest.approx(expected)
    assert model.measure(np.array([[-6.0]]))[0, 0] == pytest.approx(1.8)


def test_van_der_merwe_by_hand():
    model = VanDerMerweModel(shape=3.0, rate=2.0)
    expected = 1 + math.sin(0.04 * math.pi * 7) + 0.5 * 2 + 1.5
    assert model.transition(np.array([[2.0]]), 1.0, 7.0)[0, 0] == pytest.approx(expected)
    assert model.measure(np.array([[3.0]]), 30.0)[0, 0] == pytest.approx(1.8)
    assert model.measure(np.array([[3.0]]), 31.0)[0, 0] == pytest.approx(-0.5)


def test_bearing_and_range_by_hand():
    np.testing.assert_allclose(
        BearingRange(2).measure(np.array([[-3.0, 4.0, 9.0, 9.0]])), [[5.0, math.atan2(4, -3)]])
    np.testing.assert_allclose(
        BearingRange(3).measure(np.array([[3.0, 4.0, 5.0, 0.0, 0.0, 0.0]])),
        [[math.sqrt(50), math.atan2(4, 3), math.pi / 4]])


def test_bearings_wrap():
    model = BearingRange(2)
    residual = model.residual(np.array([5.0, math.pi - 0.1]), np.array([[5.0, -math.pi + 0.1]]))
    np.testing.assert_allclose(residual, [[0.0, -0.2]], atol=1e-12)
    behind = np.array([[-10.0, -0.01, 0.0, 0.0]])
    above = np.array([10.0, math.pi])
    assert model.log_likelihood(behind, above)[0] > model.log_likelihood(behind + 1.0, above)[0]


def test_simulation_is_seeded_and_of_the_right_shape(model):
    start = np.ones(model.state_dimension)
    states, measurements = simulate(model, start, 7, np.random.default_rng(4))
    again, _ = simulate(model, start, 7, np.random.default_rng(4))
    assert states.shape == (7, model.state_dimension)
    assert measurements.shape == (7, model.measurement_dimension)
    np.testing.assert_array_equal(states, again)


@pytest.mark.parametrize('make, name', [
    (lambda: ConstantVelocity(0), 'positions'),
    (lambda: ConstantVelocity(acceleration_density=0.0), 'acceleration_density'),
    (lambda: ConstantVelocity(wander_density=-1.0), 'wander_density'),
    (lambda: ConstantVelocity(2, 2, measurement_noise=np.eye(3)), 'measurement_noise.* 2 or 4'),
    (lambda: ConstantVelocity(2, measurement_noise=np.eye(3)), 'measurement_noise.* size 2, not'),
    (lambda: ConstantVelocity(measurement_noise=-np.eye(2)), 'measurement_noise'),
    (lambda: UnivariateNonstationaryGrowth(process_variance=0.0), 'process_variance'),
    (lambda: VanDerMerweModel(measurement_variance=math.nan), 'measurement_variance'),
    (lambda: VanDerMerweModel(rate=-2.0), 'rate'),
    (lambda: BearingRange(4), 'positions'), (lambda: BearingRange(1), 'positions'),
    (lambda: BearingRange(2, measurement_noise=np.eye(3)), 'measurement_noise')])
def test_wrong_parameters_are_refused(make, name):
    with pytest.raises(ValueError, match=name):
        make()


@pytest.mark.parametrize('value', [math.inf, math.nan])
def test_a_covariance_that_is_not_finite_is_not_factorised(value):
    with pytest.raises(ValueError, match='noise must be'):
        GaussianNoise.from_covariance(np.diag([1.0, value]), 'noise')


@pytest.mark.parametrize('name', ['acceleration_density', 'wander_density'])
def test_a_density_is_the_same_for_moments_and_samples(name):
    """It can't be changed: samples come from a factor that is cached."""
    model = ConstantVelocity(2, 1)
    with pytest.raises(AttributeError, match=name):
        setattr(model, name, 4.0)
    assert getattr(model, name) == 1.0


def test_whole_numbers_may_be_floats():
    """As for every count, e.g. one that was computed."""
    assert ConstantVelocity(2.0, 2.0).state_dimension == 6
    assert len(Weights.uniform(77.0)) == 77
    for count in (2.5, 0, math.nan):
        with pytest.raises(ValueError, match='positions'):
            ConstantVelocity(count)


def test_a_process_noise_without_a_density_is_named():
    """A position that follows from the velocity alone is usual in textbooks, but has none."""
    class Textbook(ConstantVelocity):
        """White acceleration only, without its effect on the position."""

        def process_noise(self, dt):
            return np.diag([0.0, dt])

    with pytest.raises(ValueError, match='process_noise must be positive definite'):
        Textbook(1).sample_noise(3, 1.0, np.random.default_rng(0))
