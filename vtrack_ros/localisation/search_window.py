"""The search window about a target: resampling, and computation of features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vtrack_ros.appearance.colour_model import colour_index, Colours, Rectangle
from vtrack_ros.appearance.features import describe, Features
from vtrack_ros.appearance.regression import CorrelationFilter, Spectrum
from vtrack_ros.appearance.sampling import PixelWindow, turned
from vtrack_ros.frame import Frame, Point

#: Step from one window to another: (right, down) in halves of a window; -1, 0 or 1 each.
Step = tuple[int, int]

#: Side of a cell, in samples, and in pixels of the colour model.
SAMPLES, DETAIL = 3, 2
#: Approximate number of cells in a window: in a coarse one, and in a fine one.
COARSE, FINE = 22 * 22, 28 * 28
#: Surroundings in the window, added to both sides of the target, as a share of its mean side.
_CONTEXT = 1.5


@dataclass(frozen=True)
class Grid:
    """
    Where a window's cells are: its centre in the frame and a cell's (width, height), [px].

    The angle, [rad], is its rotation, clockwise as one looks at the image.
    """

    center: Point
    cell: Point
    angle: float

    def shift(self, place: Point) -> Point:
        """Return how far a place, in pixels, is from the window's centre, in cells."""
        x, y = turned((place[0] - self.center[0], place[1] - self.center[1]), -self.angle)
        return x / self.cell[0], y / self.cell[1]

    def at(self, shift: Point) -> Point:
        """Return the place, in pixels, of a shift in cells from the window's centre."""
        x, y = turned((shift[0] * self.cell[0], shift[1] * self.cell[1]), self.angle)
        return self.center[0] + x, self.center[1] + y


@dataclass(frozen=True)
class SearchWindow(Grid):
    """
    A window of a frame, resampled, with its features.

    `size`, in pixels, is that of the target in its middle. `grey` is the image, of 3 x 3 samples
    a cell; `colours` has each pixel's bin in the colour model, of 2 x 2 a cell; the spectrum,
    shape (channels, rows, columns // 2 + 1), is that of the features.
    """

    layout: WindowLayout
    size: Point
    grey: Frame
    colours: Colours
    spectrum: Spectrum

    @property
    def pixels(self) -> PixelWindow:
        """Return which part of the frame it is."""
        width, height = self.cell
        return PixelWindow.about(
            self.center, (width * self.layout.columns, height * self.layout.rows), self.angle)

    def sample_at(self, shift: Point) -> Point:
        """Return the place in `grey` of a shift in cells from the window's centre."""
        return (SAMPLES * (self.layout.columns / 2 + shift[0]),
                SAMPLES * (self.layout.rows / 2 + shift[1]))

    def rectangle(self, shift: Point) -> Rectangle:
        """Return (top, bottom, left, right) in `colours` of a target with a shift in cells."""
        width, height = self.layout.target
        x = DETAIL * (self.layout.columns / 2 + shift[0])
        y = DETAIL * (self.layout.rows / 2 + shift[1])
        half_width, half_height = DETAIL / 2 * width, DETAIL / 2 * height
        return (round(y - half_height), round(y + half_height),
                round(x - half_width), round(x + half_width))


@dataclass(frozen=True)
class WindowLayout:
    """
    How the window about a target is divided into cells: even numbers of rows and columns.

    `reach` is the window's (width, height) in units of the target's.
    """

    rows: int
    columns: int
    reach: Point

    @classmethod
    def around(cls, width: float, height: float, cells: int = COARSE) -> WindowLayout:
        """Make the layout with about that number of cells for a target's size, in pixels."""
        context = _CONTEXT * (width + height) / 2
        window_x, window_y = width + context, height + context
        density = np.sqrt(cells / (window_x * window_y))
        rows, columns = (max(8, 2 * round(density * side / 2)) for side in (window_y, window_x))
        return cls(rows, columns, (window_x / width, window_y / height))

    @property
    def target(self) -> Point:
        """Return the target's (width, height) in cells."""
        return self.columns / self.reach[0], self.rows / self.reach[1]

    def window(self, frame: Frame, center: Point, size: Point, angle: float = 0.0) -> SearchWindow:
        """
        Sample the window about a target of that centre and size, to the nearest pixel.

        It's turned by the angle, [rad]: a target that has turned so is upright in it.
        """
        whole = self._pixels(center, size, angle)
        return self._window(whole.center, (whole.width, whole.height), angle,
                            *_described(frame, whole, self.rows, self.columns))

    def windows_beside(self, frame: Frame, center: Point, size: Point, angle: float,
                       steps: Sequence[Step]) -> list[SearchWindow]:
        """
        Sample the windows some steps from that one, all at once, for they overlap.

        All four quarters of a window have whole pixels, so that each window has them too.
        """
        rows, columns = self.rows, self.columns
        whole = self._pixels(center, (2 * size[0], 2 * size[1]), angle, 4)
        grey, colours, features = _described(frame, whole, 2 * rows, 2 * columns)
        side, windows = (whole.width / 2, whole.height / 2), []
        halves = Grid(whole.center, (side[0] / 2, side[1] / 2), angle)
        for right, down in steps:
            left, top = (1 + right) * columns // 2, (1 + down) * rows // 2
            samples, bins, cells = (
                (..., slice(density * top, density * (top + rows)),
                 slice(density * left, density * (left + columns)))
                for density in (SAMPLES, DETAIL, 1))
            windows.append(self._window(
                halves.at((right, down)), side, angle, grey[samples], colours[bins],
                features[cells]))
        return windows

    def _pixels(self, center: Point, size: Point, angle: float, parts: int = 1) -> PixelWindow:
        """Return the window about a target, whose sides can be divided into that many parts."""
        width, height = (
            parts * max(1, round(side * reach / parts)) for side, reach in zip(size, self.reach))
        return PixelWindow.about(center, (width, height), angle)

    def _window(self, center: Point, side: Point, angle: float, grey: Frame, colours: Colours,
                features: Features) -> SearchWindow:
        cell = side[0] / self.columns, side[1] / self.rows
        size = side[0] / self.reach[0], side[1] / self.reach[1]
        return SearchWindow(
            center, cell, angle, self, size, grey, colours, CorrelationFilter.transform(features))


def _described(frame: Frame, whole: PixelWindow, rows: int,
               columns: int) -> tuple[Frame, Colours, Features]:
    """Return a window's grey image, colour bins and features; rows and columns are cells."""
    pixels = whole.sampled(frame, rows * SAMPLES, columns * SAMPLES)
    grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels
    small = cv2.resize(pixels, (columns * DETAIL, rows * DETAIL))
    cells = cv2.resize(small, (columns, rows), interpolation=cv2.INTER_AREA)
    return grey, colour_index(small), describe(grey, cells, SAMPLES)


def inside(place: Point, frame: Frame) -> Point:
    """Return the place inside the frame that is nearest to a place, in pixels."""
    height, width = frame.shape[:2]
    return float(min(max(place[0], 0.0), width)), float(min(max(place[1], 0.0), height))
