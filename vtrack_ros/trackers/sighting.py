"""A belief about a target, and what a frame says about the target's place."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.correlation import Spectrum, subcell_offset
from vtrack_ros.appearance.target import Point, TargetModel, View
from vtrack_ros.frame import Frame

#: A place with less than this share of a window's highest evidence is a lesser maximum.
_LEVEL = 0.95


@dataclass(frozen=True)
class Hypothesis:
    """
    One belief about the target; a snapshot of it is the object itself.

    Parameters
    ----------
    model : TargetModel
        The model.
    center, size : tuple of float, [px]
        The centre and the size.
    evidence_mean, likeness_mean : float
        What's usual for this target.

    """

    model: TargetModel
    center: Point
    size: Point
    evidence_mean: float
    likeness_mean: float


@dataclass(frozen=True)
class Sighting:
    """
    What a window of a frame says about the target's place.

    Parameters
    ----------
    view : View
        The window that was looked at.
    spectrum : ndarray of complex64
        Of the example.
    evidence : ndarray of float32, shape (rows, columns)
        The view's centre is at [rows // 2, columns // 2].
    cell : tuple of float, [px]
        A cell's size.
    highest : tuple of int
        The (column, row) of the highest evidence.

    """

    view: View
    spectrum: Spectrum
    evidence: NDArray[np.float32]
    cell: Point
    highest: tuple[int, int]

    @property
    def peak(self) -> float:
        """Return the highest evidence."""
        column, row = self.highest
        return self.evidence.item(row, column)

    @cached_property
    def center(self) -> Point:
        """Return where the highest evidence is, in pixels, to a part of a cell."""
        return self._maximum(self.highest)

    def cells(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points, shape (N, 2) in pixels, in cells of the evidence map."""
        center, cell, middle = self.view.center, self.cell, self._middle
        cells = points / cell
        cells += middle[0] - center[0] / cell[0], middle[1] - center[1] / cell[1]
        return cells

    def shift(self, place: Point) -> Point:
        """Return how far a place, in pixels, is from the view's centre, in cells."""
        return ((place[0] - self.view.center[0]) / self.cell[0],
                (place[1] - self.view.center[1]) / self.cell[1])

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the evidence at points, shape (N, 2) in pixels; 0 beyond the window."""
        cells = self.cells(points).astype(np.float32)
        values = cv2.remap(
            self.evidence, cells[:, None], None, cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        result: NDArray[np.float64] = values[:, 0].astype(np.float64)
        return result

    def height(self, place: Point) -> float:
        """Return the evidence at one place, in pixels; 0 beyond the window."""
        # one point is told sooner by hand
        (x, y), (middle_x, middle_y) = self.shift(place), self._middle
        left, top = math.floor(x), math.floor(y)
        x, y = x - left, y - top
        row, column = top + middle_y, left + middle_x
        rows, columns = self.evidence.shape
        return sum(
            (y if down else 1 - y) * (x if right else 1 - x)
            * self.evidence.item(row + down, column + right)
            for down in (0, 1) for right in (0, 1)
            if 0 <= row + down < rows and 0 <= column + right < columns)

    def unless_dominated(self, place: Point) -> Point:
        """Return a place, in pixels, or the highest evidence's where that's clearly higher."""
        if place == self.center or self.height(place) >= _LEVEL * self.peak:
            return place
        return self.center

    def climb(self, start: Point) -> Point:
        """Return the local maximum of the evidence that is uphill from a place, in pixels."""
        column, row = (
            min(max(round(cells) + middle, 0), 2 * middle - 1)
            for cells, middle in zip(self.shift(start), self._middle))
        while abs(column - self.highest[0]) > 2 or abs(row - self.highest[1]) > 2:
            top, left = max(0, row - 2), max(0, column - 2)
            near = self.evidence[top:row + 3, left:column + 3]
            up, across = divmod(int(near.argmax()), near.shape[1])
            if (top + up, left + across) == (row, column):
                return self._maximum((column, row))
            row, column = top + up, left + across
        return self.center

    def _maximum(self, cell: tuple[int, int]) -> Point:
        """Return the place, in pixels, of a maximum in a cell (column, row)."""
        column, row = cell
        x, y = subcell_offset(self.evidence, row, column)
        middle_x, middle_y = self._middle
        return (self.view.center[0] + (column + x - middle_x) * self.cell[0],
                self.view.center[1] + (row + y - middle_y) * self.cell[1])

    @property
    def _middle(self) -> tuple[int, int]:
        """Return the (column, row) of the view's centre; a window's sides are even."""
        rows, columns = self.evidence.shape
        return columns // 2, rows // 2


def look_for(hypothesis: Hypothesis, frame: Frame, center: Point) -> Sighting:
    """Look for the target about a place, in pixels, as a belief knows it."""
    model = hypothesis.model
    view = model.view(frame, center, hypothesis.size)
    spectrum = model.transform(view)
    evidence = model.evidence(view, spectrum)
    row, column = divmod(int(evidence.argmax()), evidence.shape[1])
    return Sighting(view, spectrum, evidence, model.layout.cell(view.size), (column, row))
