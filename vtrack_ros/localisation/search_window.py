"""The window about a target: how it's laid out, sampled and described."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vtrack_ros.appearance.colour_model import colour_index, Colours, Rectangle
from vtrack_ros.appearance.correlation_filter import CorrelationFilter, Spectrum
from vtrack_ros.appearance.features import describe, sample_window
from vtrack_ros.frame import Frame, Point

#: Side of a cell, in samples.
_CELL = 3
#: Side of a cell in pixels of the colour model.
_DETAIL = 2
#: Cells of the window, all together.
_CELLS = 22 * 22
#: Width of the surroundings in the window, as a share of the target's mean side.
_CONTEXT = 1.5


@dataclass(frozen=True)
class SearchWindow:
    """
    A window of a frame, resampled and described.

    Parameters
    ----------
    layout : WindowLayout
    center, size : tuple of float, [px]
        The window's centre in the frame, and the size of a target that fills its middle.
    cell : tuple of float, [px]
        A cell's (width, height).
    grey : ndarray of uint8, shape (3 * rows, 3 * columns)
        The image.
    colours : ndarray of int, shape (2 * rows, 2 * columns)
        Each pixel's bin in the colour model.
    spectrum : ndarray of complex64, shape (channels, rows, columns // 2 + 1)
        Of the features.

    """

    layout: WindowLayout
    center: Point
    size: Point
    cell: Point
    grey: Frame
    colours: Colours
    spectrum: Spectrum

    def shift(self, place: Point) -> Point:
        """Return how far a place, in pixels, is from the window's centre, in cells."""
        return ((place[0] - self.center[0]) / self.cell[0],
                (place[1] - self.center[1]) / self.cell[1])

    def sample_at(self, shift: Point) -> Point:
        """Return a place in `grey`, from its place from the window's centre in cells."""
        return (_CELL * (self.layout.columns / 2 + shift[0]),
                _CELL * (self.layout.rows / 2 + shift[1]))

    def rectangle(self, shift: Point) -> Rectangle:
        """Return (top, bottom, left, right) in `colours` of a target so far off the centre."""
        width, height = self.layout.target
        x = _DETAIL * (self.layout.columns / 2 + shift[0])
        y = _DETAIL * (self.layout.rows / 2 + shift[1])
        half_width, half_height = _DETAIL / 2 * width, _DETAIL / 2 * height
        return (round(y - half_height), round(y + half_height),
                round(x - half_width), round(x + half_width))


@dataclass(frozen=True)
class WindowLayout:
    """
    How the window about a target is divided into cells.

    Parameters
    ----------
    rows, columns : int
        Of the window, in cells; both even.
    reach : tuple of float
        The window's (width, height) in units of the target's.

    """

    rows: int
    columns: int
    reach: Point

    #: Samples, and pixels of the colour model, along a side of a cell.
    SAMPLES, DETAIL = _CELL, _DETAIL

    @classmethod
    def around(cls, width: float, height: float) -> WindowLayout:
        """Lay out the window for a target of that size, in pixels."""
        context = _CONTEXT * (width + height) / 2
        window_x, window_y = width + context, height + context
        density = np.sqrt(_CELLS / (window_x * window_y))
        rows, columns = (max(8, 2 * round(density * side / 2)) for side in (window_y, window_x))
        return cls(rows, columns, (window_x / width, window_y / height))

    @property
    def target(self) -> Point:
        """Return the target's (width, height) in cells."""
        return self.columns / self.reach[0], self.rows / self.reach[1]

    def window(self, frame: Frame, center: Point, size: Point) -> SearchWindow:
        """Describe the window about a target of that centre and size, to the nearest pixel."""
        width = max(1, round(size[0] * self.reach[0]))
        height = max(1, round(size[1] * self.reach[1]))
        center = (round(center[0] - width / 2) + width / 2,
                  round(center[1] - height / 2) + height / 2)
        size = width / self.reach[0], height / self.reach[1]
        pixels = sample_window(
            frame, center, (width, height), (self.rows * _CELL, self.columns * _CELL))
        grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels
        small = cv2.resize(pixels, (self.columns * _DETAIL, self.rows * _DETAIL))
        cells = cv2.resize(small, (self.columns, self.rows), interpolation=cv2.INTER_AREA)
        spectrum = CorrelationFilter.transform(describe(grey, cells, _CELL))
        cell = (size[0] * self.reach[0] / self.columns, size[1] * self.reach[1] / self.rows)
        return SearchWindow(self, center, size, cell, grey, colour_index(small), spectrum)


def inside(place: Point, frame: Frame) -> Point:
    """Return the place inside the frame that is next to a place, in pixels."""
    height, width = frame.shape[:2]
    return (float(min(max(place[0], 0.0), width - 1.0)),
            float(min(max(place[1], 0.0), height - 1.0)))
