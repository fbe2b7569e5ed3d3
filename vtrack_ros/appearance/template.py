"""The first look of a target, and how alike a new look is to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Features = NDArray[np.float32]


@dataclass(frozen=True)
class Template:
    """
    The first look of a target, kept for ever.

    A look is the unit vector of the features in the target's cells, less the mean feature of its
    first surroundings. Likeness is the cosine of two looks, on a scale where the surroundings of
    the target have 0 and an identical look has 1: raw cosines of unlike things start near 0.5.

    Parameters
    ----------
    look : ndarray of float32, shape (height * width * channels,)
    mean : ndarray of float32, shape (channels,)
        The mean feature.
    floor : float
        The mean cosine between the look and its surroundings.

    """

    look: Features
    mean: Features
    floor: float

    @classmethod
    def create(cls, middle: Features, surroundings: list[Features], mean: Features) -> Template:
        """
        Take the first look.

        Parameters
        ----------
        middle : ndarray of float32, shape (height, width, channels)
            Features in the target's cells.
        surroundings : list of ndarray of the same shape
            Features of places about the target.
        mean : ndarray of float32, shape (channels,)
            The mean feature of the target's window.

        """
        first = _look(middle, mean)
        floor = float(np.mean([first @ _look(other, mean) for other in surroundings]))
        return cls(first, mean, min(floor, 0.9))

    def likeness(self, middle: Features) -> float:
        """Return the likeness of features of shape (height, width, channels); at most 1."""
        return (float(self.look @ _look(middle, self.mean)) - self.floor) / (1 - self.floor)


def _look(middle: Features, mean: Features) -> Features:
    vector = (middle - mean).ravel()
    unit: Features = vector / np.float32(np.sqrt(vector @ vector) + 1e-9)
    return unit
