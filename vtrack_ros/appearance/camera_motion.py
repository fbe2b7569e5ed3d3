"""How the camera turned between two frames, from what the whole frame shows."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame, Point

#: Columns of the sparse grid of pixels that is compared, at most twice as many.
_COLUMNS = 64
#: A grid with fewer rows or columns shows nothing.
_SMALLEST = 8
#: Share of the correlation's energy in its peak below which nothing is known.
_RELIABLE = 0.45


class CameraMotion:
    """
    Measures the shift of the background by phase correlation [Kuglin and Hines 1975].

    Of every so manieth pixel, so that it costs the same in any frame.
    """

    def __init__(self, frame: Frame) -> None:
        self._latest, self._stride = self._sampled(frame)
        rows, columns = self._latest.shape
        self._taper = np.outer(np.hanning(rows), np.hanning(columns)).astype(np.float32)

    def update(self, frame: Frame) -> Point | None:
        """Return by how much the picture moved since the last frame, in pixels, or None."""
        before = self._latest
        self._latest, _ = self._sampled(frame)
        if min(before.shape) < _SMALLEST:
            return None
        (x, y), reliability = cv2.phaseCorrelate(before, self._latest, self._taper)
        if reliability < _RELIABLE:
            return None
        return x * self._stride, y * self._stride

    @staticmethod
    def _sampled(frame: Frame) -> tuple[NDArray[np.float32], int]:
        stride = max(1, frame.shape[1] // _COLUMNS)
        pixels = frame[::stride, ::stride]
        green = pixels[:, :, 1] if pixels.ndim == 3 else pixels
        return np.ascontiguousarray(green, np.float32), stride
