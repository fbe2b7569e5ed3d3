"""
What is computed of a window's samples: oriented gradients and colour names.

Every function's cost depends on the number of samples alone.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Array, Frame

#: A window's features: float32, shape (channels, rows, columns).
Features = NDArray[np.float32]

_SIGNED = 18
_UNSIGNED = 9
#: Channels of `oriented_gradients`.
GRADIENT_CHANNELS = _SIGNED
#: No channel grows beyond this share of its block's energy [Dalal and Triggs 2005, sec. 6.4].
_TRUNCATION = 0.2
#: Gradient, in grey levels, below which a cell counts as noise and isn't amplified.
_NOISE = 8.0

#: Colours of 15 bits, to look up what is known of them.
COLOURS = 1 << 15
#: Channels of `colour_names`.
COLOUR_CHANNELS = 7
_NAMES_BGR = np.array([
    (0, 0, 0), (230, 80, 20), (20, 60, 110), (128, 128, 128), (40, 150, 40), (0, 140, 255),
    (180, 105, 255), (150, 30, 130), (40, 40, 220), (255, 255, 255), (0, 230, 240)], np.uint8)
_SPREAD = 22.0
#: Lightness varies with the light: it counts for less than hue and chroma.
_LIGHTNESS_WEIGHT = 0.5
#: Chroma beyond which colours are rare in natural images.
_USUAL_CHROMA = 30.0


def describe(grey: Frame, cells: Frame, cell: int) -> Features:
    """
    Return the features of a window: oriented gradients, lightness and, of colour, colour names.

    `grey` is the window, its cells so many pixels wide; `cells` has one pixel for each cell.
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


def oriented_gradients(
        grey: Frame, cell: int = 4, out: Features | None = None) -> Features:
    """
    Return contrast-normalised histograms of gradient orientation, shape (18, rows, columns).

    The 18 signed and 9 unsigned orientations a cell of Felzenszwalb et al. (2010), with one block
    of 3 x 3 cells for the normalisation in place of their four of 2 x 2, folded into 18 channels
    that have the same scalar products: with s and t in opposite directions, those of (s, t, s + t)
    are those of `(sqrt(3/2) (s + t), sqrt(1/2) (s - t))`. Of a cell's side in pixels; nine sums,
    then nine differences, of the directions from 0 to 160 degrees and those opposite to them, with
    magnitudes below 1.
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
    # OpenCV 4.6 rounds its own magnitude by where the arrays lie in memory: no two runs agree
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
    Return each pixel's membership in eleven colours, less its mean over all colours, folded.

    Black, blue, brown, grey, green, orange, pink, purple, red, white and yellow (Berlin and Kay),
    by a Gaussian kernel on the distance in CIE Lab; of these eleven dimensions the seven in which
    usual colours, those near grey, have most of their energy. From (rows, columns, 3) to (7, rows,
    columns).
    """
    return _table().take(rgb555(pixels), axis=0).transpose(2, 0, 1)


@lru_cache(maxsize=1)
def _table() -> NDArray[np.float32]:
    """Return the numbers of all 15-bit colours, shape (32768, CHANNELS)."""
    names = memberships()
    lab = _lab(all_colours()[0])
    frequency = np.exp(-(lab[:, 1:]**2).sum(1) / (2 * _USUAL_CHROMA**2))
    _, axes = np.linalg.eigh((names.T * frequency) @ names)
    return (names @ axes[:, -COLOUR_CHANNELS:]).astype(np.float32)


def memberships() -> Array:
    """Return the memberships of all 15-bit colours, less their mean, shape (32768, 11)."""
    difference = _lab(all_colours()[0])[:, None] - _lab(_NAMES_BGR)[None]
    distance2 = difference**2 @ np.array([_LIGHTNESS_WEIGHT, 1.0, 1.0])
    # the nearest name keeps a membership however far it is
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
    """Return the middle of each of the colours, in order, shape (1, COLOURS, 3), BGR."""
    number = np.arange(COLOURS)
    levels = np.stack([number & 31, number >> 5 & 31, number >> 10], axis=-1)
    return (levels * 8 + 4).astype(np.uint8)[np.newaxis]
