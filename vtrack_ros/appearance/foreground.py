"""Which colours are the target's, and which its surroundings'."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame

_LEVELS = 16
_GREY_LEVELS = 32
#: Share of the target's size about it that counts for neither: the border is uncertain.
_MARGIN = 0.2
#: Evidence that a colour needs before it's believed.
_PRIOR = 1e-6

Rectangle = tuple[int, int, int, int]


@dataclass(frozen=True)
class ForegroundModel:
    """
    Colour histograms of target and surroundings, and their likelihood ratio.

    Parameters
    ----------
    target, surroundings : ndarray of float32, shape (colours,)
        Normalised histograms.

    """

    target: NDArray[np.float32]
    surroundings: NDArray[np.float32]

    @classmethod
    def create(cls, colour: bool) -> ForegroundModel:
        """Make an empty model for colour or grey frames."""
        empty = np.zeros(_LEVELS**3 if colour else _GREY_LEVELS, np.float32)
        return cls(empty, empty)

    def learned(self, pixels: Frame, inner: Rectangle, rate: float) -> ForegroundModel:
        """
        Return the model after one more example.

        Parameters
        ----------
        pixels : ndarray of uint8, shape (rows, columns, 3) or (rows, columns)
            The colours.
        inner : tuple of int, [px]
            The target's (top, bottom, left, right) in `pixels`.
        rate : float
            The example's weight in the running average.

        """
        index, size = colour_index(pixels), len(self.target)
        top, bottom, left, right = inner
        margin_y = int(_MARGIN * (bottom - top))
        margin_x = int(_MARGIN * (right - left))
        target = np.bincount(index[max(0, top):bottom, max(0, left):right].ravel(), None, size)
        near = index[max(0, top - margin_y):bottom + margin_y,
                     max(0, left - margin_x):right + margin_x]
        surroundings = (np.bincount(index.ravel(), None, size)
                        - np.bincount(near.ravel(), None, size))
        step = np.float32(rate)
        return ForegroundModel(
            self.target + step * (_normalised(target) - self.target),
            self.surroundings + step * (_normalised(surroundings) - self.surroundings))

    def probability(self, pixels: Frame) -> NDArray[np.float32]:
        """Return each pixel's probability of being the target's, shape (rows, columns)."""
        table = self.target / (self.target + self.surroundings + np.float32(_PRIOR))
        return table.take(colour_index(pixels))


def colour_index(pixels: Frame) -> NDArray[np.int32]:
    """Return each pixel's histogram bin."""
    if pixels.ndim == 2:
        return (pixels >> 3).astype(np.int32)
    level = (pixels >> 4).astype(np.int32)
    return (level[:, :, 0] * _LEVELS + level[:, :, 1]) * _LEVELS + level[:, :, 2]


def box_mean(probability: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Return the mean over a box of that size (width, height) about every pixel."""
    mean: NDArray[np.float32] = cv2.blur(probability, size, borderType=cv2.BORDER_CONSTANT)
    return mean


def _normalised(histogram: NDArray[np.int64]) -> NDArray[np.float32]:
    normalised: NDArray[np.float32] = histogram.astype(np.float32)
    normalised /= np.float32(max(1, int(histogram.sum())))
    return normalised
