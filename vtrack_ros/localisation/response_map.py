"""The response to a target over a window, its maxima, and what a search finds among them."""

from dataclasses import dataclass
from functools import cached_property
import math
from typing import TypeAlias

import cv2
import numpy as np

from vtrack_ros.frame import Array, Array32, Point
from vtrack_ros.geometry.affine import rotation
from vtrack_ros.localisation.search_window import Grid

#: Share of a better place's response below which a place is dominated by it.
_LEVEL = 0.95
#: Cells on each side of the highest response that belong to its peak; lower bound of the variance
#: of the others.
_PEAK, _LEAST_VARIANCE = 3, 1e-9
#: Largest number of distinct maxima: a flat response has thousands.
_MOST = 50
#: A cell and its eight neighbours.
_NEIGHBOURS = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class ResponseMap:
    """The response to the target's centre in each cell of a window."""

    window: Grid
    values: Array32

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
        # for a single point plain Python is faster than NumPy
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

    def maxima(self, share: float) -> list[tuple[Point, float]]:
        """Return the local maxima, in pixels, and their values, down to a share of the highest."""
        values = self.values
        highest = cv2.dilate(values, _NEIGHBOURS)
        least = share_of(self.peak, share)
        rows, columns = np.nonzero((values >= highest) & (values >= least))
        return [(self.maximum((column, row)), values.item(row, column))
                for row, column in zip(rows.tolist(), columns.tolist())]

    @property
    def _middle(self) -> tuple[int, int]:
        """Return the (column, row) of the window's centre; a window's sides are even."""
        rows, columns = self.values.shape
        return columns // 2, rows // 2


#: A maximum of a response: its place, in pixels, the response, and its value there.
Maximum: TypeAlias = tuple[Point, ResponseMap, float]


@dataclass(frozen=True)
class Found:
    """
    The result of a search: the response in the best window, and the target's place, in pixels.

    The `distractors` are the places, in pixels, of those so near that only motion tells which one
    is the target; `hidden` tells that one of them hides the target, so that the place is only the
    expected one. The `rival` is the highest maximum that was not chosen, in pixels. `motion` is
    what the target's motion to its place adds to the log-odds of its presence.
    """

    response: ResponseMap
    place: Point
    distractors: tuple[Point, ...] = ()
    hidden: bool = False
    rival: Point | None = None
    motion: float = 0.0


def strong(every: list[Maximum], share: float) -> list[Maximum]:
    """Return the maxima, sorted from the highest, with at least that share of the highest."""
    least = share_of(every[0][2], share)
    return [each for each in every if each[2] >= least]


def distinct(every: list[Maximum], apart: float) -> list[Maximum]:
    """Return the maxima, sorted from the highest, further than `apart` from all higher ones."""
    found: list[Maximum] = []
    for each in every:
        # a generator in `all` takes twice as long
        for higher in found:
            if math.dist(each[0], higher[0]) <= apart:
                break
        else:
            found.append(each)
            if len(found) == _MOST:
                break
    return found


def share_of(highest: float, share: float) -> float:
    """Return that share of the highest value; the value itself where it's below 0."""
    return min(share * highest, highest)


def subcell_offset(response: Array32, row: int, column: int) -> tuple[float, float]:
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
