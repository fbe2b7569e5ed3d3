"""The window about a target, sampled and described, and the response over it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.colour_model import colour_index, Colours, Rectangle
from vtrack_ros.appearance.features import describe
from vtrack_ros.appearance.regression import CorrelationFilter, Spectrum
from vtrack_ros.appearance.sampling import PixelWindow, turned
from vtrack_ros.frame import Array, Frame, Point
from vtrack_ros.geometry.affine import rotation

#: Side of a cell, in samples.
_CELL = 3
#: Side of a cell in pixels of the colour model.
_DETAIL = 2
#: Cells of the window, all together: of a coarse one, and of a fine one.
COARSE, FINE = 22 * 22, 28 * 28
#: Width of the surroundings in the window, as a share of the target's mean side.
_CONTEXT = 1.5
#: A place with less than this share of a window's highest response is a lesser maximum.
_LEVEL = 0.95
#: Cells about the highest response that belong to its peak; the least variance of the others.
_PEAK, _LEAST_VARIANCE = 3, 1e-9


@dataclass(frozen=True)
class Grid:
    """
    Where a window's cells are: its centre in the frame and a cell's (width, height), [px].

    The angle, [rad], is by how much it's turned, clockwise as one looks at the image.
    """

    center: Point
    cell: Point
    angle: float

    def shift(self, place: Point) -> Point:
        """Return how far a place, in pixels, is from the window's centre, in cells."""
        x, y = turned((place[0] - self.center[0], place[1] - self.center[1]), -self.angle)
        return x / self.cell[0], y / self.cell[1]

    def at(self, shift: Point) -> Point:
        """Return the place, in pixels, that is so many cells from the window's centre."""
        x, y = turned((shift[0] * self.cell[0], shift[1] * self.cell[1]), self.angle)
        return self.center[0] + x, self.center[1] + y


@dataclass(frozen=True)
class SearchWindow(Grid):
    """
    A window of a frame, resampled and described.

    The size of a target that fills its middle is in pixels. `grey` is the image, of 3 x 3 samples
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
    How the window about a target is divided into cells: even numbers of rows and columns.

    `reach` is the window's (width, height) in units of the target's.
    """

    rows: int
    columns: int
    reach: Point

    #: Samples, and pixels of the colour model, along a side of a cell.
    SAMPLES, DETAIL = _CELL, _DETAIL

    @classmethod
    def around(cls, width: float, height: float, cells: int = COARSE) -> WindowLayout:
        """Lay out the window of about so many cells for a target of that size, in pixels."""
        context = _CONTEXT * (width + height) / 2
        window_x, window_y = width + context, height + context
        density = np.sqrt(cells / (window_x * window_y))
        rows, columns = (max(8, 2 * round(density * side / 2)) for side in (window_y, window_x))
        return cls(rows, columns, (window_x / width, window_y / height))

    @property
    def target(self) -> Point:
        """Return the target's (width, height) in cells."""
        return self.columns / self.reach[0], self.rows / self.reach[1]

    def window(self, frame: Frame, center: Point, size: Point,
               angle: float = 0.0) -> SearchWindow:
        """
        Describe the window about a target of that centre and size, to the nearest pixel.

        A target that has turned by an angle, [rad], is seen upright in it.
        """
        whole = PixelWindow.about(
            center, (size[0] * self.reach[0], size[1] * self.reach[1]), angle)
        pixels = whole.sampled(frame, self.rows * _CELL, self.columns * _CELL)
        grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels
        small = cv2.resize(pixels, (self.columns * _DETAIL, self.rows * _DETAIL))
        cells = cv2.resize(small, (self.columns, self.rows), interpolation=cv2.INTER_AREA)
        spectrum = CorrelationFilter.transform(describe(grey, cells, _CELL))
        size = whole.width / self.reach[0], whole.height / self.reach[1]
        cell = whole.width / self.columns, whole.height / self.rows
        return SearchWindow(
            whole.center, cell, angle, self, size, grey, colour_index(small), spectrum)


@dataclass(frozen=True)
class ResponseMap:
    """The response to the target's centre in each cell of a window."""

    window: Grid
    values: NDArray[np.float32]

    @cached_property
    def highest(self) -> tuple[int, int]:
        """Return the (column, row) of the highest response."""
        row, column = divmod(int(self.values.argmax()), self.values.shape[1])
        return column, row

    @cached_property
    def peak(self) -> float:
        """Return the highest response."""
        column, row = self.highest
        return self.values.item(row, column)

    @cached_property
    def sharpness(self) -> float:
        """
        Return the peak-to-sidelobe ratio [Bolme2010].

        By how many standard deviations the highest response is above the mean of those more than
        three cells from it; 0 where there are none.
        """
        column, row = self.highest
        values = self.values
        near = values[max(0, row - _PEAK):row + _PEAK + 1,
                      max(0, column - _PEAK):column + _PEAK + 1]
        count = values.size - near.size
        if not count:
            return 0.0
        mean = (float(values.sum()) - float(near.sum())) / count
        squares = float(np.einsum('ij,ij', values, values) - np.einsum('ij,ij', near, near))
        return (self.peak - mean) / math.sqrt(max(squares / count - mean**2, _LEAST_VARIANCE))

    @cached_property
    def center(self) -> Point:
        """Return where the highest response is, in pixels, to a part of a cell."""
        return self.maximum(self.highest)

    def cells(self, points: Array) -> Array:
        """Return points, shape (N, 2) in pixels, in cells of the map."""
        window = self.window
        cells = points - window.center
        if window.angle:
            cells = cells @ rotation(np.asarray(window.angle))
        cells /= window.cell
        cells += self._middle
        return cells

    def place(self, cells: Array) -> Point:
        """Return the place, in pixels, of a point in cells of the map, shape (2,)."""
        x, y = (cells - self._middle).tolist()
        return self.window.at((x, y))

    def sample(self, points: Array) -> Array:
        """Return the response at points, shape (N, 2) in pixels; 0 beyond the window."""
        # OpenCV's remap rounds places to a 32nd of a cell, or doesn't, as its version may be
        padded = cv2.copyMakeBorder(self.values, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=0)
        cells = self.cells(points)
        first = np.floor(cells)
        across, down = (cells - first).T
        columns, rows = (first.clip(-2, self.values.shape[::-1]).astype(np.intp) + 2).T
        values, width = padded.ravel(), padded.shape[1]
        index = rows * width + columns
        above, below = (
            (1 - across) * values[index + line] + across * values[index + line + 1]
            for line in (0, width))
        result: Array = (1 - down) * above + down * below
        return result

    def sample_one(self, place: Point) -> float:
        """Return the response at one place, in pixels; 0 beyond the window."""
        # one point is told sooner by hand
        (x, y), (middle_x, middle_y) = self.window.shift(place), self._middle
        left, top = math.floor(x), math.floor(y)
        x, y = x - left, y - top
        row, column = top + middle_y, left + middle_x
        rows, columns = self.values.shape
        return sum(
            (y if down else 1 - y) * (x if right else 1 - x)
            * self.values.item(row + down, column + right)
            for down in (0, 1) for right in (0, 1)
            if 0 <= row + down < rows and 0 <= column + right < columns)

    def unless_dominated(self, place: Point, better: Point) -> Point:
        """Return a place, in pixels, or a better one where the response is clearly higher."""
        if self.sample_one(place) >= _LEVEL * self.sample_one(better):
            return place
        return better

    def local_maximum(self, start: Point) -> Point:
        """Return the local maximum of the response that is uphill from a place, in pixels."""
        column, row = (
            min(max(round(cells) + middle, 0), 2 * middle - 1)
            for cells, middle in zip(self.window.shift(start), self._middle))
        while abs(column - self.highest[0]) > 2 or abs(row - self.highest[1]) > 2:
            top, left = max(0, row - 2), max(0, column - 2)
            near = self.values[top:row + 3, left:column + 3]
            up, across = divmod(int(near.argmax()), near.shape[1])
            if (top + up, left + across) == (row, column):
                return self.maximum((column, row))
            row, column = top + up, left + across
        return self.center

    def maximum(self, cell: tuple[int, int]) -> Point:
        """Return the place, in pixels, of a maximum in a cell (column, row)."""
        column, row = cell
        x, y = subcell_offset(self.values, row, column)
        middle_x, middle_y = self._middle
        return self.window.at((column + x - middle_x, row + y - middle_y))

    @property
    def _middle(self) -> tuple[int, int]:
        """Return the (column, row) of the window's centre; a window's sides are even."""
        rows, columns = self.values.shape
        return columns // 2, rows // 2


def subcell_offset(response: NDArray[np.float32], row: int, column: int) -> tuple[float, float]:
    """Return how far (x, y) a maximum is from its cell, from -0.5 to 0.5; 0 at the border."""
    x, y, at = 0.0, 0.0, response.item
    peak = at(row, column)
    if 0 < column < response.shape[1] - 1:
        x = parabola_offset(at(row, column - 1), peak, at(row, column + 1))
    if 0 < row < response.shape[0] - 1:
        y = parabola_offset(at(row - 1, column), peak, at(row + 1, column))
    return x, y


def parabola_offset(before: float, peak: float, after: float) -> float:
    """Return where, from -0.5 to 0.5, the parabola through three equidistant values peaks."""
    curvature = before - 2 * peak + after
    return 0.5 * (before - after) / curvature if curvature < 0 else 0.0


def inside(place: Point, frame: Frame) -> Point:
    """Return the place inside the frame that is next to a place, in pixels."""
    height, width = frame.shape[:2]
    return (float(min(max(place[0], 0.0), width - 1.0)),
            float(min(max(place[1], 0.0), height - 1.0)))
