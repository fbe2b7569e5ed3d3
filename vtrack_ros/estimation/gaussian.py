"""Gaussian densities: one error distribution, or many beliefs at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.estimation.validation import checked_covariance, checked_states, FloatArray


@dataclass(frozen=True, eq=False)
class GaussianNoise:
    """
    A zero-mean Gaussian error, factorised once for sampling and for densities.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
    factor : ndarray, shape (n, n)
        L with `L L^T = covariance`.

    """

    covariance: FloatArray
    factor: FloatArray

    @classmethod
    def from_covariance(cls, covariance: FloatArray) -> GaussianNoise:
        """
        Factorise a covariance, shape (n, n).

        Raises
        ------
        ValueError
            If it isn't positive definite.

        """
        try:
            return cls(covariance, np.linalg.cholesky(covariance))
        except np.linalg.LinAlgError:
            raise ValueError('covariance must be positive definite') from None

    @cached_property
    def whitener(self) -> FloatArray:
        """Return the inverse of the factor, shape (n, n)."""
        return np.linalg.inv(self.factor)

    @cached_property
    def log_normaliser(self) -> float:
        """Return the log-density at zero."""
        return (-len(self.factor) / 2 * math.log(2 * math.pi)
                - float(np.log(self.factor.diagonal()).sum()))

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw `count` errors, shape (count, n)."""
        return rng.standard_normal((count, len(self.factor))) @ self.factor.T

    def log_density(self, errors: FloatArray) -> FloatArray:
        """Return the log-density of errors of shape (N, n), shape (N,)."""
        white = errors @ self.whitener.T
        density: FloatArray = np.einsum('ij,ij->i', white, white)
        density *= -0.5
        density += self.log_normaliser
        return density


@dataclass(frozen=True, eq=False)
class Gaussian:
    """
    N Gaussian beliefs, side by side.

    Parameters
    ----------
    mean : ndarray, shape (N, n)
    covariance : ndarray, shape (N, n, n)
        Symmetric positive (semi-)definite.

    Raises
    ------
    ValueError
        If the shapes don't belong together.

    """

    mean: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        """Check the shapes; definiteness is checked where beliefs come in, not at every step."""
        if self.mean.ndim != 2:
            raise ValueError(f'mean must have the shape (N, n), not {self.mean.shape}')
        wanted = (*self.mean.shape, self.mean.shape[1])
        if self.covariance.shape != wanted:
            raise ValueError(f'covariance must have the shape {wanted}, '
                             f'not {self.covariance.shape}')

    @classmethod
    def from_moments(cls, mean: ArrayLike, covariance: ArrayLike) -> Gaussian:
        """
        Make beliefs of means and covariances that the caller hands in.

        Parameters
        ----------
        mean : array_like, shape (n,) or (N, n)
            One, or many.
        covariance : array_like, shape (n, n) or (N, n, n)
            One for all means, or one for each.

        Raises
        ------
        ValueError
            If shapes don't fit, a value isn't finite or a covariance not positive definite.

        """
        means = np.atleast_2d(np.asarray(mean, dtype=np.float64))
        means = checked_states('mean', means, means.shape[-1])
        count, dimension = means.shape
        matrices = np.asarray(covariance, dtype=np.float64)
        if matrices.ndim == 3:
            if len(matrices) != count:
                raise ValueError(f'covariance must hold {count} matrices, not {len(matrices)}')
            checked = np.array([checked_covariance('covariance', matrix, dimension)
                                for matrix in matrices])
        else:
            one = checked_covariance('covariance', matrices, dimension)
            checked = np.tile(one, (count, 1, 1))
        return cls(means, checked)

    def __len__(self) -> int:
        """Return the number of beliefs."""
        return len(self.mean)


def covariance_factors(covariance: FloatArray) -> FloatArray:
    """
    Return lower triangular L with `L L^T = covariance`, for many matrices.

    Cholesky's factor where it exists. If rounding has left any matrix indefinite, the factors are
    those of the nearest matrices whose eigenvalues are positive.

    Parameters
    ----------
    covariance : ndarray, shape (..., n, n)
        Symmetric.

    Returns
    -------
    ndarray, shape (..., n, n)

    """
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariance)
        least = np.finfo(np.float64).eps * np.abs(values).max(axis=-1, keepdims=True)
        root = vectors * np.sqrt(np.maximum(values, least))[..., np.newaxis, :]
        upper = np.linalg.qr(root.swapaxes(-1, -2), mode='r')
        return upper.swapaxes(-1, -2)
