"""
Sampling a frame: windows of whole pixels, upright or turned, and grids of places.

The cost depends on the number of samples, and neither on the window's size nor on the frame's.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Array32, Frame, Point

#: Largest area, [px^2], at which a window that reaches beyond the frame is copied with the border
#: replicated; a larger one is remapped.
_MOST_COPIED = 1 << 18
#: Number of steps per pixel that places are quantised to: at these, every version of OpenCV
#: samples exactly alike.
_FINE = 32
#: Side, [px], from which a window to be remapped is subsampled: OpenCV remaps up to 32,766 pixels.
_LONGEST_SIDE = 20_000


@dataclass(frozen=True)
class PixelWindow:
    """
    A part of a frame, in whole pixels, which may reach beyond its border.

    It may be turned about its centre, by an angle [rad], clockwise as one looks at the image.
    Every version of OpenCV samples it in the same way.
    """

    left: int
    top: int
    width: int
    height: int
    angle: float = 0.0

    @classmethod
    def about(cls, center: Point, size: Point, angle: float = 0.0) -> PixelWindow:
        """Return the window nearest to that centre and size, in pixels."""
        width, height = (max(1, round(length)) for length in size)
        left, top = round(center[0] - width / 2), round(center[1] - height / 2)
        return cls(left, top, width, height, angle)

    @property
    def center(self) -> Point:
        """Return the centre, in pixels."""
        return self.left + self.width / 2, self.top + self.height / 2

    def sampled(self, frame: Frame, rows: int, columns: int) -> Frame:
        """
        Return the window resampled to rows and columns; the frame's border is replicated.

        Where there are several pixels to a sample, only a regular subset of them is used.
        """
        if self.angle:
            return self._mapped(frame, rows, columns)
        part, margins = frame, []
        for axis, start, length in ((0, self.top, self.height), (1, self.left, self.width)):
            first = min(max(start, 0), frame.shape[axis] - 1)
            last = min(max(start + length, first + 1), frame.shape[axis])
            part = part[first:last] if axis == 0 else part[:, first:last]
            before = min(max(first - start, 0), length - 1)
            margins += [before, length - before - (last - first)]
        if any(margins):
            if self.width * self.height > _MOST_COPIED:
                return self._mapped(frame, rows, columns)
            above, below, before, after = margins
            part = cv2.copyMakeBorder(part, above, below, before, after, cv2.BORDER_REPLICATE)
        window: Frame = cv2.resize(part, (columns, rows), interpolation=cv2.INTER_LINEAR)
        return window

    def _mapped(self, frame: Frame, rows: int, columns: int) -> Frame:
        """Sample a window that may be turned: bilinearly, at places rounded to 1/32 pixel."""
        stride = 1 + max(self.width, self.height) // _LONGEST_SIDE
        if stride > 1:
            center = self.center[0] / stride, self.center[1] / stride
            size = self.width / stride, self.height / stride
            return self.about(center, size, self.angle)._mapped(
                frame[::stride, ::stride], rows, columns)
        along = self.width * ((np.arange(columns) + 0.5) / columns - 0.5)
        down = self.height * ((np.arange(rows)[:, None] + 0.5) / rows - 0.5)
        x, y = self.center[0] + along, self.center[1] + down
        if self.angle:
            cosine, sine = math.cos(self.angle), math.sin(self.angle)
            x = self.center[0] + cosine * along - sine * down
            y = self.center[1] + sine * along + cosine * down
        part, cells, fractions = frame, np.empty((rows, columns, 2), np.int16), []
        for axis, place in ((1, x), (0, y)):
            length = frame.shape[axis]
            # OpenCV counts from the middle of the first pixel; beyond the border it's constant
            fine = np.rint(_FINE * (place - 0.5).clip(-1, length)).astype(np.int32)
            pixel = fine // _FINE
            # cropped to the part with all these places: OpenCV can't remap longer frames
            first = min(max(int(pixel.min()), 0), length - 1)
            last = max(int(pixel.max()), first)
            part = part[first:last + 2] if axis == 0 else part[:, first:last + 2]
            cells[..., 1 - axis] = pixel - first
            fractions.append(fine - _FINE * pixel)
        window: Frame = cv2.remap(
            part, cells, (_FINE * fractions[1] + fractions[0]).astype(np.uint16),
            cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return window


def turned(offset: Point, angle: float) -> Point:
    """Return an offset turned by an angle, [rad], clockwise as one looks at the image."""
    if not angle:
        return offset
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * offset[0] - sine * offset[1], sine * offset[0] + cosine * offset[1]


def sample_grids(image: Frame, x: Array32, y: Array32) -> Frame:
    """
    Return an image's values on grids of columns and rows; its border is replicated.

    The columns `x`, shape (N, columns), and rows `y`, shape (N, rows), of N grids count from the
    middle of the first pixel; the result's shape is (N, rows, columns). Bilinear, rounded to whole
    values. OpenCV's `remap` rounds places to 1/32 pixel or not, depending on its version.
    """
    (above, below, down), (before, after, across) = (
        _neighbours(at, length) for at, length in zip((y, x), image.shape))
    values = image.astype(np.float32)
    rows = values[above]
    rows += down[..., None] * (values[below] - rows)
    lines, grids = rows.transpose(0, 2, 1), np.arange(len(x))[:, None]
    result = lines[grids, before]
    result += across[..., None] * (lines[grids, after] - result)
    return np.rint(result).astype(np.uint8).transpose(0, 2, 1)


def _neighbours(at: Array32, length: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Array32]:
    """Return the pixels before and after places along a side, and the second's weight."""
    first = np.floor(at)
    # bounded as floats: NumPy's clip takes three times as long for whole numbers
    before, after = (place.clip(0, length - 1).astype(np.intp) for place in (first, first + 1))
    return before, after, at - first


def sparse_part(frame: Frame, stride: int, most: int,
                rng: np.random.Generator) -> tuple[Frame, tuple[int, int]]:
    """
    Return every `stride`-th pixel of a frame, and the place of the first one, (x, y) in pixels.

    If these are more than `most`, only those of a randomly placed part of the frame.
    """
    rows, columns = (-(-length // stride) for length in frame.shape[:2])
    if rows * columns <= most:
        return np.ascontiguousarray(frame[::stride, ::stride]), (0, 0)
    wide = min(columns, most // min(rows, math.isqrt(most)))
    high = min(rows, most // wide)
    # centred at any place, then shifted inside: else it would hardly ever contain a corner
    top, left = (stride * min(max(int(rng.integers(there)) - taken // 2, 0), there - taken)
                 for there, taken in ((rows, high), (columns, wide)))
    part = frame[top:top + stride * high:stride, left:left + stride * wide:stride]
    return np.ascontiguousarray(part), (left, top)


def shrunk(frame: Frame, longest: int) -> Frame:
    """Return a frame downsampled until no side is longer than that, [px]; each is at least 1."""
    shrink = longest / max(frame.shape[:2])
    if shrink >= 1:
        return frame
    size = [max(1, round(shrink * length)) for length in frame.shape[1::-1]]
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8)
