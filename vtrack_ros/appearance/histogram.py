"""Colour histograms of many boxes at once, at a cost that doesn't grow with their size."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Array, Frame

#: Boxes, shape (N, 4): (centre x, centre y, width, height) in pixels.
Boxes = Array


class ColourHistogram:
    """
    Histograms over a joint colour space, compared by the Bhattacharyya coefficient.

    Every box is sampled on the same grid of points, whatever its size. Points outside the image
    count as a colour that no target has, so that a box which leaves the image loses similarity in
    proportion. A grey frame gets an intensity histogram.

    Each colour channel is quantised to `bins` levels, by default the paper's 6 [Zhu2012, sec. 5],
    which gives K = bins ** 3 joint bins; a grey frame is quantised to K = bins ** 2. The kernel is
    'flat', or 'epanechnikov' for the profile 1 - r^2 on the inscribed ellipse [Qi2012, eq. 5].
    There are `grid` sample points along each side of a box.
    """

    def __init__(self, bins: int = 6, kernel: str = 'flat', grid: int = 12) -> None:
        self.bins, self.grid = bins, grid
        offsets = _offsets(grid)
        radius2 = 4 * (offsets[:, None]**2 + offsets[None, :]**2)
        weights = np.ones((grid, grid)) if kernel == 'flat' else np.maximum(0.0, 1 - radius2)
        self._weights: Array = (weights / weights.sum()).ravel()

    def reference(self, frame: Frame, box: Array) -> Array:
        """Return the normalised histogram of a box (cx, cy, width, height): shape (K,)."""
        histogram: Array = self.histograms(frame, box[None])[0]
        return histogram / max(float(histogram.sum()), 1e-12)

    def coefficients(self, frame: Frame, boxes: Boxes, reference: Array) -> Array:
        """Return the boxes' Bhattacharyya coefficients with a reference, shape (N,), in [0, 1]."""
        return np.sqrt(self.histograms(frame, boxes)) @ np.sqrt(reference)

    def histograms(self, frame: Frame, boxes: Boxes) -> Array:
        """Return the histograms, shape (N, K), of sum <= 1: points outside don't count."""
        index, left, top, stride = self._bin_image(frame, boxes)
        moved = (boxes - np.array([left, top, 0, 0])) / stride
        return sampled_histograms(index, self._levels(frame), moved, self.grid, self._weights)

    def _levels(self, frame: Frame) -> int:
        return self.bins**3 if frame.ndim == 3 else self.bins**2

    def _bin_image(self, frame: Frame, boxes: Boxes) -> tuple[NDArray[np.intp], int, int, int]:
        """Return the bins in the boxes' region, subsampled, its left and top, and the stride."""
        height, width = frame.shape[:2]
        half = boxes[:, 2:] / 2
        low, high = (boxes[:, :2] - half).min(0), (boxes[:, :2] + half).max(0)
        left, top = (int(max(0, value)) for value in low)
        right, bottom = int(min(width, high[0] + 1)), int(min(height, high[1] + 1))
        stride = max(1, int(np.sqrt(boxes[:, 2].mean() * boxes[:, 3].mean()) / (2 * self.grid)))
        pixels = np.ascontiguousarray(frame[top:max(top, bottom):stride,
                                            left:max(left, right):stride])
        if not pixels.size:
            return np.zeros((0, 0), np.intp), left, top, stride
        levels = self.bins if frame.ndim == 3 else self._levels(frame)
        return joint_bins(cv2.split(pixels), levels), left, top, stride


def joint_bins(channels: Sequence[Frame], levels: int) -> NDArray[np.intp]:
    """Return the joint bin of channels of equal shape, each quantised to `levels` levels."""
    level = (np.arange(256) * levels) >> 8
    bins = level[channels[0]]
    for channel in channels[1:]:
        bins = bins * levels + level[channel]
    return bins


def sampled_histograms(index: NDArray[np.intp], levels: int, boxes: Boxes, grid: int,
                       weights: Array) -> Array:
    """
    Return the histogram of each box over an image of bin numbers, shape (N, levels).

    Boxes are in pixels of `index`, and sampled at `grid` times `grid` points with the given
    weights; points outside the image don't count.
    """
    count = len(boxes)
    if not index.size:
        return np.zeros((count, levels))
    sampled = _sample(index, levels, boxes, grid) + np.arange(count)[:, None] * (levels + 1)
    size = count * (levels + 1)
    if weights[0] == weights[-1] == weights[len(weights) // 2]:
        counted = np.bincount(sampled.ravel(), None, size) * weights[0]
    else:
        counted = np.bincount(sampled.ravel(), np.tile(weights, count), size)
    histograms: Array = counted.reshape(count, levels + 1)[:, :levels]
    return histograms


def _sample(index: NDArray[np.intp], levels: int, boxes: Boxes, grid: int) -> NDArray[np.intp]:
    """Return the bins at each box's points, shape (N, grid * grid); `levels` where outside."""
    offsets = _offsets(grid)
    columns = np.floor(boxes[:, :1] + boxes[:, 2:3] * offsets).astype(np.intp)
    rows = np.floor(boxes[:, 1:2] + boxes[:, 3:4] * offsets).astype(np.intp)
    inside_x = (columns >= 0) & (columns < index.shape[1])
    inside_y = (rows >= 0) & (rows < index.shape[0])
    np.clip(columns, 0, index.shape[1] - 1, out=columns)
    np.clip(rows, 0, index.shape[0] - 1, out=rows)
    places = (rows * index.shape[1])[:, :, None] + columns[:, None, :]
    sampled: NDArray[np.intp] = index.ravel().take(places)
    if not (inside_x.all() and inside_y.all()):
        sampled[~(inside_y[:, :, None] & inside_x[:, None, :])] = levels
    return sampled.reshape(len(boxes), grid * grid)


def _offsets(grid: int) -> Array:
    """Return the offsets of a box's sample points along a side from its centre, in sides."""
    return (np.arange(grid) + 0.5) / grid - 0.5
