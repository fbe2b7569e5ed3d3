"""Importance weights: kept as logarithms until they are normalised."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
import math

import numpy as np

from vtrack_ros.estimation.validation import checked_count, FloatArray


@dataclass(frozen=True, eq=False)
class Weights:
    """
    Normalised importance weights.

    Made by `from_log` or `uniform`. Particle i with weight zero has log-weight -inf.

    Parameters
    ----------
    values : ndarray, shape (N,)
        Non-negative, with sum one.
    logarithms : ndarray, shape (N,)
        Their logarithms.
    log_evidence : float
        The logarithm of the sum before normalisation; -inf where nothing had any weight.
    recovered : bool
        Whether no weight was left, so that these are the fallback.

    """

    values: FloatArray
    logarithms: FloatArray
    log_evidence: float = 0.0
    recovered: bool = False

    @classmethod
    def from_log(cls, log_weights: FloatArray, fallback: Weights | None = None) -> Weights:
        """
        Normalise log-weights, whatever their size.

        A NaN or +inf is a defect of a likelihood, not evidence: such a particle gets no weight.
        Where no particle has any (nothing explains the measurement), the result is the fallback
        with `recovered` set: the measurement is ignored, and the caller can count it.

        Parameters
        ----------
        log_weights : ndarray, shape (N,)
            Not normalised; -inf means no weight.
        fallback : Weights, optional
            Those to return if no weight is left, usually those of before the measurement;
            uniform by default.

        Returns
        -------
        Weights
            Never NaN.

        Raises
        ------
        ValueError
            If `log_weights` isn't a non-empty vector.

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

    @classmethod
    def uniform(cls, count: int) -> Weights:
        """
        Return `count` equal weights.

        Raises
        ------
        ValueError
            If `count` < 1.

        """
        return _uniform(checked_count('count', count))

    def __len__(self) -> int:
        """Return the number of weights."""
        return len(self.values)

    @cached_property
    def effective_sample_size(self) -> float:
        """Return the Kish effective sample size, `1 / sum w^2`: from 1 to N."""
        return float(1.0 / (self.values @ self.values))


@lru_cache(maxsize=16)
def _uniform(count: int) -> Weights:
    values = np.full(count, 1.0 / count)
    logarithms = np.full(count, -math.log(count))
    values.flags.writeable = False
    logarithms.flags.writeable = False
    return Weights(values, logarithms)
