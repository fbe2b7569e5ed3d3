"""Sigma-point rules: what they integrate exactly, what pruning keeps and what it costs."""

import itertools
import math

import numpy as np
import pytest

from vtrack_ros.estimation import (
    cubature, gauss_hermite, hermite_nodes, pruned_gauss_hermite, pruning_threshold, unscented)


def moment(powers):
    """Return E[prod x_i^p_i] of N(0, I): the product of (p - 1)!! for even p, else zero."""
    return math.prod(
        0 if power % 2 else math.prod(range(1, power, 2)) for power in powers)


def integral(rule, powers):
    return float(rule.mean_weights @ np.prod(rule.points ** np.array(powers), axis=1))


def second_moment_of(rule):
    """Return `sum_i w_i xi_i xi_i^T`: the identity, for a valid rule."""
    return (rule.points.T * rule.covariance_weights) @ rule.points


def magnitude(rule, powers):
    return float(np.abs(rule.mean_weights) @ np.prod(np.abs(rule.points ** np.array(powers)),
                                                     axis=1))


@pytest.mark.parametrize('dimension, order', [
    (1, 1), (1, 2), (1, 3), (1, 5), (1, 7), (1, 12), (2, 3), (2, 4), (3, 3), (4, 2)])
def test_gauss_hermite_is_exact_to_its_order(dimension, order):
    """Every monomial with degree 2m - 1 or less in each variable."""
    rule = gauss_hermite(dimension, order)
    assert len(rule) == order ** dimension
    for powers in itertools.product(range(2 * order), repeat=dimension):
        assert integral(rule, powers) == pytest.approx(
            moment(powers), abs=1e-12 * max(1.0, magnitude(rule, powers)))


@pytest.mark.parametrize('order', [1, 2, 3, 5])
def test_gauss_hermite_is_wrong_one_degree_higher(order):
    """The m nodes are the zeros of a polynomial of degree m, so its square integrates to zero."""
    assert integral(gauss_hermite(1, order), [2 * order]) < moment([2 * order]) - 0.5


@pytest.mark.parametrize('rule', [
    *(unscented(n) for n in (1, 2, 3, 4, 6)), unscented(3, alpha=0.5, beta=2.0, kappa=1.0),
    *(cubature(n) for n in (1, 2, 4, 6))], ids=lambda rule: f'{len(rule)}x{rule.dimension}')
def test_third_degree_rules(rule):
    """Every monomial of total degree three or less."""
    n = rule.dimension
    for powers in itertools.product(range(4), repeat=n):
        if sum(powers) <= 3:
            assert integral(rule, powers) == pytest.approx(moment(powers), abs=1e-10)


def test_the_number_of_points():
    assert [len(unscented(n)) for n in (1, 4, 6)] == [3, 9, 13]
    assert [len(cubature(n)) for n in (1, 4, 6)] == [2, 8, 12]


def test_unscented_in_one_dimension_is_gauss_hermite_of_order_three():
    unscented_rule, hermite = unscented(1, kappa=2.0), gauss_hermite(1, 3)
    order = np.argsort(unscented_rule.points[:, 0])
    np.testing.assert_allclose(unscented_rule.points[order], hermite.points, atol=1e-14)
    np.testing.assert_allclose(unscented_rule.mean_weights[order], hermite.mean_weights)


@pytest.mark.parametrize('dimension', [1, 2, 3, 4, 6])
def test_default_rules_have_no_negative_weights(dimension):
    for factory in (unscented, cubature, gauss_hermite, pruned_gauss_hermite):
        assert (factory(dimension).covariance_weights >= 0).all()


@pytest.mark.parametrize('order', [2, 3, 4, 5, 7, 9])
def test_the_printed_threshold_prunes_nothing_in_one_dimension(order):
    """In one dimension P-QKF is QKF: eq. 20 as printed lies below the smallest weight."""
    _, weights = hermite_nodes(order)
    full = gauss_hermite(1, order)
    for printed in (True, False):
        threshold = pruning_threshold(1, order, printed)
        assert threshold < weights.min()
        pruned = pruned_gauss_hermite(1, order, threshold)
        np.testing.assert_allclose(pruned.points, full.points, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(pruned.mean_weights, full.mean_weights)


def test_the_printed_threshold_is_the_product_rule_s_in_two_dimensions():
    _, weights = hermite_nodes(3)
    assert pruning_threshold(2, 3, printed=True) == pytest.approx(weights[0] * weights[1] / 3)
    assert pruning_threshold(2, 3) == pruning_threshold(2, 3, printed=True)


@pytest.mark.parametrize('dimension, printed, left', [
    (2, True, 5), (3, True, 7), (4, True, 9), (2, False, 5), (4, False, 33), (6, False, 233)])
def test_points_left_of_the_third_order_rule(dimension, printed, left):
    threshold = pruning_threshold(dimension, 3, printed)
    assert len(pruned_gauss_hermite(dimension, 3, threshold)) == left


def test_the_printed_threshold_leaves_the_centre_alone_from_five_dimensions_on():
    with pytest.raises(ValueError, match='threshold'):
        pruned_gauss_hermite(5, 3, pruning_threshold(5, 3, printed=True))


@pytest.mark.parametrize('dimension, order', [
    (1, 3), (1, 5), (2, 3), (2, 4), (2, 5), (3, 3), (3, 5), (4, 3), (6, 3)])
@pytest.mark.parametrize('regroup', [False, True])
def test_pruned_rules_keep_the_first_two_moments(dimension, order, regroup):
    rule = pruned_gauss_hermite(dimension, order, regroup=regroup)
    assert rule.mean_weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(rule.mean_weights @ rule.points, 0.0, atol=1e-12)
    np.testing.assert_allclose(second_moment_of(rule), np.eye(dimension), atol=1e-12)
    assert (rule.mean_weights > 0).all()


@pytest.mark.parametrize('order, second_moment', [
    (3, 0.25), (5, (7 + 2 * math.sqrt(10)) / 30 * (5 - math.sqrt(10)))])
def test_regrouping_as_printed_shrinks_the_second_moment(order, second_moment):
    """
    The outermost pair, folded over its neighbours in one dimension.

    For order 3: the neighbour is zero with weight 2/3, so L = 1 / (3 * 2/3) = 1/2, the nodes at
    sqrt(3) fold to sqrt(3)/2, and the moment is 2 * 1/6 * 3/4 = 1/4. For order 5 the outermost
    nodes land within 0.01 of zero, and the inner ones, sqrt(5 - sqrt(10)), are left.
    """
    _, weights = hermite_nodes(order)
    rule = pruned_gauss_hermite(1, order, weights[1], regroup=True, matched=False)
    assert len(rule) == order
    assert second_moment_of(rule)[0, 0] == pytest.approx(second_moment, abs=1e-4)
    matched = pruned_gauss_hermite(1, order, weights[1], regroup=True)
    assert second_moment_of(matched)[0, 0] == pytest.approx(1.0)


@pytest.mark.parametrize('make, name', [
    (lambda: gauss_hermite(0), 'dimension'), (lambda: gauss_hermite(2, 0), 'order'),
    (lambda: gauss_hermite(1, 400), 'order'), (lambda: pruning_threshold(1, 400), 'order'),
    (lambda: gauss_hermite(13, 3), 'points'), (lambda: cubature(0), 'dimension'),
    (lambda: unscented(0), 'dimension'), (lambda: unscented(2, kappa=-2.0), 'kappa'),
    (lambda: unscented(2, alpha=0.0), 'alpha'),
    (lambda: pruned_gauss_hermite(2, 3, 0.9), 'threshold')])
def test_wrong_arguments_are_refused(make, name):
    with pytest.raises(ValueError, match=name):
        make()


def test_the_pruning_threshold_checks_its_numbers():
    assert pruning_threshold(2.0, 3.0) == pruning_threshold(2, 3)
    assert len(pruned_gauss_hermite(2.0, 3.0)) == len(pruned_gauss_hermite(2, 3))
    with pytest.raises(ValueError, match='dimension'):
        pruning_threshold(0, 3)
    with pytest.raises(ValueError, match='no point beside the centre'):
        pruned_gauss_hermite(2, 1)
