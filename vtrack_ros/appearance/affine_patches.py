"""The pixels under many affine frames at once: grey patches and colour histograms."""

import cv2
import numpy as np

from vtrack_ros.appearance.histogram import joint_bins
from vtrack_ros.frame import Array, Array32, Frame

#: Affine frames sampled in one call: blocks that fit the processor's cache are several times as
#: fast.
_BLOCK = 50
#: Of a colour histogram: samples along each side of the rectangle, and levels of each channel.
_HISTOGRAM_GRID, _LEVELS = 12, 6


class AffinePatches:
    """
    Samples of one frame in the images of a rectangle under several affine transformations.

    The `transformations`, shape (N, 3, 3), map the rectangle, centred at the origin and of `size`
    (width, height), into the frame; a patch has `side` samples along each side. Only the region
    that the images cover is prepared, once, and it's downsampled where they have more pixels than
    samples: the cost depends on the number of samples, not on the size of target or frame.
    """

    def __init__(self, frame: Frame, transformations: Array,
                 size: tuple[float, float], side: int = 32) -> None:
        self._transformations = transformations
        self._size, self.side = size, side
        half = np.abs(transformations[:, :2, :2]) @ (np.array(size) / 2)
        center = transformations[:, :2, 2]
        height, width = frame.shape[:2]
        limit = np.array([width, height])
        low = np.clip(np.floor((center - half).min(0)) - 2, 0, limit - 1).astype(int)
        high = np.clip(np.ceil((center + half).max(0)) + 2, low + 1, limit).astype(int)
        step = 2 * float(np.median(np.sqrt(half[:, 0] * half[:, 1]))) / side
        stride = max(1, int(step))
        subset = max(1, stride // 2)
        pixels = frame[low[1]:high[1]:subset, low[0]:high[0]:subset]
        used = np.array(pixels.shape[1::-1])
        if stride > subset and min(pixels.shape[:2]) > 1:
            # subsampled pixels, averaged two by two: a bounded cost without much aliasing
            pixels = cv2.resize(np.ascontiguousarray(pixels),
                                (-(-pixels.shape[1] // 2), -(-pixels.shape[0] // 2)),
                                interpolation=cv2.INTER_AREA)
        self._pixels = np.ascontiguousarray(pixels)
        shown = np.array(self._pixels.shape[1::-1])
        # frame pixels per pixel of the downsampled region, and the region's origin in the frame:
        # a pixel that is used stands for its surroundings, of which it's the middle
        self._per_pixel = subset * used / shown
        self._origin = low - (subset - 1) / 2

    def grey(self) -> Array32:
        """
        Return the grey patches in [0, 1], shape (N, side * side).

        Outside the frame its border is replicated.
        """
        image = self._pixels
        if image.ndim == 3:
            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        points = _grid(self._size, self.side)
        count = len(self._transformations)
        patches = np.empty((count, points.shape[1]), np.float32)
        rows = self._rows().astype(np.float32)
        for first in range(0, count, _BLOCK):
            part = rows[first:first + _BLOCK]
            sampled = cv2.remap(image, part[:, 0] @ points, part[:, 1] @ points,
                                cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            np.multiply(sampled, np.float32(1 / 255), out=patches[first:first + _BLOCK])
        return patches

    def colours(self) -> Array:
        """
        Return the HSV histograms of a colour frame, shape (N, 216) [Xiang, sec. 3.3.1].

        Each sums to the share of its samples that are inside the frame.
        """
        hsv = cv2.cvtColor(self._pixels, cv2.COLOR_BGR2HSV_FULL)
        index = joint_bins(cv2.split(hsv), _LEVELS)
        points = _grid(self._size, _HISTOGRAM_GRID)
        rows = self._rows().astype(np.float32)
        # half a pixel more, so that truncation rounds to the pixel that a point is in
        x, y = rows[:, 0] @ points + np.float32(0.5), rows[:, 1] @ points + np.float32(0.5)
        height, width = index.shape
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        np.clip(x, 0, width - 1, out=x)
        np.clip(y, 0, height - 1, out=y)
        colours, count = _LEVELS**3, len(x)
        sampled = index.ravel().take(y.astype(np.intp) * width + x.astype(np.intp))
        sampled[~inside] = colours
        sampled += np.arange(count)[:, None] * (colours + 1)
        counted = np.bincount(sampled.ravel(), minlength=count * (colours + 1))
        result: Array = counted.reshape(count, -1)[:, :colours] / points.shape[1]
        return result

    def _rows(self) -> Array:
        """Return the maps from the rectangle to the region's pixels, shape (N, 2, 3)."""
        rows: Array = self._transformations[:, :2] / self._per_pixel[:, None]
        # OpenCV counts from the centre of a pixel, boxes from its outer corner
        rows[:, :, 2] -= self._origin / self._per_pixel + 0.5
        return rows


def _grid(size: tuple[float, float], side: int) -> Array32:
    """Return homogeneous points on a rectangle about the origin, shape (3, side * side)."""
    offsets = (np.arange(side) + 0.5) / side - 0.5
    return np.stack([np.tile(offsets * size[0], side), np.repeat(offsets * size[1], side),
                     np.ones(side * side)]).astype(np.float32)
