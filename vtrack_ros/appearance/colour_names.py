"""Soft membership of a colour in the eleven basic colour terms, in few numbers."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.rgb555 import all_colours, rgb555
from vtrack_ros.frame import Frame

_NAMES_BGR = np.array([
    (0, 0, 0), (230, 80, 20), (20, 60, 110), (128, 128, 128), (40, 150, 40), (0, 140, 255),
    (180, 105, 255), (150, 30, 130), (40, 40, 220), (255, 255, 255), (0, 230, 240)], np.uint8)
_SPREAD = 22.0
#: Lightness varies with the light: it counts for less than hue and chroma.
_LIGHTNESS_WEIGHT = 0.5
#: Chroma beyond which colours are rare in natural images.
_USUAL_CHROMA = 30.0
#: Numbers a colour is described by.
CHANNELS = 7


def colour_names(pixels: Frame) -> NDArray[np.float32]:
    """
    Return each pixel's membership in eleven colours, less its mean over all colours, folded.

    Black, blue, brown, grey, green, orange, pink, purple, red, white and yellow (Berlin and Kay),
    by a Gaussian kernel on the distance in CIE Lab; of these eleven dimensions the seven in which
    usual colours, those near grey, have most of their energy. Scalar products hardly change.

    Parameters
    ----------
    pixels : ndarray of uint8, shape (rows, columns, 3)
        The colours.

    Returns
    -------
    ndarray of float32, shape (7, rows, columns)

    """
    return _table().take(rgb555(pixels), axis=0).transpose(2, 0, 1)


@lru_cache(maxsize=1)
def _table() -> NDArray[np.float32]:
    """Return the numbers of all 15-bit colours, shape (32768, CHANNELS)."""
    names = memberships()
    lab = _lab(all_colours()[0])
    frequency = np.exp(-(lab[:, 1:]**2).sum(1) / (2 * _USUAL_CHROMA**2))
    _, axes = np.linalg.eigh((names.T * frequency) @ names)
    table: NDArray[np.float32] = (names @ axes[:, -CHANNELS:]).astype(np.float32)
    return table


def memberships() -> NDArray[np.float64]:
    """Return the memberships of all 15-bit colours, less their mean, shape (32768, 11)."""
    difference = _lab(all_colours()[0])[:, None] - _lab(_NAMES_BGR)[None]
    distance2 = difference**2 @ np.array([_LIGHTNESS_WEIGHT, 1.0, 1.0])
    # the nearest name keeps a membership however far it is
    nearness = np.exp(-(distance2 - distance2.min(1, keepdims=True)) / (2 * _SPREAD**2))
    membership: NDArray[np.float64] = nearness / nearness.sum(1, keepdims=True)
    return membership - membership.mean(0)


def _lab(bgr: NDArray[np.uint8]) -> NDArray[np.float64]:
    converted = cv2.cvtColor(bgr.reshape(1, -1, 3).astype(np.float32) / 255, cv2.COLOR_BGR2LAB)
    lab: NDArray[np.float64] = converted.reshape(-1, 3).astype(np.float64)
    return lab
