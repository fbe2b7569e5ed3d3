"""The Kalman filter with sigma points: UKF, QKF, P-QKF and CKF differ in the rule alone."""

from collections.abc import Callable

import numpy as np

from vtrack_ros.estimation.kalman import (
    covariance_factors, GaussianFilter, innovate, matrix_times, symmetrised)
from vtrack_ros.estimation.model import GaussianNoise, StateSpaceModel
from vtrack_ros.estimation.sigma_points import RuleFactory, SigmaPointRule
from vtrack_ros.frame import Array


class SigmaPointFilter(GaussianFilter):
    """
    The Kalman filter with a sigma-point rule in place of Jacobians.

    With `unscented` it is the UKF, with `gauss_hermite` the quadrature Kalman filter QKF
    (Arasaratnam, Haykin and Elliott, 2007), with `pruned_gauss_hermite` the P-QKF
    [Qi2012, section 2], with `cubature` the CKF.

    A linear transition is computed exactly. An update integrates only over the components that the
    measurement depends on: with these first in the covariance, its Cholesky factor makes them
    depend on an equal number of standardised variables, and all others follow by regression.

    With G = sum_i w_i (z_i - mean z) xi_i^T, the covariance of measurement and standardised state,
    the gain is `K = L G^T S^-1`, and the update in Joseph's form

        P+ = (L - K G)(L - K G)^T + K (R + Omega) K^T

    where `Omega = cov z - G G^T` is the residual covariance of a linear regression of z on x. It
    is positive semi-definite for a rule without negative weights, whose second moment is at most
    one; for any other, its negative eigenvalues are set to zero.

    `rule` makes the rule of a dimension: `unscented`, `cubature`, or e.g.
    `functools.partial(gauss_hermite, order=5)`; without `measured_only` updates integrate over
    all components.
    """

    def __init__(
            self, model: StateSpaceModel, rule: RuleFactory, measured_only: bool = True) -> None:
        super().__init__(model)
        components = list(range(model.state_dimension))
        measured = model.measured_components
        if measured_only and measured is not None:
            components = list(measured)
        rest = [i for i in range(model.state_dimension) if i not in components]
        self.update_rule = rule(len(components))
        # only a transition that isn't linear needs one: over all components it may be huge
        self.transition_rule: SigmaPointRule | None = None
        if model.transition_matrix(1.0) is None:
            self.transition_rule = rule(model.state_dimension) if rest else self.update_rule
        self._order = None if components + rest == sorted(components + rest) else np.array(
            components + rest)
        self._clamped = not _is_contraction(self.update_rule)

    def _floats_per_belief(self) -> int:
        points = max(len(self.update_rule), len(self.transition_rule or ()))
        return max(points * self.model.state_dimension, super()._floats_per_belief())

    def _predict(self, mean: Array, covariance: Array, dt: float,
                 time: float) -> tuple[Array, Array]:
        matrix = self.model.transition_matrix(dt)
        if matrix is not None:
            return self._propagate(mean, covariance, matrix, dt, time)
        rule = self.transition_rule
        assert rule is not None
        moved = self._at_points(
            lambda points: self.model.transition(points, dt, time), rule.points, mean,
            covariance_factors(covariance))
        predicted = np.matmul(rule.mean_weights, moved)
        moved -= predicted[:, np.newaxis]
        weighted = moved * rule.covariance_weights[:, np.newaxis]
        spread = weighted.swapaxes(1, 2) @ moved
        spread += self.model.process_noise(dt)
        return predicted, symmetrised(spread)

    def _update(self, mean: Array, covariance: Array, measurement: Array, time: float,
                error: GaussianNoise) -> tuple[Array, Array, Array]:
        rule, model = self.update_rule, self.model
        factor = self._factors(covariance)
        leading = factor[:, :, :rule.dimension]
        measured = self._at_points(
            lambda points: model.measure(points, time), rule.points, mean, leading)
        # Angles can't be averaged: average their differences to the point of largest weight.
        reference = measured[:, np.argmax(rule.mean_weights)].copy()
        deviation = model.residual(measured, reference[:, np.newaxis])
        del measured
        offset = np.matmul(rule.mean_weights, deviation)
        deviation -= offset[:, np.newaxis]
        weighted = (deviation * rule.covariance_weights[:, np.newaxis]).swapaxes(1, 2)
        spread = weighted @ deviation
        regression = weighted @ rule.points
        remainder = spread - regression @ regression.swapaxes(1, 2)
        if self._clamped:
            values, vectors = np.linalg.eigh(remainder)
            remainder = (vectors * np.maximum(values, 0.0)[:, np.newaxis]) @ vectors.swapaxes(1, 2)
            spread = remainder + regression @ regression.swapaxes(1, 2)
        residual = model.residual(measurement, reference + offset)
        gain, log_evidence = innovate(
            leading @ regression.swapaxes(1, 2), spread + error.covariance, residual)
        leading -= gain @ regression
        posterior = factor @ factor.swapaxes(1, 2)
        posterior += gain @ (remainder + error.covariance) @ gain.swapaxes(1, 2)
        return mean + matrix_times(gain, residual), symmetrised(posterior), log_evidence

    def _factors(self, covariance: Array) -> Array:
        """Return factors whose leading columns alone move the measured components."""
        order = self._order
        if order is None:
            return covariance_factors(covariance)
        factor = np.empty(covariance.shape)
        factor[:, order] = covariance_factors(covariance[:, order[:, np.newaxis], order])
        return factor

    @staticmethod
    def _at_points(function: Callable[[Array], Array], standard: Array, mean: Array,
                   factor: Array) -> Array:
        """Return a function's values at each belief's sigma points, shape (N, points, ...)."""
        points = standard @ factor.swapaxes(1, 2)
        points += mean[:, np.newaxis]
        values = function(points.reshape(-1, mean.shape[1]))
        return values.reshape(len(mean), len(standard), -1)


def _is_contraction(rule: SigmaPointRule) -> bool:
    """Tell whether no weight is negative, and no second moment above one, but for rounding."""
    weights = rule.covariance_weights
    moments = np.linalg.eigvalsh((rule.points.T * weights) @ rule.points)
    return bool((weights >= 0).all() and (moments <= 1 + 1e-9).all())
