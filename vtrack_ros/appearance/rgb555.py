"""Colours as numbers of 15 bits, to look up what is known of them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame

#: How many there are.
COLOURS = 1 << 15
Colours = NDArray[np.uint16]


def rgb555(pixels: Frame) -> Colours:
    """
    Return each pixel's red, green and blue with five bits each, red in the highest.

    Parameters
    ----------
    pixels : ndarray of uint8, shape (rows, columns, 3)
        In BGR order.

    Returns
    -------
    ndarray of uint16, shape (rows, columns)
        Below `COLOURS`.

    """
    packed: Colours = cv2.cvtColor(pixels, cv2.COLOR_BGR2BGR555).view(np.uint16)[:, :, 0]
    return packed


def all_colours() -> Frame:
    """Return the middle of each of the colours, in order, shape (1, COLOURS, 3), BGR."""
    number = np.arange(COLOURS)
    levels = np.stack([number & 31, number >> 5 & 31, number >> 10], axis=-1)
    return (levels * 8 + 4).astype(np.uint8)[np.newaxis]
