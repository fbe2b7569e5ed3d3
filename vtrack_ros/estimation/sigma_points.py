"""
Sigma points: rules that replace the integral of a function over a Gaussian by a weighted sum.

A rule's points xi are for N(0, I) of a dimension; those for N(mean, P) are `mean + L xi` with
`L L^T = P`.
"""

from collections.abc import Callable
from dataclasses import dataclass
import itertools
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.estimation.model import checked_count, checked_positive
from vtrack_ros.frame import Array

#: Largest number of points of a product rule: it bounds the memory.
MOST_POINTS = 1_000_000
#: Highest order of a one-dimensional rule: from about 380 on its weights overflow.
HIGHEST_ORDER = 300


@dataclass(frozen=True, eq=False)
class SigmaPointRule:
    """Points (m, n) for N(0, I), and weights (m,): of the mean (sum one), of the covariance."""

    points: Array
    mean_weights: Array
    covariance_weights: Array

    @property
    def dimension(self) -> int:
        """Return n."""
        return int(self.points.shape[1])

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)


RuleFactory: TypeAlias = Callable[[int], SigmaPointRule]
"""Makes a rule of a given dimension."""


def unscented(dimension: int, alpha: float = 1.0, beta: float = 0.0,
              kappa: float | None = None) -> SigmaPointRule:
    """
    Return the unscented rule: 2n + 1 points (Julier and Uhlmann, 2004; Wan and van der Merwe).

    `lambda = alpha^2 (n + kappa) - n`. By default kappa is 3 - n, and zero where that is negative:
    no weight is negative then. For n = 1 the default is the Gauss-Hermite rule of order 3.
    """
    n = checked_count('dimension', dimension)
    checked_positive('alpha', alpha)
    kappa = max(3.0 - n, 0.0) if kappa is None else kappa
    scale = checked_positive('n + kappa', n + kappa) * alpha ** 2
    radius = math.sqrt(scale) * np.eye(n)
    weights = np.full(2 * n + 1, 0.5 / scale)
    weights[0] = 1.0 - n / scale
    covariance_weights = weights.copy()
    covariance_weights[0] += 1.0 - alpha ** 2 + beta
    return SigmaPointRule(np.vstack([np.zeros(n), radius, -radius]), weights, covariance_weights)


def cubature(dimension: int) -> SigmaPointRule:
    """Return the third-degree spherical-radial rule: 2n points (Arasaratnam and Haykin, 2009)."""
    n = checked_count('dimension', dimension)
    radius = math.sqrt(n) * np.eye(n)
    weights = np.full(2 * n, 0.5 / n)
    return SigmaPointRule(np.vstack([radius, -radius]), weights, weights)


def gauss_hermite(dimension: int, order: int = 3) -> SigmaPointRule:
    """
    Return the product rule of m Gauss-Hermite points in each dimension: m^n points.

    It integrates every polynomial exactly whose degree in each variable is 2m - 1 or less
    (Arasaratnam, Haykin and Elliott, 2007). ValueError where there would be too many points.
    """
    n = checked_count('dimension', dimension)
    order = checked_count('order', order)
    if order ** n > MOST_POINTS:
        raise ValueError(f'order {order} in dimension {n} needs {order ** n} points, '
                         f'more than {MOST_POINTS}')
    nodes, weights = hermite_nodes(order)
    points = np.array(list(itertools.product(nodes, repeat=n)))
    products = np.array([math.prod(some) for some in itertools.product(weights, repeat=n)])
    return SigmaPointRule(points, products, products)


def hermite_nodes(order: int) -> tuple[Array, Array]:
    """
    Return nodes, ascending, and weights of the Gauss-Hermite rule for N(0, 1).

    ValueError unless the order is from 1 to 300.
    """
    if checked_count('order', order) > HIGHEST_ORDER:
        raise ValueError(f'order must be at most {HIGHEST_ORDER}, not {order}')
    nodes, weights = np.polynomial.hermite_e.hermegauss(order)
    return nodes, weights / weights.sum()


def pruning_threshold(dimension: int, order: int, printed: bool = False) -> float:
    """
    Return the weight below which a point of the product rule is pruned.

    As printed it is `omega_1 omega_floor((m+1)/2) / m` [Qi2012, eq. 20], of the m ordered
    one-dimensional weights: the smallest and the one in the middle. This is the two-dimensional
    case of `omega_1 omega_mid / m^(n-1)` (Jaeckel, 2005), the default. Either way nothing is
    pruned in one dimension; the printed one leaves only the centre in five or more (third order).
    """
    order = checked_count('order', order)
    _, weights = hermite_nodes(order)
    power = 1 if printed else checked_count('dimension', dimension) - 1
    return float(weights[0] * weights[(order + 1) // 2 - 1] / order ** power)


def pruned_gauss_hermite(dimension: int, order: int = 3, threshold: float | None = None,
                         regroup: bool = False, matched: bool = True) -> SigmaPointRule:
    """
    Return the product rule without its points of small weight [Qi2012, section 2.1].

    The rest is renormalised, and scaled so that the second moment is the identity again: the
    rule then integrates 1, x and x x^T exactly, as far as a Kalman filter needs.

    Parameters
    ----------
    dimension, order : int
        n, and m, the points in each dimension before pruning.
    threshold : float, optional
        Points with a smaller weight are pruned; by default `pruning_threshold(n, m)`. ValueError
        where only the centre would be left.
    regroup : bool
        Whether a pruned point is replaced, as printed, by `xi_a + L (xi_a - xi)` with its weight
        [Qi2012, eq. 21], in place of being left out; xi_a is the nearest kept point (the centroid,
        of several), and `L = (1 / (M omega))^(1/n)` [Qi2012, eq. 22] with M points in all and the
        weight omega of xi_a (the paper doesn't say which; with the pruned point's own, the new
        points lie at up to 25 standard deviations). Regrouping saves no points and changes the
        second moment unless it's `matched`: of 3 or 5 points in one dimension, with the outermost
        pair regrouped, to 0.25 or 0.82, so that an update subtracts too little; of 9 to 1.11.
    matched : bool
        Whether the second moment is restored.

    """
    full = gauss_hermite(dimension, order)
    if threshold is None:
        threshold = pruning_threshold(dimension, order)
    # Products of the same factors in another order may differ in the last digit.
    kept = full.mean_weights >= threshold * (1 - 1e-9)
    if kept.all() and len(full) > 1:
        return full
    if regroup:
        points, weights = full.points.copy(), full.mean_weights
        if kept.any():
            points[~kept] = _regrouped(full, kept)
    else:
        points, weights = full.points[kept], full.mean_weights[kept]
    weights = weights / weights.sum()
    moment = float(weights @ points[:, 0] ** 2)
    if not kept.any() or moment < 1e-6:
        raise ValueError(f'threshold {threshold:.3g} leaves no point beside the centre')
    if matched:
        points = points / math.sqrt(moment)
    return SigmaPointRule(points, weights, weights)


def _regrouped(rule: SigmaPointRule, kept: NDArray[np.bool_]) -> Array:
    """Return the points that take the place of those not kept [Qi2012, eqs 21 and 22]."""
    anchors, anchor_weights = rule.points[kept], rule.mean_weights[kept]
    replaced = []
    for point in rule.points[~kept]:
        distance = np.linalg.norm(anchors - point, axis=1)
        nearest = distance <= distance.min() + 1e-9
        anchor = anchors[nearest].mean(axis=0)
        step = (len(rule) * anchor_weights[nearest].mean()) ** (-1 / rule.dimension)
        replaced.append(anchor + step * (anchor - point))
    return np.array(replaced).reshape(-1, rule.dimension)
