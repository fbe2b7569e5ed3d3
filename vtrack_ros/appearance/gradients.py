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


def oriented_gradients(grey: Frame, cell: int = 4) -> NDArray[np.float32]:
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

    Returns
    -------
    ndarray of float32, shape (rows, columns, 27)
        In [0, 0.4].

    """
    rows, columns = grey.shape[0] // cell, grey.shape[1] // cell
    along_x = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=1)
    along_y = cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=1)
    angle = cv2.phase(along_x, along_y)
    # OpenCV 4.6 rounds its own magnitude by where the arrays lie in memory: no two runs agree
    magnitude = np.sqrt(along_x**2 + along_y**2)
    angle *= np.float32(_SIGNED / (2 * np.pi))
    angle += np.float32(0.5)
    index = angle.astype(np.int32)
    index += _first_bins(rows, columns, cell)
    counted = np.bincount(index.ravel(), magnitude.ravel(), rows * columns * (_SIGNED + 1))
    histogram = counted.reshape(rows, columns, _SIGNED + 1)
    result = np.empty((rows, columns, CHANNELS), np.float32)
    result[:, :, :_SIGNED] = histogram[:, :, :_SIGNED]
    # angles that round up to a full turn are in a bin of their own
    result[:, :, 0] += histogram[:, :, _SIGNED]
    unsigned = result[:, :, _SIGNED:]
    np.add(result[:, :, :_UNSIGNED], result[:, :, _UNSIGNED:_SIGNED], out=unsigned)
    energy = np.einsum('ijk,ijk->ij', unsigned, unsigned)
    block = cv2.blur(energy, (3, 3), borderType=cv2.BORDER_REPLICATE)
    result *= (1 / np.sqrt(4 * block + np.float32((cell * _NOISE)**2)))[:, :, None]
    np.minimum(result, np.float32(_TRUNCATION), out=result)
    result *= np.float32(2)
    return result


@lru_cache(maxsize=32)
def _first_bins(rows: int, columns: int, cell: int) -> NDArray[np.int32]:
    """Return each pixel's first bin, shape (rows * cell, columns * cell)."""
    of_row = (np.arange(rows * cell) // cell)[:, None] * columns
    of_column = (np.arange(columns * cell) // cell)[None, :]
    return ((of_row + of_column) * (_SIGNED + 1)).astype(np.int32)
