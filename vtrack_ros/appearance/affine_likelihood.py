"""The likelihood of affine frames: colour, and the subspace of patches."""

from dataclasses import replace

import numpy as np

from vtrack_ros.appearance.affine_patches import AffinePatches
from vtrack_ros.appearance.subspace import Subspace
from vtrack_ros.frame import Array, Array32, Frame

#: Width of the robust error norm: residual, of grey in [0, 1], at which a pixel counts half.
_ROBUST_WIDTH = 0.1


class AffineLikelihood:
    """
    The likelihood of affine frames: a product of two terms [Xiang, secs 3.3.1 and 3.3.2].

    Both are learned from the first frame, in which the affine frame `first` maps a rectangle of
    `size` (width, height) onto the target. A patch has `side` samples along each side, the
    subspace at most `components` components. `colour` enables the colour term; a grey frame has
    none.
    """

    def __init__(self, frame: Frame, first: Array, size: tuple[float, float],
                 components: int, colour: bool, side: int = 32) -> None:
        patches = AffinePatches(frame, first[None], size, side)
        self.size, self.side = size, side
        self.subspace = Subspace.create(patches.grey()[0], components)
        self._first = self.subspace.mean
        self._colours: Array | None = None
        if colour and frame.ndim == 3:
            histogram = patches.colours()[0]
            self._colours = np.sqrt(histogram / max(histogram.sum(), 1e-12))
        self._fresh: list[Array32] = []

    def log_likelihood(self, frame: Frame, states: Array, colour: float, subspace: float) -> Array:
        """
        Return the log-likelihood of affine frames (N, 3, 3), up to a constant; shape (N,).

        `colour` is the standard deviation of the Bhattacharyya distance of colour histograms,
        `subspace` that of the square root of the subspace's robust error; inf drops the term.
        """
        patches = AffinePatches(frame, states, self.size, self.side)
        result = self.subspace.robust_error(patches.grey(), _ROBUST_WIDTH).astype(np.float64)
        result /= -2 * subspace**2
        if self._colours is not None:
            similarity = np.sqrt(patches.colours()) @ self._colours
            result -= (1 - similarity) / (2 * colour**2)
        return result

    def patch(self, frame: Frame, state: Array) -> Array32:
        """Return the grey patch under one affine frame, shape (d,)."""
        patches = AffinePatches(frame, state[None], self.size, self.side)
        patch: Array32 = patches.grey()[0]
        return patch

    def similarity(self, patch: Array32) -> float:
        """Return the correlation of a patch with the first one, in [-1, 1]."""
        first, other = self._first - self._first.mean(), patch - patch.mean()
        norm = float(np.sqrt((first @ first) * (other @ other)))
        return float(first @ other) / norm if norm > 1e-6 else 0.0

    def update(self, patch: Array32, interval: int, forgetting: float, components: int) -> None:
        """Collect a patch, shape (d,); every `interval` patches, update the subspace with them."""
        self._fresh.append(patch)
        if len(self._fresh) >= interval:
            subspace = replace(self.subspace, limit=components)
            self.subspace = subspace.updated(np.array(self._fresh), forgetting)
            self._fresh.clear()
