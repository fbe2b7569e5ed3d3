"""Colour model: histograms of target and surroundings, and the foreground probability."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.features import all_colours, rgb555
from vtrack_ros.frame import Array32, Frame

#: Levels that each colour channel is quantised to.
_LEVELS = 16
#: Width of the margin about the target's box that is left out of both histograms, as a share of
#: the box's size: the target's outline is uncertain.
_MARGIN = 0.2
#: Added to the denominator of the foreground probability, so that colours seen (almost) nowhere
#: get a probability near 0.
_EPSILON = 1e-6

Rectangle = tuple[int, int, int, int]
Colours = NDArray[np.intp]


@dataclass(frozen=True)
class ColourModel:
    """Normalised colour histograms of target and surroundings; the foreground probability."""

    target: Array32
    surroundings: Array32

    @classmethod
    def create(cls) -> ColourModel:
        """Make an empty model."""
        empty = np.zeros(_LEVELS**3, np.float32)
        return cls(empty, empty)

    def updated(self, colours: Colours, inner: Rectangle, rate: float) -> ColourModel:
        """
        Return the model after one more example, with weight `rate` in the moving average.

        `colours` are a window's bins, of `colour_index`; `inner` is the target's (top, bottom,
        left, right) in it.
        """
        size = len(self.target)
        top, bottom, left, right = inner
        margin_y = int(_MARGIN * (bottom - top))
        margin_x = int(_MARGIN * (right - left))
        target = _within(colours, inner)
        near = _within(colours, (top - margin_y, bottom + margin_y,
                                 left - margin_x, right + margin_x))
        surroundings = np.bincount(colours.ravel(), None, size)
        surroundings -= np.bincount(near.ravel(), None, size)
        return ColourModel(
            _averaged(self.target, np.bincount(target.ravel(), None, size), target.size, rate),
            _averaged(self.surroundings, surroundings, colours.size - near.size, rate))

    def probability(self, colours: Colours) -> Array32:
        """Return each pixel's foreground probability by its colour; same shape."""
        return self._probabilities.take(colours)

    def mean_probability(self, colours: Colours, inner: Rectangle) -> float:
        """Return the mean of `probability` over the rectangle's part in the window, or 0."""
        part = _within(colours, inner)
        return float(self.probability(part).sum()) / max(1, part.size)

    @cached_property
    def _probabilities(self) -> Array32:
        table = self.target + self.surroundings
        table += np.float32(_EPSILON)
        np.divide(self.target, table, out=table)
        return table


def colour_index(pixels: Frame) -> Colours:
    """Return each pixel's bin, shape (rows, columns); a grey frame uses the first 32."""
    if pixels.ndim == 2:
        return (pixels >> 3).astype(np.intp)
    return _bins().take(rgb555(pixels))


@lru_cache(maxsize=1)
def _bins() -> Colours:
    """Return the histogram bin of each 15-bit colour, shape (32768,)."""
    levels = all_colours()[0].astype(np.intp) * _LEVELS // 256
    bins: Colours = levels @ np.array([1, _LEVELS, _LEVELS**2])
    return bins


def box_mean(probability: Array32, size: tuple[int, int]) -> Array32:
    """Return the mean over a box of `size` (width, height) about every pixel; outside it's 0."""
    mean: Array32 = cv2.blur(probability, size, borderType=cv2.BORDER_CONSTANT)
    return mean


def _within(colours: Colours, rectangle: Rectangle) -> Colours:
    """Return the part of `colours` that is inside (top, bottom, left, right)."""
    top, bottom, left, right = (max(0, edge) for edge in rectangle)
    return colours[top:bottom, left:right]


def _averaged(mean: Array32, counts: NDArray[np.intp], total: int, rate: float) -> Array32:
    """Return the moving average after one more histogram, the `counts` of `total` pixels."""
    averaged: Array32 = counts.astype(np.float32)
    averaged *= np.float32(rate / max(1, total))
    averaged += np.float32(1 - rate) * mean
    return averaged
