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
CHANNELS = _SIGNED + _UNSIGNED
#: No channel grows beyond this share of its block's energy [Dalal and Triggs 2005, sec. 6.4].
_TRUNCATION = 0.2
#: Gradient, in grey levels, below which a cell counts as noise and isn't amplified.
_NOISE = 8.0


def oriented_gradients(
        grey: Frame, cell: int = 4, out: NDArray[np.float32] | None = None,
        ) -> NDArray[np.float32]:
    """
    Return contrast-normalised histograms of gradient orientation.

    18 signed and 9 unsigned orientations a cell, as in Felzenszwalb et al. (2010), with one block
    of 3 x 3 cells for the normalisation in place of their four of 2 x 2.

    Parameters
    ----------
    grey : ndarray of uint8, shape (rows * cell, columns * cell)
        The image.
    cell : int, [px]
        Side of a cell.
    out : ndarray of float32, shape (27, rows, columns), optional
        Where the result is put.

    Returns
    -------
    ndarray of float32, shape (27, rows, columns)
        In [0, 0.4].

    """
    rows, columns = grey.shape[0] // cell, grey.shape[1] // cell
    along_x = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=1)
    along_y = cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=1)
    # rounded to the nearest bin; angles that round up to a full turn are in a bin of their own
    bins = cv2.convertScaleAbs(cv2.phase(along_x, along_y), alpha=_SIGNED / (2 * np.pi))
    index = np.multiply(bins, rows * columns, dtype=np.intp)
    index += _cells(rows, columns, cell)
    # OpenCV 4.6 rounds its own magnitude by where the arrays lie in memory: no two runs agree
    along_x *= along_x
    along_y *= along_y
    along_x += along_y
    magnitude = np.sqrt(along_x, out=along_x)
    counted = np.bincount(index.ravel(), magnitude.ravel(), rows * columns * (_SIGNED + 1))
    histogram = counted.reshape(_SIGNED + 1, rows, columns)
    result: NDArray[np.float32] = (
        np.empty((CHANNELS, rows, columns), np.float32) if out is None else out)
    result[:_SIGNED] = histogram[:_SIGNED]
    result[0] += histogram[_SIGNED]
    unsigned = result[_SIGNED:]
    np.add(result[:_UNSIGNED], result[_UNSIGNED:_SIGNED], out=unsigned)
    energy = np.add.reduce(unsigned * unsigned)
    block = cv2.blur(energy, (3, 3), borderType=cv2.BORDER_REPLICATE)
    block += np.float32((cell * _NOISE / 2)**2)
    np.sqrt(block, out=block)
    result *= np.reciprocal(block, out=block)
    np.minimum(result, np.float32(2 * _TRUNCATION), out=result)
    return result


@lru_cache(maxsize=32)
def _cells(rows: int, columns: int, cell: int) -> NDArray[np.intp]:
    """Return each pixel's cell, shape (rows * cell, columns * cell)."""
    of_row = (np.arange(rows * cell) // cell)[:, None] * columns
    return of_row + (np.arange(columns * cell) // cell)[None, :]
