"""Rules of fusion, compared with the theory of evidence computed on sets."""

from __future__ import annotations

from itertools import product as pairs

import numpy as np
from numpy.testing import assert_allclose
import pytest

from vtrack_ros.replicas.fusion import (
    dempster_shafer, normalised_masses, product, reliability, weighted_sum)

TARGET, OTHER = frozenset({'target'}), frozenset({'other'})
EITHER = TARGET | OTHER
#: The rules that count a cue by its reliability.
DISCOUNTING = (dempster_shafer, product, weighted_sum)


def combined(masses):
    """Return the masses by Dempster's rule: products of masses go to the sets' intersections."""
    result = {EITHER: 1.0}
    for one in masses:
        sums = {TARGET: 0.0, OTHER: 0.0, EITHER: 0.0}
        conflict = 0.0
        for (a, mass_a), (b, mass_b) in pairs(result.items(), one.items()):
            if a & b:
                sums[a & b] += mass_a * mass_b
            else:
                conflict += mass_a * mass_b
        result = {key: value / (1 - conflict) for key, value in sums.items()}
    return result


@pytest.mark.parametrize('trusts', [(0.9, 0.4), (0.3, 0.3), (0.7, 0.2, 0.6)])
def test_dempsters_rule_by_intersections_of_sets(trusts):
    """It's the pignistic probability of discounted masses on {target}, {other} and both."""
    likelihoods = np.random.default_rng(0).uniform(size=(len(trusts), 9))
    found = np.exp(dempster_shafer(likelihoods, np.array(trusts)))
    for column, value in zip(likelihoods.T, found):
        masses = combined(
            {TARGET: r * p, OTHER: r * (1 - p), EITHER: 1 - r} for p, r in zip(column, trusts))
        assert value == pytest.approx(masses[TARGET] + masses[EITHER] / 2)


def test_full_trust_gives_the_normalised_product():
    """It is p q / (p q + (1 - p)(1 - q)) to 0.01, for reliability is limited to 0.99."""
    p, q = np.meshgrid(np.linspace(0.2, 0.8, 7), np.linspace(0.2, 0.8, 7))
    found = np.exp(dempster_shafer(np.stack([p.ravel(), q.ravel()]), np.ones(2)))
    expected = p * q / (p * q + (1 - p) * (1 - q))
    assert_allclose(found, expected.ravel(), atol=0.01)


def test_it_doesnt_matter_which_cue_comes_first():
    """Dempster's rule commutes."""
    rng = np.random.default_rng(1)
    likelihoods, trusts = rng.uniform(size=(3, 20)), np.array([0.9, 0.1, 0.5])
    order = [2, 0, 1]
    assert_allclose(dempster_shafer(likelihoods, trusts),
                    dempster_shafer(likelihoods[order], trusts[order]))


def test_certain_cues_that_contradict_each_other():
    """Total conflict of two fully reliable cues gives 0.5, without a division by zero."""
    found = np.exp(dempster_shafer(np.array([[1.0], [0.0]]), np.ones(2)))
    assert found[0] == pytest.approx(0.5)


@pytest.mark.parametrize('rule', DISCOUNTING)
def test_a_cue_without_reliability_is_left_out(rule):
    """A cue of reliability 0, also one that abstains with NaN, has no effect on the result."""
    heard = np.random.default_rng(2).uniform(0.1, 1, size=(1, 30))
    alone = rule(heard, np.array([0.8]))
    for silent in (np.full((1, 30), np.nan), np.random.default_rng(3).uniform(size=(1, 30))):
        both = rule(np.concatenate([heard, silent]), np.array([0.8, 0.0]))
        assert_allclose(both, alone)


@pytest.mark.parametrize('rule', DISCOUNTING)
def test_what_both_cues_prefer_wins(rule):
    """A hypothesis that is better for every cue has the higher log-likelihood."""
    likelihoods = np.array([[0.2, 0.5, 0.9], [0.1, 0.6, 0.7]])
    found = rule(likelihoods, np.array([0.5, 0.9]))
    assert found[0] < found[1] < found[2]
    assert np.isfinite(rule(np.array([[0.0, 1.0], [0.0, 1.0]]), np.ones(2))).all()


def test_without_any_cue_all_hypotheses_are_alike():
    """If all cues abstain the results are finite, and equal for all hypotheses."""
    for rule in DISCOUNTING:
        found = rule(np.full((2, 5), np.nan), np.zeros(2))
        assert np.isfinite(found).all() and np.ptp(found) == 0


def test_product_and_sum():
    """They are the sum of logs, and the log of the mean weighted by the reliabilities."""
    likelihoods, trusts = np.array([[0.5, 0.2], [0.4, 0.8]]), np.array([0.25, 0.75])
    assert_allclose(product(likelihoods, trusts), np.log([0.2, 0.16]))
    assert_allclose(
        weighted_sum(likelihoods, trusts),
        np.log([0.25 * 0.5 + 0.75 * 0.4, 0.25 * 0.2 + 0.75 * 0.8]))


def test_reliability_is_contrast():
    """It's 0 for a flat cue, even at 0, and for one that abstains; near 1 for a single peak."""
    flat, peaked = np.full(100, 0.7), np.zeros(100)
    peaked[3] = 1
    found = reliability(np.stack([flat, peaked, np.full(100, np.nan), np.zeros(100)]))
    assert_allclose(found, [0, 0.99, 0, 0], atol=1e-12)


def test_masses_of_equations_16_to_19():
    """The weights are those worked out by hand for three particles."""
    colour, edge = np.array([2.0, 1.0, 1.0]), np.array([1.0, 3.0, 0.0])
    w_d, w_edge = np.array([0.5, 0.25, 0.25]), np.array([0.25, 0.75, 0.0])
    # eq. 18 with the denominator of Dempster's rule
    fused = [0.125 / (0.125 + 0.375), 0.1875 / (0.1875 + 0.1875), 0.0]
    assert_allclose(fused, w_d * w_edge / (w_d * w_edge + (1 - w_d) * (1 - w_edge)))
    weights = np.exp(normalised_masses(np.stack([colour, edge]), np.ones(2)))
    assert_allclose(weights, [1 / 3, 2 / 3, 0.0])  # 1/4 and 1/2, over their sum


def test_many_masses_are_close_to_the_product():
    """With masses of about 1/N Dempster's rule gives the normalised product, to 2 %."""
    likelihoods = np.random.default_rng(0).uniform(0.5, 1.0, (2, 500))
    expected = likelihoods.prod(0) / likelihoods.prod(0).sum()
    assert_allclose(np.exp(normalised_masses(likelihoods, np.ones(2))), expected, rtol=0.02)


def test_a_cue_that_abstains_leaves_the_other_ones_order():
    """Its masses are 1/N for all particles; the scale of the likelihoods has no effect."""
    colour = np.random.default_rng(0).uniform(size=20)
    silent = np.full(20, np.nan)
    found = normalised_masses(np.stack([colour, silent]), np.ones(2))
    assert (np.argsort(found) == np.argsort(colour)).all()
    assert_allclose(found, normalised_masses(np.stack([7 * colour, silent]), np.zeros(2)))


def test_certain_cues_that_contradict_each_other_leave_no_weight():
    """All weights are zero, which the filter treats as no measurement."""
    found = normalised_masses(np.eye(2), np.ones(2))
    assert (found == -np.inf).all()
