"""Histograms of oriented gradients over a grid of cells."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame

_SIGNED = 18
_UNSIGNED = 9
#: Channels of `oriented_gradients`.
CHANNELS = _SIGNED
#: No channel grows beyond this share of its block's energy [Dalal and Triggs 2005, sec. 6.4].
_TRUNCATION = 0.2
#: Gradient, in grey levels, below which a cell counts as noise and isn't amplified.
_NOISE = 8.0


def oriented_gradients(
        grey: Frame, cell: int = 4, out: NDArray[np.float32] | None = None,
        ) -> NDArray[np.float32]:
    """
    Return contrast-normalised histograms of gradient orientation.

    The 18 signed and 9 unsigned orientations a cell of Felzenszwalb et al. (2010), with one block
    of 3 x 3 cells for the normalisation in place of their four of 2 x 2, folded into 18 channels
    that have the same scalar products: with s and t in opposite directions, those of (s, t, s + t)
    are those of `(sqrt(3/2) (s + t), sqrt(1/2) (s - t))`.

    Parameters
    ----------
    grey : ndarray of uint8, shape (rows * cell, columns * cell)
        The image.
    cell : int, [px]
        Side of a cell.
    out : ndarray of float32, shape (18, rows, columns), optional
        Where the result is put.

    Returns
    -------
    ndarray of float32, shape (18, rows, columns)
        Nine sums, then nine differences, of the directions from 0 to 160 degrees and those
        opposite to them; magnitudes below 1.

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
    result: NDArray[np.float32] = np.empty_like(signed) if out is None else out
    np.add(forth, back, out=result[:_UNSIGNED])
    result[:_UNSIGNED] *= np.float32(np.sqrt(3))
    np.subtract(forth, back, out=result[_UNSIGNED:])
    return result


@lru_cache(maxsize=32)
def _cells(rows: int, columns: int, cell: int) -> NDArray[np.intp]:
    """Return each pixel's cell, shape (rows * cell, columns * cell)."""
    of_row = (np.arange(rows * cell) // cell)[:, None] * columns
    return of_row + (np.arange(columns * cell) // cell)[None, :]
