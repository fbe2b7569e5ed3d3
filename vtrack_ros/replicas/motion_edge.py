"""Histograms of the direction of moving edges."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.histogram import Boxes, sampled_histograms
from vtrack_ros.frame import Array, Frame

#: Number of bins of the gradient's direction.
_DIRECTIONS = 16
#: Sample points along each side of a box, and the weight of each.
_GRID = 12
_WEIGHTS = np.full(_GRID**2, 1 / _GRID**2)
#: Learning rate of the reference histogram.
_RATE = 0.1
#: Gradient of the difference, |gx| + |gy|, above which a pixel is an edge [Qi2012, eq. 12].
_EDGE = 5
#: Share of edges in a box below which the target counts as standing still.
_MOVING = 0.05
#: Side of the resized image in which the camera's motion is measured, in pixels.
_SHIFT_SIDE = 64


class MotionEdge:
    """
    The motion-edge cue [Qi2012, eqs 9-14].

    The difference of two frames is differentiated, and the directions of its edges are counted
    over each box, with one more bin for points without an edge. The frames are first aligned by
    the global shift between them, so that a moving camera doesn't make everything move.

    The reference histogram is updated in each frame in which the target moves.
    """

    def __init__(self) -> None:
        self._previous: Frame | None = None
        self._codes: NDArray[np.intp] | None = None
        self._reference: Array | None = None
        self._origin = (0, 0)

    def advance(self, frame: Frame, region: tuple[int, int, int, int]) -> None:
        """Take the next frame, of which a region (left, top, right, bottom) is searched."""
        # always a copy: the caller may write the next frame into the same array
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) if frame.ndim == 3 else frame.copy()
        self._codes = None
        if self._previous is not None:
            self._codes = self._edges(self._previous, grey, region)
            self._origin = region[:2]
        self._previous = grey

    def likelihoods(self, boxes: Boxes, sigma: float) -> Array:
        """
        Return exp(-D^2 / (2 sigma^2)) for each box (centre x, centre y, width, height).

        All NaN, an abstention, while the target stands still or was never seen moving.
        """
        if self._codes is None or self._reference is None:
            return np.full(len(boxes), np.nan)
        histograms = self.histograms(boxes)
        if histograms[:, :_DIRECTIONS].sum(axis=1).max() < _MOVING:
            return np.full(len(boxes), np.nan)
        distance2 = 1 - np.sqrt(histograms) @ np.sqrt(self._reference)
        return np.exp(-distance2 / (2 * sigma**2))

    def update(self, box: Array) -> None:
        """Update the reference from a box (cx, cy, width, height), if the target moves."""
        if self._codes is None:
            return
        histogram = self.histograms(box[None])[0]
        if histogram[:_DIRECTIONS].sum() < _MOVING:
            return
        histogram /= histogram.sum()
        if self._reference is None:
            self._reference = histogram
        self._reference = self._reference + _RATE * (histogram - self._reference)

    def histograms(self, boxes: Boxes) -> Array:
        """Return the histograms of moving edges in boxes, shape (N, bins)."""
        assert self._codes is not None
        moved = boxes - np.array([*self._origin, 0, 0])
        return sampled_histograms(self._codes, _DIRECTIONS + 1, moved, _GRID, _WEIGHTS)

    def _edges(self, previous: Frame, grey: Frame,
               region: tuple[int, int, int, int]) -> NDArray[np.intp]:
        """Return each pixel's direction code, 0 to 15, or 16 where there is no edge."""
        left, top, right, bottom = region
        shift_x, shift_y = _global_shift(previous, grey)
        matrix = np.array([[1.0, 0.0, left - shift_x], [0.0, 1.0, top - shift_y]])
        aligned = cv2.warpAffine(
            previous, matrix, (right - left, bottom - top),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE)
        difference = cv2.absdiff(np.ascontiguousarray(grey[top:bottom, left:right]), aligned)
        along_x = cv2.Sobel(difference, cv2.CV_32F, 1, 0, ksize=3, scale=0.25)
        along_y = cv2.Sobel(difference, cv2.CV_32F, 0, 1, ksize=3, scale=0.25)
        angle = cv2.phase(along_x, along_y)
        codes: NDArray[np.intp] = (angle * (_DIRECTIONS / (2 * np.pi))).astype(np.intp)
        codes %= _DIRECTIONS
        codes[np.abs(along_x) + np.abs(along_y) <= _EDGE] = _DIRECTIONS
        return codes


def _global_shift(previous: Frame, grey: Frame) -> tuple[float, float]:
    """Return the global shift (x, y), in pixels, by phase correlation; 0 if its peak is low."""
    small = [cv2.resize(image, (_SHIFT_SIDE, _SHIFT_SIDE), interpolation=cv2.INTER_AREA
                        ).astype(np.float32) for image in (previous, grey)]
    window = cv2.createHanningWindow((_SHIFT_SIDE, _SHIFT_SIDE), cv2.CV_32F)
    (x, y), response = cv2.phaseCorrelate(small[0], small[1], window)
    if response < 0.2:
        return 0.0, 0.0
    return x * grey.shape[1] / _SHIFT_SIDE, y * grey.shape[0] / _SHIFT_SIDE
