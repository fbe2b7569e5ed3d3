"""Stored looks of a target, and how alike a new look is to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Look = NDArray[np.float32]

_CAPACITY = 8


@dataclass(frozen=True)
class TemplateMemory:
    """
    The first look of a target, kept for ever, and its latest verified looks.

    A look is the unit vector of the features in the target's cells, less the mean feature of its
    first surroundings. Likeness is the cosine of two looks, on a scale where the surroundings of
    the target have 0 and an identical look has 1: raw cosines of unlike things start near 0.5.

    Parameters
    ----------
    looks : tuple of ndarray of float32, shape (features,)
        The first look, then the later ones.
    mean : ndarray of float32, shape (channels,)
        The mean feature.
    floor : float
        The mean cosine between the first look and its surroundings.

    """

    looks: tuple[Look, ...]
    mean: NDArray[np.float32]
    floor: float

    @classmethod
    def create(cls, middle: NDArray[np.float32], surroundings: list[NDArray[np.float32]],
               mean: NDArray[np.float32]) -> TemplateMemory:
        """
        Begin with one look.

        Parameters
        ----------
        middle : ndarray of float32, shape (height, width, channels)
            Features in the target's cells.
        surroundings : list of ndarray of the same shape
            Features of places about the target.
        mean : ndarray of float32, shape (channels,)

        """
        first = _look(middle, mean)
        floor = float(np.mean([first @ _look(other, mean) for other in surroundings]))
        return cls((first,), mean, min(floor, 0.9))

    def look(self, middle: NDArray[np.float32]) -> Look:
        """Return the look that features of shape (height, width, channels) make."""
        return _look(middle, self.mean)

    def likeness(self, look: Look) -> float:
        """Return the likeness with the nearest stored look; at most 1, about 0 for others."""
        cosine = max(float(stored @ look) for stored in self.looks)
        return (cosine - self.floor) / (1 - self.floor)

    def first_likeness(self, look: Look) -> float:
        """Return the likeness with the first look."""
        return (float(self.looks[0] @ look) - self.floor) / (1 - self.floor)

    def remembering(self, look: Look) -> TemplateMemory:
        """Return the memory with one more look; the oldest but the first makes room."""
        first, *later = self.looks
        return replace(self, looks=(first, *later[-(_CAPACITY - 2):], look))


def _look(middle: NDArray[np.float32], mean: NDArray[np.float32]) -> Look:
    vector = (middle - mean).ravel()
    unit: Look = vector / np.float32(np.sqrt(vector @ vector) + 1e-9)
    return unit
