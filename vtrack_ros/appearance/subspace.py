"""The subspace of a target's patches: incremental principal components with a robust error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtrack_ros.frame import Array, Array32

Vectors = Array32

#: Patches handled at once: blocks that fit the processor's cache are several times as fast.
_BLOCK = 64


@dataclass(frozen=True)
class Subspace:
    """
    Mean and principal components of all patches so far, with exponential forgetting.

    The model is probabilistic PCA: a patch is a point of the subspace plus noise. It's updated by
    the sequential Karhunen-Loeve algorithm with a moving mean [Ross2008, sec. 3.1]. The
    mean has shape (d,), the components (d, k), with orthonormal columns in the order of falling
    singular values (of the centred patches); k is at most `limit`. `count` is the effective number
    of patches, with forgetting.
    """

    mean: Vectors
    components: Vectors
    singular_values: Array
    count: float
    limit: int

    @classmethod
    def create(cls, patch: Vectors, limit: int = 16) -> Subspace:
        """Make the subspace of one patch, shape (d,): a mean without components."""
        return cls(patch.astype(np.float32), np.zeros((len(patch), 0), np.float32), np.zeros(0),
                   1.0, limit)

    def updated(self, patches: Vectors, forgetting: float = 0.95) -> Subspace:
        """
        Return the subspace after a batch of patches, shape (m, d).

        `forgetting` is the weight of everything before, in (0, 1]; 1 forgets nothing.
        """
        fresh = patches.astype(np.float64)
        many, before = len(fresh), forgetting * self.count
        count = before + many
        own_mean, mean = fresh.mean(0), self.mean.astype(np.float64)
        # the difference of the means is one more column [Ross2008, lemma 1]
        apart = np.sqrt(before * many / count) * (own_mean - mean)
        # the scatter is multiplied by `forgetting`, as the count is; in [Ross2008] the
        # singular values are, so that old patches fade twice as fast there as in the mean
        columns = np.concatenate([
            np.sqrt(forgetting) * self.components * self.singular_values,
            (fresh - own_mean).T, apart[:, None]], axis=1)
        components, values, _ = np.linalg.svd(columns, full_matrices=False)
        kept = min(self.limit, int((values > 1e-6 * max(values[0], 1e-12)).sum()))
        return Subspace(
            ((before * mean + many * own_mean) / count).astype(np.float32),
            components[:, :kept].astype(np.float32), values[:kept], count, self.limit)

    def residuals(self, patches: Vectors) -> Vectors:
        """Return the residuals of patches, shape (n, d), from the subspace; same shape."""
        difference: Vectors = patches - self.mean
        difference -= (difference @ self.components) @ self.components.T
        return difference

    def robust_error(self, patches: Vectors, width: float) -> Vectors:
        """
        Return the mean over the pixels of e^2 / (e^2 + width^2), e the residual, shape (n,).

        The error norm of Geman and McClure, as [Ross2008]: an outlier adds at most the
        weight of one pixel, however large its residual is.
        """
        errors = np.empty(len(patches), np.float32)
        for first in range(0, len(patches), _BLOCK):
            squares = self.residuals(patches[first:first + _BLOCK])
            squares *= squares
            squares /= squares + np.float32(width**2)
            errors[first:first + _BLOCK] = squares.mean(1)
        return errors
