"""What a particle filter believes at one time: weighted particles and past estimates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from vtrack_ros.estimation.validation import FloatArray
from vtrack_ros.estimation.weights import Weights


@dataclass(frozen=True, eq=False)
class Belief:
    """
    A weighted particle set, and what proposals need besides.

    Parameters
    ----------
    states : ndarray, shape (N, n)
    weights : Weights
    time : float
    covariances : ndarray, shape (N, n, n), optional
        Of each particle's own Gaussian filter, where the proposal keeps them.
    estimates : tuple of ndarray, each of shape (n,)
        The last means, oldest first; as many as the proposal's window.
    estimate_times : tuple of float
        The times of the estimates.

    Raises
    ------
    ValueError
        If the numbers of states, weights and covariances differ.

    """

    states: FloatArray
    weights: Weights
    time: float = 0.0
    covariances: FloatArray | None = None
    estimates: tuple[FloatArray, ...] = ()
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
    def mean(self) -> FloatArray:
        """Return the weighted mean, shape (n,) [Zhu2012, eq. 6]."""
        return self.weights.values @ self.states

    @cached_property
    def covariance(self) -> FloatArray:
        """Return the weighted covariance about the mean, shape (n, n) [Zhu2012, eq. 7]."""
        return self.spread_about(self.mean)

    def spread_about(self, centre: FloatArray) -> FloatArray:
        """Return `sum_i w_i (x_i - c)(x_i - c)^T` about a centre c, shape (n, n)."""
        return spread_about(centre, self.states, self.weights.values)


def spread_about(centre: FloatArray, states: FloatArray, weights: FloatArray) -> FloatArray:
    """
    Return `sum_i w_i (x_i - c)(x_i - c)^T`.

    Parameters
    ----------
    centre : ndarray, shape (n,)
        c.
    states : ndarray, shape (N, n)
        x_i.
    weights : ndarray, shape (N,)
        w_i, with sum one.

    Returns
    -------
    ndarray, shape (n, n)

    """
    deviation = states - centre
    spread: FloatArray = (deviation.T * weights) @ deviation
    return spread
