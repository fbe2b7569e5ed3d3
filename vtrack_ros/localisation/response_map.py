"""The response of a target model over a search window."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Array, Point
from vtrack_ros.localisation.search_window import SearchWindow

#: A place with less than this share of a window's highest response is a lesser maximum.
_LEVEL = 0.95


@dataclass(frozen=True)
class ResponseMap:
    """
    The response to the target's centre in each cell of a window.

    Parameters
    ----------
    window : SearchWindow
    values : ndarray of float32, shape (rows, columns)
        The window's centre is at [rows // 2, columns // 2].

    """

    window: SearchWindow
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
    def center(self) -> Point:
        """Return where the highest response is, in pixels, to a part of a cell."""
        return self._maximum(self.highest)

    def cells(self, points: Array) -> Array:
        """Return points, shape (N, 2) in pixels, in cells of the map."""
        center, cell, middle = self.window.center, self.window.cell, self._middle
        cells = points / cell
        cells += middle[0] - center[0] / cell[0], middle[1] - center[1] / cell[1]
        return cells

    def place(self, cells: Array) -> Point:
        """Return the place, in pixels, of a point in cells of the map, shape (2,)."""
        x, y = (cells - self._middle) * self.window.cell + self.window.center
        return float(x), float(y)

    def sample(self, points: Array) -> Array:
        """Return the response at points, shape (N, 2) in pixels; 0 beyond the window."""
        cells = self.cells(points).astype(np.float32)
        values = cv2.remap(
            self.values, cells[:, None], None, cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        result: Array = values[:, 0].astype(np.float64)
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

    def unless_dominated(self, place: Point) -> Point:
        """Return a place, in pixels, or the highest response's where that's clearly higher."""
        if place == self.center or self.sample_one(place) >= _LEVEL * self.peak:
            return place
        return self.center

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
                return self._maximum((column, row))
            row, column = top + up, left + across
        return self.center

    def _maximum(self, cell: tuple[int, int]) -> Point:
        """Return the place, in pixels, of a maximum in a cell (column, row)."""
        column, row = cell
        x, y = subcell_offset(self.values, row, column)
        middle_x, middle_y = self._middle
        window = self.window
        return (window.center[0] + (column + x - middle_x) * window.cell[0],
                window.center[1] + (row + y - middle_y) * window.cell[1])

    @property
    def _middle(self) -> tuple[int, int]:
        """Return the (column, row) of the window's centre; a window's sides are even."""
        rows, columns = self.values.shape
        return columns // 2, rows // 2


def subcell_offset(response: NDArray[np.float32], row: int, column: int) -> tuple[float, float]:
    """Return how far (x, y) a maximum is from its cell, from -0.5 to 0.5; 0 at the border."""
    x = y = 0.0
    value = float(response[row, column])
    if 0 < column < response.shape[1] - 1:
        x = parabola_offset(float(response[row, column - 1]), value,
                            float(response[row, column + 1]))
    if 0 < row < response.shape[0] - 1:
        y = parabola_offset(float(response[row - 1, column]), value,
                            float(response[row + 1, column]))
    return x, y


def parabola_offset(before: float, peak: float, after: float) -> float:
    """Return where, from -0.5 to 0.5, the parabola through three equidistant values peaks."""
    curvature = before - 2 * peak + after
    return 0.5 * (before - after) / curvature if curvature < 0 else 0.0
