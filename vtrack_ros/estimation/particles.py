"""Weighted particle sets: log-weights, beliefs and resampling."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
import math

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.estimation.model import checked_count
from vtrack_ros.frame import Array


@dataclass(frozen=True, eq=False)
class Weights:
    """
    Normalised importance weights, made by `from_log` or `uniform`.

    The values (N,) have the sum one, the logarithm of zero is -inf; `log_evidence` is the
    logarithm of the sum before normalisation; `recovered` is true if all weights vanished, so that
    these are the fallback.
    """

    values: Array
    logarithms: Array
    log_evidence: float = 0.0
    recovered: bool = False

    @classmethod
    def from_log(cls, log_weights: Array, fallback: Weights | None = None) -> Weights:
        """
        Normalise log-weights, whatever their size; the result is never NaN.

        A NaN or +inf is a defect of a likelihood, not information: such a particle gets no
        weight. Where no particle has any (nothing explains the measurement), the result is the
        fallback, usually the previous weights and by default uniform ones, with `recovered` set:
        the measurement is ignored, and the caller can count it.
        """
        log_weights = np.asarray(log_weights, dtype=np.float64)
        if log_weights.ndim != 1 or not log_weights.size:
            raise ValueError(
                f'log_weights must be a non-empty vector, not of shape {log_weights.shape}')
        peak = log_weights.max()
        if not math.isfinite(peak):
            usable = np.isfinite(log_weights)
            if not usable.any():
                rest = fallback if fallback is not None else cls.uniform(len(log_weights))
                return cls(rest.values, rest.logarithms, -math.inf, True)
            log_weights = np.where(usable, log_weights, -math.inf)
            peak = log_weights.max()
        values = np.exp(log_weights - peak)
        total = values.sum()
        values /= total
        log_total = float(peak) + math.log(total)
        return cls(values, log_weights - log_total, log_total)

    @staticmethod
    @lru_cache(maxsize=16)
    def uniform(count: int) -> Weights:
        """Return `count` equal weights."""
        count = checked_count('count', count)
        values, logarithms = np.full(count, 1.0 / count), np.full(count, -math.log(count))
        values.flags.writeable = logarithms.flags.writeable = False
        return Weights(values, logarithms)

    def __len__(self) -> int:
        """Return the number of weights."""
        return len(self.values)

    @cached_property
    def effective_sample_size(self) -> float:
        """Return the Kish effective sample size, `1 / sum w^2`: from 1 to N."""
        return float(1.0 / (self.values @ self.values))


@dataclass(frozen=True, eq=False)
class Belief:
    """
    A weighted particle set at one time, and the memory that proposals need.

    States are of shape (N, n); covariances (N, n, n) are of each particle's own Gaussian filter,
    where the proposal keeps them; estimates are the last means (n,), oldest first, as many as the
    proposal's window.
    """

    states: Array
    weights: Weights
    time: float = 0.0
    covariances: Array | None = None
    estimates: tuple[Array, ...] = ()
    estimate_times: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check that the parts belong together."""
        if self.states.ndim != 2 or len(self.states) != len(self.weights):
            raise ValueError(f'states must have the shape ({len(self.weights)}, n) of the '
                             f'weights, not {self.states.shape}')
        wanted = (*self.states.shape, self.states.shape[1])
        if self.covariances is not None and self.covariances.shape != wanted:
            raise ValueError(f'covariances must have the shape {wanted}, '
                             f'not {self.covariances.shape}')
        if len(self.estimates) != len(self.estimate_times):
            raise ValueError(f'{len(self.estimates)} estimates have '
                             f'{len(self.estimate_times)} estimate_times')

    def __len__(self) -> int:
        """Return the number of particles."""
        return len(self.states)

    @cached_property
    def mean(self) -> Array:
        """Return the weighted mean, shape (n,) [Zhu2012, eq. 6]."""
        return self.weights.values @ self.states

    @cached_property
    def covariance(self) -> Array:
        """Return the weighted covariance about the mean, shape (n, n) [Zhu2012, eq. 7]."""
        return spread_about(self.mean, self.states, self.weights.values)


def spread_about(centre: Array, states: Array, weights: Array) -> Array:
    """Return `sum_i w_i (x_i - c)(x_i - c)^T` of (N, n) states about c, shape (n, n)."""
    deviation = states - centre
    return (deviation.T * weights) @ deviation


def at_least(covariance: Array, least: Array) -> Array:
    """
    Return a covariance, shape (n, n), raised where it's below another one.

    `least`, shape (n,), are the variances of the other one, which is diagonal and positive. In
    every direction the result is no less than it: so it's positive definite.
    """
    if (covariance.diagonal() / least).sum() <= 1:
        # no eigenvalue exceeds the trace; and the eigenvalues take time in every frame
        return np.diag(least)
    scale = np.sqrt(least)
    values, vectors = np.linalg.eigh(covariance / scale / scale[:, None])
    root = vectors * np.sqrt(np.maximum(values, 1.0)) * scale[:, None]
    raised: Array = root @ root.T
    return raised


def systematic(weights: Array, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """
    Resample with one uniform number: the points (j + u) / count on the cumulative weights.

    Returns `count` ascending indices in time O(N + count); particle i of N is drawn
    `count * weights[i]` times on average, and the actual number always differs from that by less
    than one: in most cases no scheme has less variance (Douc, Cappe and Moulines, 2005).

    The weights, shape (N,), need not be normalised; ValueError unless they are finite and
    non-negative, with a positive sum.
    """
    checked_count('count', count)
    if weights.ndim != 1 or not weights.size:
        raise ValueError(f'weights must be a non-empty vector, not of shape {weights.shape}')
    total = float(weights.sum())
    # The negation catches NaN as well.
    if not (weights.min() >= 0 and 0 < total < math.inf):
        raise ValueError('weights must be finite, non-negative and not all zero')
    ends = weights.cumsum(dtype=np.float64)
    ends *= count / float(ends[-1])
    ends[-1] = count
    ends -= rng.random()
    copies = np.ceil(ends, out=ends).astype(np.intp)
    del ends
    copies[1:] -= copies[:-1].copy()
    return np.repeat(np.arange(len(copies)), copies)
