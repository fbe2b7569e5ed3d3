"""Log-weights and resampling: normalised, unbiased, O(N), and never NaN."""

import math

import numpy as np
import pytest

from vtrack_ros.estimation import at_least, spread_about, systematic, Weights


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


def test_resampling_is_unbiased():
    rng = np.random.default_rng(1)
    weights = rng.dirichlet(np.full(8, 0.7))
    count, repeats = 13, 4000
    copies = np.array([
        np.bincount(systematic(weights, count, rng), minlength=8)
        for _ in range(repeats)])
    assert (copies.sum(axis=1) == count).all()
    # Independent draws have more variance, so five of their standard errors bound these.
    error = np.sqrt(count * weights * (1 - weights) / repeats)
    assert (np.abs(copies.mean(axis=0) - count * weights) < 5 * error + 1e-12).all()


def test_no_particle_has_a_whole_copy_more_or_fewer_than_its_share():
    rng = np.random.default_rng(2)
    for _ in range(300):
        weights = rng.dirichlet(np.full(20, 0.3))
        excess = np.bincount(systematic(weights, 50, rng), minlength=20) - 50 * weights
        assert (np.abs(excess) < 1).all()


def test_equal_weights_and_single_survivors():
    rng = np.random.default_rng(3)
    np.testing.assert_array_equal(systematic(np.full(10, 0.1), 10, rng), np.arange(10))
    alone = np.zeros(10)
    alone[[0, 4]] = 0.0, 1.0
    assert (systematic(alone, 7, rng) == 4).all()
    last = np.zeros(10)
    last[-1] = 3.0
    assert (systematic(last, 7, rng) == 9).all()
    assert (systematic(np.array([2.0]), 3, rng) == 0).all()
    # whole numbers, such as hits that were counted
    assert (np.bincount(systematic(np.array([3, 0, 1]), 8, rng)) == [6, 0, 2]).all()


def test_particles_without_weight_never_survive():
    rng = np.random.default_rng(4)
    for _ in range(200):
        weights = rng.random(30) * (rng.random(30) < 0.4)
        weights[rng.integers(30)] = 1.0
        assert (weights[systematic(weights, 30, rng)] > 0).all()


def test_the_seed_decides():
    weights = np.random.default_rng(5).dirichlet(np.ones(50))
    first, second = (systematic(weights, 50, np.random.default_rng(6)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize('weights', [[-0.1, 1.1], [0.0, 0.0], [math.nan, 1.0], [math.inf, 1.0],
                                     [[0.5, 0.5]], []])
def test_wrong_weights_for_resampling_are_refused(weights):
    with pytest.raises(ValueError, match='weights'):
        systematic(np.array(weights), 5, np.random.default_rng(7))


def test_no_particles_are_refused():
    with pytest.raises(ValueError, match='count'):
        systematic(np.ones(3), 0, np.random.default_rng(8))


def test_a_covariance_is_raised_where_it_is_below_another_one():
    """In every direction it's at least the other; where it was more, it stays as it is."""
    rng, least = np.random.default_rng(0), np.array([1.0, 4.0, 0.25, 2.0])
    for count in (2, 3, 50):
        states = rng.normal(0, 1, (count, 4)) * (9.0, 0.1, 5.0, 0.0)
        few = spread_about(states.mean(0), states, np.full(count, 1 / count))
        raised = at_least(few, least)
        np.testing.assert_allclose(raised, raised.T)
        assert np.linalg.eigvalsh(raised - np.diag(least)).min() > -1e-9
        assert np.linalg.eigvalsh(raised - few).min() > -1e-9
    more = np.diag(least) + few
    np.testing.assert_allclose(at_least(more, least), more)
    for less in (np.zeros((4, 4)), few / 1000):
        np.testing.assert_allclose(at_least(less, least), np.diag(least))
