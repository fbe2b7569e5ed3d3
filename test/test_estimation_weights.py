"""Log-weights and resampling: normalised, unbiased, O(N), and never NaN."""

import math

import numpy as np
import pytest

from vtrack_ros.estimation import RESAMPLERS, Weights

SCHEMES = sorted(RESAMPLERS)


def test_weights_are_normalised_whatever_their_size():
    for offset in (-1e5, 0.0, 1e5):
        weights = Weights.from_log(np.log([1.0, 2.0, 5.0]) + offset)
        np.testing.assert_allclose(weights.values, [0.125, 0.25, 0.625])
        np.testing.assert_allclose(np.exp(weights.logarithms), weights.values)
        assert weights.log_evidence == pytest.approx(offset + math.log(8.0))
        assert not weights.recovered


def test_effective_sample_size_from_one_to_all():
    assert Weights.uniform(40).effective_sample_size == pytest.approx(40)
    one = Weights.from_log(np.array([0.0, -math.inf, -math.inf]))
    assert one.effective_sample_size == pytest.approx(1)
    half = Weights.from_log(np.array([0.0, 0.0, -math.inf, -math.inf]))
    assert half.effective_sample_size == pytest.approx(2)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_a_particle_with_a_broken_weight_gets_none(bad):
    weights = Weights.from_log(np.array([0.0, bad, 0.0]))
    np.testing.assert_allclose(weights.values, [0.5, 0.0, 0.5])
    assert not weights.recovered


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_without_any_weight_the_fallback_stands(bad):
    log_weights = np.full(3, bad)
    before = Weights.from_log(np.log([0.2, 0.3, 0.5]))
    kept = Weights.from_log(log_weights, fallback=before)
    np.testing.assert_allclose(kept.values, before.values)
    assert kept.recovered and kept.log_evidence == -math.inf
    uniform = Weights.from_log(log_weights)
    np.testing.assert_allclose(uniform.values, np.full(3, 1 / 3))
    assert uniform.recovered


def test_wrong_weights_are_refused():
    with pytest.raises(ValueError, match='log_weights'):
        Weights.from_log(np.zeros((2, 2)))
    with pytest.raises(ValueError, match='log_weights'):
        Weights.from_log(np.zeros(0))
    with pytest.raises(ValueError, match='count'):
        Weights.uniform(0)


@pytest.mark.parametrize('scheme', SCHEMES)
def test_resampling_is_unbiased(scheme):
    rng = np.random.default_rng(1)
    weights = rng.dirichlet(np.full(8, 0.7))
    count, repeats = 13, 4000
    copies = np.array([
        np.bincount(RESAMPLERS[scheme](weights, count, rng), minlength=8)
        for _ in range(repeats)])
    assert (copies.sum(axis=1) == count).all()
    # No scheme has more variance than the multinomial one, so five of its standard errors bound
    # all of them.
    error = np.sqrt(count * weights * (1 - weights) / repeats)
    assert (np.abs(copies.mean(axis=0) - count * weights) < 5 * error + 1e-12).all()


@pytest.mark.parametrize('scheme, below, above', [
    ('systematic', 1, 1), ('stratified', 2, 2), ('residual', 1, math.inf)])
def test_low_variance_schemes_bound_the_number_of_copies(scheme, below, above):
    """How far the copies of a particle may be from count * weight; less than these, always."""
    rng = np.random.default_rng(2)
    for _ in range(300):
        weights = rng.dirichlet(np.full(20, 0.3))
        excess = np.bincount(RESAMPLERS[scheme](weights, 50, rng), minlength=20) - 50 * weights
        assert (excess > -below).all() and (excess < above).all()


@pytest.mark.parametrize('scheme', SCHEMES)
def test_equal_weights_and_single_survivors(scheme):
    rng = np.random.default_rng(3)
    if scheme != 'multinomial':
        np.testing.assert_array_equal(
            RESAMPLERS[scheme](np.full(10, 0.1), 10, rng), np.arange(10))
    alone = np.zeros(10)
    alone[[0, 4]] = 0.0, 1.0
    assert (RESAMPLERS[scheme](alone, 7, rng) == 4).all()
    last = np.zeros(10)
    last[-1] = 3.0
    assert (RESAMPLERS[scheme](last, 7, rng) == 9).all()
    assert (RESAMPLERS[scheme](np.array([2.0]), 3, rng) == 0).all()


@pytest.mark.parametrize('scheme', SCHEMES)
def test_particles_without_weight_never_survive(scheme):
    rng = np.random.default_rng(4)
    for _ in range(200):
        weights = rng.random(30) * (rng.random(30) < 0.4)
        weights[rng.integers(30)] = 1.0
        assert (weights[RESAMPLERS[scheme](weights, 30, rng)] > 0).all()


@pytest.mark.parametrize('scheme', SCHEMES)
def test_the_seed_decides(scheme):
    weights = np.random.default_rng(5).dirichlet(np.ones(50))
    first, second = (RESAMPLERS[scheme](weights, 50, np.random.default_rng(6)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize('scheme', SCHEMES)
@pytest.mark.parametrize('weights', [[-0.1, 1.1], [0.0, 0.0], [math.nan, 1.0], [math.inf, 1.0],
                                     [[0.5, 0.5]], []])
def test_wrong_weights_for_resampling_are_refused(scheme, weights):
    with pytest.raises(ValueError, match='weights'):
        RESAMPLERS[scheme](np.array(weights), 5, np.random.default_rng(7))


def test_no_particles_are_refused():
    for scheme in SCHEMES:
        with pytest.raises(ValueError, match='count'):
            RESAMPLERS[scheme](np.ones(3), 0, np.random.default_rng(8))
