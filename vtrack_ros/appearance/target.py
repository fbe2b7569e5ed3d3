"""A target's learned appearance: where it is, how large, and which colours are its own."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance import colour_names, gradients
from vtrack_ros.appearance.correlation import CorrelationFilter, Spectrum
from vtrack_ros.appearance.foreground import (
    box_mean, colour_index, Colours, ForegroundModel, Rectangle)
from vtrack_ros.appearance.scale import ScaleRegression
from vtrack_ros.appearance.window import sample_window
from vtrack_ros.frame import Frame

#: Side of a cell, in samples.
_CELL = 3
#: Side of a cell in pixels of the foreground model.
_DETAIL = 2
#: Cells of the window, all together.
_CELLS = 22 * 22
#: Width of the surroundings in the window, as a share of the target's mean side.
_CONTEXT = 1.5
#: Standard deviation of the wanted response, as a share of the target's size.
_LABEL_WIDTH = 1 / 16
#: Weight of the colour evidence in the sum; the rest is the correlation filter's.
_COLOUR_WEIGHT = 0.3
#: A target that is off the middle by more than this many cells is worth a look of its own.
_CENTRED = 1.0

#: Weights of an example in the running averages.
_RATE = 0.02
_COLOUR_RATE = 0.08
_SCALE_RATE = 0.05

Point = tuple[float, float]


@dataclass(frozen=True)
class Layout:
    """
    How the window about a target is divided into cells.

    Parameters
    ----------
    rows, columns : int
        Of the window, in cells.
    reach : tuple of float
        The window's (width, height) in units of the target's.

    """

    rows: int
    columns: int
    reach: Point

    @classmethod
    def around(cls, width: float, height: float) -> Layout:
        """Lay out the window for a target of that size, in pixels."""
        context = _CONTEXT * (width + height) / 2
        window_x, window_y = width + context, height + context
        density = np.sqrt(_CELLS / (window_x * window_y))
        rows, columns = (_even_length(density * side) for side in (window_y, window_x))
        return cls(rows, columns, (window_x / width, window_y / height))

    @property
    def target(self) -> Point:
        """Return the target's (width, height) in cells."""
        return self.columns / self.reach[0], self.rows / self.reach[1]

    def cell(self, size: Point) -> Point:
        """Return a cell's (width, height) in pixels for a target of that size in pixels."""
        return size[0] * self.reach[0] / self.columns, size[1] * self.reach[1] / self.rows


@dataclass(frozen=True)
class View:
    """
    A window of a frame, resampled and described.

    Parameters
    ----------
    center, size : tuple of float, [px]
        The window's centre in the frame, and the size of a target that fills its middle.
    grey : ndarray of uint8, shape (3 * rows, 3 * columns)
        The image.
    colours : ndarray of int, shape (2 * rows, 2 * columns)
        Each pixel's bin in the foreground model.
    features : ndarray of float32, shape (channels, rows, columns)

    """

    center: Point
    size: Point
    grey: Frame
    colours: Colours
    features: NDArray[np.float32]


@dataclass(frozen=True)
class TargetModel:
    """
    A correlation filter, a foreground colour model and a scale regression of one target.

    It's never changed in place: a snapshot of it is the object itself.

    Parameters
    ----------
    layout : Layout
    correlation : CorrelationFilter
    foreground : ForegroundModel
    scale : ScaleRegression

    """

    layout: Layout
    correlation: CorrelationFilter
    foreground: ForegroundModel
    scale: ScaleRegression

    @classmethod
    def create(cls, frame: Frame, center: Point, size: Point) -> TargetModel:
        """Learn the first look of the target of that centre and size, in pixels."""
        layout = Layout.around(*size)
        width = _LABEL_WIDTH * float(np.sqrt(layout.target[0] * layout.target[1]))
        empty = cls(layout, CorrelationFilter.create(layout.rows, layout.columns, width),
                    ForegroundModel.create(frame.ndim == 3),
                    ScaleRegression.create(_CELL * layout.target[0], _CELL * layout.target[1]))
        view = empty.view(frame, center, size)
        return cls(
            layout, empty.correlation.learned(empty.transform(view), 1.0),
            empty.foreground.learned(view.colours, empty._rectangle((0.0, 0.0)), 1.0),
            empty.scale.learned(view.grey, empty._in_samples((0.0, 0.0)), 1.0, 1.0))

    def view(self, frame: Frame, center: Point, size: Point) -> View:
        """Describe the window about a target of that centre and size, to the nearest pixel."""
        layout = self.layout
        width = max(1, round(size[0] * layout.reach[0]))
        height = max(1, round(size[1] * layout.reach[1]))
        center = (round(center[0] - width / 2) + width / 2,
                  round(center[1] - height / 2) + height / 2)
        size = width / layout.reach[0], height / layout.reach[1]
        pixels = sample_window(
            frame, center, (width, height), (layout.rows * _CELL, layout.columns * _CELL))
        colour = pixels.ndim == 3
        grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if colour else pixels
        small = cv2.resize(pixels, (layout.columns * _DETAIL, layout.rows * _DETAIL))
        tiny = cv2.resize(small, (layout.columns, layout.rows), interpolation=cv2.INTER_AREA)
        channels = gradients.CHANNELS + 1 + colour * colour_names.CHANNELS
        features = np.empty((channels, layout.rows, layout.columns), np.float32)
        gradients.oriented_gradients(grey, _CELL, features[:gradients.CHANNELS])
        lightness = cv2.cvtColor(tiny, cv2.COLOR_BGR2GRAY) if colour else tiny
        np.multiply(lightness, 1 / 255, out=features[gradients.CHANNELS])
        features[gradients.CHANNELS] -= 0.5
        if colour:
            features[gradients.CHANNELS + 1:] = colour_names.colour_names(tiny)
        return View(center, size, grey, colour_index(small), features)

    def transform(self, view: View) -> Spectrum:
        """Return the spectrum of a view's features."""
        return self.correlation.transform(view.features)

    def evidence(self, view: View, spectrum: Spectrum) -> NDArray[np.float32]:
        """
        Return how much speaks for the target's centre in each cell of a view.

        Returns
        -------
        ndarray of float32, shape (rows, columns)
            The weighted sum of the correlation response and of the mean foreground probability
            over the target's box; the view's centre is at [rows // 2, columns // 2].

        """
        width, height = self.layout.target
        probability = self.foreground.probability(view.colours)
        colour = box_mean(probability, (
            max(1, round(_DETAIL * width)), max(1, round(_DETAIL * height))))
        response = self.correlation.response(spectrum)
        response *= np.float32(1 - _COLOUR_WEIGHT)
        response += np.float32(_COLOUR_WEIGHT) * colour[::_DETAIL, ::_DETAIL]
        return response

    def growth(self, view: View, shift: Point) -> float:
        """
        Return by which factor the target grew.

        Parameters
        ----------
        view : View
            The window that was looked at.
        shift : tuple of float, [cells]
            The target's place from the view's centre.

        """
        return self.scale.growth(view.grey, self._in_samples(shift))

    def learned(self, spectrum: Spectrum, shift: Point = (0.0, 0.0)) -> TargetModel:
        """
        Return the model after learning what the target looks like from a view.

        Parameters
        ----------
        spectrum : ndarray of complex64
            The view's.
        shift : tuple of float, [cells]
            The target's place from the view's centre.

        """
        return TargetModel(self.layout, self.correlation.learned(spectrum, _RATE, shift),
                           self.foreground, self.scale)

    def learned_colours(self, view: View, shift: Point = (0.0, 0.0)) -> TargetModel:
        """Return the model after learning the target's colours from a view."""
        foreground = self.foreground.learned(view.colours, self._rectangle(shift), _COLOUR_RATE)
        return TargetModel(self.layout, self.correlation, foreground, self.scale)

    def learned_scale(self, view: View, shift: Point, growth: float) -> TargetModel:
        """Return the model after learning the scale, of a target `growth` times the view's."""
        scale = self.scale.learned(view.grey, self._in_samples(shift), growth, _SCALE_RATE)
        return TargetModel(self.layout, self.correlation, self.foreground, scale)

    def is_centred(self, shift: Point) -> bool:
        """Tell whether a target `shift` cells from a view's centre is seen as well as in it."""
        return max(abs(shift[0]), abs(shift[1])) <= _CENTRED

    def mean_probability(self, view: View, shift: Point = (0.0, 0.0)) -> float:
        """Return the mean foreground probability of a target `shift` cells from the centre."""
        return self.foreground.mean_probability(view.colours, self._rectangle(shift))

    def _in_samples(self, shift: Point) -> Point:
        """Return a place in a view's own pixels, from its place from the view's centre."""
        return (_CELL * (self.layout.columns / 2 + shift[0]),
                _CELL * (self.layout.rows / 2 + shift[1]))

    def _rectangle(self, shift: Point) -> Rectangle:
        """Return the target's (top, bottom, left, right) in a view's `colours`."""
        width, height = self.layout.target
        x = _DETAIL * (self.layout.columns / 2 + shift[0])
        y = _DETAIL * (self.layout.rows / 2 + shift[1])
        half_width, half_height = _DETAIL / 2 * width, _DETAIL / 2 * height
        return (round(y - half_height), round(y + half_height),
                round(x - half_width), round(x + half_width))


def _even_length(cells: float) -> int:
    """Return the nearest even number of cells, at least eight."""
    return max(8, 2 * round(cells / 2))
