"""Colour histograms of many boxes at once, at a cost that doesn't grow with their size."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame

Boxes = NDArray[np.float64]


class ColourHistogram:
    """
    Histograms over a joint colour space, compared by the Bhattacharyya coefficient.

    Every box is sampled on the same grid of points, whatever its size. Points outside the image
    count as a colour that no target has, so that a box which leaves the image loses likeness in
    proportion. A grey frame gets an intensity histogram.

    Parameters
    ----------
    bins : int
        Levels a channel: the paper's 6 x 6 x 6 [Zhu2012, sec. 5] by default; a grey frame has
        `bins` squared levels.
    space : str
        ``'rgb'`` or ``'hsv'``.
    kernel : str
        ``'flat'``, or ``'epanechnikov'`` for the profile 1 - r^2 on the inscribed ellipse
        [Qi2012, eq. 5].
    grid : int
        Sample points along each side of a box.

    """

    def __init__(self, bins: int = 6, space: str = 'rgb', kernel: str = 'flat',
                 grid: int = 12) -> None:
        self.bins, self.space, self.grid = bins, space, grid
        offsets = (np.arange(grid) + 0.5) / grid - 0.5
        self._offsets = offsets
        radius2 = 4 * (offsets[:, None]**2 + offsets[None, :]**2)
        weights = np.ones((grid, grid)) if kernel == 'flat' else np.maximum(0.0, 1 - radius2)
        self._weights = (weights / weights.sum()).ravel()
        self._flat = kernel == 'flat'

    def reference(self, frame: Frame, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the histogram of one box (cx, cy, width, height): shape (bins,), sum <= 1."""
        histogram: NDArray[np.float64] = self._histograms(frame, box[None])[0]
        return histogram / max(histogram.sum(), 1e-12)

    def coefficients(self, frame: Frame, boxes: Boxes,
                     reference: NDArray[np.float64]) -> NDArray[np.float64]:
        """
        Return each box's Bhattacharyya coefficient with a reference.

        Parameters
        ----------
        frame : ndarray of uint8, shape (H, W, 3) or (H, W)
        boxes : ndarray, shape (N, 4), [px]
            (centre x, centre y, width, height).
        reference : ndarray, shape (bins,)
            A normalised histogram.

        Returns
        -------
        ndarray, shape (N,)
            In [0, 1].

        """
        histograms = self._histograms(frame, boxes)
        result: NDArray[np.float64] = np.sqrt(histograms) @ np.sqrt(reference)
        return result

    def _histograms(self, frame: Frame, boxes: Boxes) -> NDArray[np.float64]:
        """Return the histograms, shape (N, bins), of sum <= 1: what's outside is missing."""
        height, width = frame.shape[:2]
        xs = boxes[:, :1] + boxes[:, 2:3] * self._offsets
        ys = boxes[:, 1:2] + boxes[:, 3:4] * self._offsets
        left, right = int(max(0, xs.min())), int(min(width - 1, xs.max()))
        top, bottom = int(max(0, ys.min())), int(min(height - 1, ys.max()))
        levels = self.bins**3 if frame.ndim == 3 else self.bins**2
        if right < left or bottom < top:
            return np.zeros((len(boxes), levels))
        stride = max(1, int(np.sqrt(boxes[:, 2].mean() * boxes[:, 3].mean()) / (2 * self.grid)))
        index = self._bin_image(frame[top:bottom + 1:stride, left:right + 1:stride], levels)
        columns = np.floor((xs - left) / stride).astype(np.intp)
        rows = np.floor((ys - top) / stride).astype(np.intp)
        inside_x = (columns >= 0) & (columns < index.shape[1])
        inside_y = (rows >= 0) & (rows < index.shape[0])
        np.clip(columns, 0, index.shape[1] - 1, out=columns)
        np.clip(rows, 0, index.shape[0] - 1, out=rows)
        flat = (rows * index.shape[1])[:, :, None] + columns[:, None, :]
        sampled = index.ravel().take(flat)
        if not (inside_x.all() and inside_y.all()):
            sampled[~(inside_y[:, :, None] & inside_x[:, None, :])] = levels
        count, points = len(boxes), self.grid**2
        sampled = sampled.reshape(count, points) + np.arange(count)[:, None] * (levels + 1)
        if self._flat:
            counted = np.bincount(sampled.ravel(), minlength=count * (levels + 1)) / points
        else:
            counted = np.bincount(sampled.ravel(), np.tile(self._weights, count),
                                  minlength=count * (levels + 1))
        return counted.reshape(count, levels + 1)[:, :levels]

    def _bin_image(self, pixels: Frame, levels: int) -> NDArray[np.intp]:
        if pixels.ndim == 2:
            return (pixels.astype(np.intp) * levels) >> 8
        bins = self.bins
        pixels = np.ascontiguousarray(pixels)
        if self.space == 'hsv':
            pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2HSV_FULL)
        table = (np.arange(256) * bins) >> 8
        return (table[pixels[:, :, 0]] * bins + table[pixels[:, :, 1]]) * bins + table[
            pixels[:, :, 2]]
