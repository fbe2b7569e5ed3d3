"""
Features of a window's samples: oriented gradients and colour names.

Every function's cost depends on the number of samples alone.
"""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Array, Array32, Frame

#: A window's features: float32, shape (channels, rows, columns).
Features = Array32

#: Bins of the gradient's direction, over a full turn, and of its orientation, over half a turn.
_SIGNED = 18
_UNSIGNED = 9
#: Channels of `oriented_gradients`.
GRADIENT_CHANNELS = _SIGNED
#: Upper clip of a bin, as a share of its block's norm [Dalal and Triggs 2005, sec. 6.4].
_TRUNCATION = 0.2
#: Gradient, in grey levels, below which a cell counts as noise and isn't amplified.
_NOISE = 8.0

#: Number of 15-bit colours, the length of lookup tables.
COLOURS = 1 << 15
#: Channels of `colour_names`.
COLOUR_CHANNELS = 7
#: Prototypes of the eleven colour names, in the order of `colour_names`.
_NAMES_BGR = np.array([
    (0, 0, 0), (230, 80, 20), (20, 60, 110), (128, 128, 128), (40, 150, 40), (0, 140, 255),
    (180, 105, 255), (150, 30, 130), (40, 40, 220), (255, 255, 255), (0, 230, 240)], np.uint8)
#: Standard deviation of the Gaussian kernel about a prototype, in CIE Lab.
_SPREAD = 22.0
#: Weight of lightness in the squared distance, where a and b have 1: it varies with the light.
_LIGHTNESS_WEIGHT = 0.5
#: Standard deviation of a and b in the colours of natural images: those far beyond are rare.
_USUAL_CHROMA = 30.0


def describe(grey: Frame, cells: Frame, cell: int) -> Features:
    """
    Return the features of a window: oriented gradients, lightness and, in colour, colour names.

    `grey` is the window, whose cells are `cell` pixels wide; `cells`, in colour or grey, has one
    pixel for each cell.
    """
    colour = cells.ndim == 3
    channels = GRADIENT_CHANNELS + 1 + colour * COLOUR_CHANNELS
    features = np.empty((channels, *cells.shape[:2]), np.float32)
    oriented_gradients(grey, cell, features[:GRADIENT_CHANNELS])
    lightness = cv2.cvtColor(cells, cv2.COLOR_BGR2GRAY) if colour else cells
    np.multiply(lightness, 1 / 255, out=features[GRADIENT_CHANNELS])
    features[GRADIENT_CHANNELS] -= 0.5
    if colour:
        features[GRADIENT_CHANNELS + 1:] = colour_names(cells)
    return features


def oriented_gradients(grey: Frame, cell: int = 4, out: Features | None = None) -> Features:
    """
    Return contrast-normalised histograms of gradient orientation, shape (18, rows, columns).

    They are the 18 signed and 9 unsigned orientations per cell of Felzenszwalb et al. (2010), but
    normalised by one block of 3 x 3 cells in place of their four of 2 x 2, and reduced to 18
    channels with the same scalar products: for the bins s and t of opposite directions, those of
    (s, t, s + t) equal those of `(sqrt(3/2) (s + t), sqrt(1/2) (s - t))`. The channels are nine
    such sums, then nine differences, for the directions from 0 to 160 degrees, with magnitudes
    below 1. `cell` is a cell's side in pixels.
    """
    rows, columns = grey.shape[0] // cell, grey.shape[1] // cell
    level = grey.astype(np.float32)
    along = np.zeros((2, *grey.shape), np.float32)
    np.subtract(level[:, 2:], level[:, :-2], out=along[0, :, 1:-1])
    np.subtract(level[2:], level[:-2], out=along[1, 1:-1])
    # rounded to the nearest bin; angles that round up to a full turn are in a bin of their own
    bins = cv2.convertScaleAbs(cv2.phase(along[0], along[1]), alpha=_SIGNED / (2 * np.pi))
    index = np.multiply(bins, rows * columns, dtype=np.intp)
    index += _cells(rows, columns, cell)
    # cv2.magnitude of OpenCV 4.6 rounds depending on the arrays' addresses: no two runs agree
    along *= along
    magnitude = np.add(along[0], along[1], out=along[0])
    np.sqrt(magnitude, out=magnitude)
    counted = np.bincount(index.ravel(), magnitude.ravel(), rows * columns * (_SIGNED + 1))
    histogram = counted.reshape(_SIGNED + 1, rows, columns)
    signed = histogram[:_SIGNED].astype(np.float32)
    signed[0] += histogram[_SIGNED]
    forth, back = signed[:_UNSIGNED], signed[_UNSIGNED:]
    unsigned = forth + back
    unsigned *= unsigned
    block = cv2.blur(np.add.reduce(unsigned), (3, 3), borderType=cv2.BORDER_REPLICATE)
    block += np.float32((cell * _NOISE / 2)**2)
    np.sqrt(block, out=block)
    block *= np.float32(np.sqrt(2))
    signed *= np.reciprocal(block, out=block)
    np.minimum(signed, np.float32(np.sqrt(2) * _TRUNCATION), out=signed)
    result: Features = np.empty_like(signed) if out is None else out
    np.add(forth, back, out=result[:_UNSIGNED])
    result[:_UNSIGNED] *= np.float32(np.sqrt(3))
    np.subtract(forth, back, out=result[_UNSIGNED:])
    return result


@lru_cache(maxsize=32)
def _cells(rows: int, columns: int, cell: int) -> NDArray[np.intp]:
    """Return each pixel's cell, shape (rows * cell, columns * cell)."""
    of_row = (np.arange(rows * cell) // cell)[:, None] * columns
    return of_row + (np.arange(columns * cell) // cell)[None, :]


def colour_names(pixels: Frame) -> Features:
    """
    Return each pixel's membership in eleven colour names, reduced to seven dimensions.

    The names are black, blue, brown, grey, green, orange, pink, purple, red, white and yellow
    (Berlin and Kay). The memberships, by a Gaussian kernel on the distance in CIE Lab and less
    their mean over all colours, are projected on the seven principal axes in which usual colours,
    those near grey, have most of their energy. From (rows, columns, 3) to (7, rows, columns).
    """
    return _table().take(rgb555(pixels), axis=0).transpose(2, 0, 1)


@lru_cache(maxsize=1)
def _table() -> Array32:
    """Return the channels of all 15-bit colours, shape (COLOURS, COLOUR_CHANNELS)."""
    names = memberships()
    lab = _lab(all_colours()[0])
    frequency = np.exp(-(lab[:, 1:]**2).sum(1) / (2 * _USUAL_CHROMA**2))
    _, axes = np.linalg.eigh((names.T * frequency) @ names)
    return (names @ axes[:, -COLOUR_CHANNELS:]).astype(np.float32)


def memberships() -> Array:
    """Return the memberships of all 15-bit colours, less their mean, shape (32768, 11)."""
    difference = _lab(all_colours()[0])[:, None] - _lab(_NAMES_BGR)[None]
    distance2 = difference**2 @ np.array([_LIGHTNESS_WEIGHT, 1.0, 1.0])
    # relative to the nearest name, so that no colour, however far from all, divides 0 by 0
    nearness = np.exp(-(distance2 - distance2.min(1, keepdims=True)) / (2 * _SPREAD**2))
    membership: Array = nearness / nearness.sum(1, keepdims=True)
    return membership - membership.mean(0)


def _lab(bgr: NDArray[np.uint8]) -> Array:
    converted = cv2.cvtColor(bgr.reshape(1, -1, 3).astype(np.float32) / 255, cv2.COLOR_BGR2LAB)
    lab: Array = converted.reshape(-1, 3).astype(np.float64)
    return lab


def rgb555(pixels: Frame) -> NDArray[np.uint16]:
    """Return each pixel's red, green and blue with five bits each, red in the highest."""
    packed = cv2.cvtColor(pixels, cv2.COLOR_BGR2BGR555).view(np.uint16)
    result: NDArray[np.uint16] = packed[:, :, 0]
    return result


def all_colours() -> Frame:
    """Return the centre, in BGR, of each 15-bit colour in order, shape (1, COLOURS, 3)."""
    number = np.arange(COLOURS)
    levels = np.stack([number & 31, number >> 5 & 31, number >> 10], axis=-1)
    return (levels * 8 + 4).astype(np.uint8)[np.newaxis]
