"""A picture that is painted in units of its own, at any resolution."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.scenes.texture import Colour, Picture

# Fixed-point bits of OpenCV's drawing coordinates.
_SHIFT = 6


class Canvas:
    """
    A picture with its own coordinates, in which shapes and textures are painted smoothly.

    Parameters
    ----------
    left, top, right, bottom : float
        What it shows, in its units.
    unit : float, [px]
        How many pixels a length of 1 has.
    colour : tuple of float
        What it's filled with.

    """

    def __init__(self, left: float, top: float, right: float, bottom: float, unit: float,
                 colour: Colour = (128, 128, 128)) -> None:
        self.left, self.top, self.right, self.bottom = left, top, right, bottom
        self.unit = unit
        self.width = max(2, int(np.ceil((right - left) * unit)))
        self.height = max(2, int(np.ceil((bottom - top) * unit)))
        self.picture: Picture = np.empty((self.height, self.width, 3), np.float32)
        self.picture[:] = colour

    def fill(self, texture: Picture) -> None:
        """Cover everything with a texture of the canvas's size in pixels."""
        self.picture[:] = texture

    def gain(self, gain: NDArray[np.float32]) -> None:
        """Brighten or darken by factors, shape (height, width)."""
        self.picture = np.asarray(np.clip(self.picture * gain[..., None], 0, 255), np.float32)

    def rows(self) -> NDArray[np.float32]:
        """Return the y of every pixel row, shape (height, 1)."""
        return np.float32(self.top) + (np.arange(self.height, dtype=np.float32)[:, None] + 0.5) \
            / np.float32(self.unit)

    def columns(self) -> NDArray[np.float32]:
        """Return the x of every pixel column, shape (1, width)."""
        return np.float32(self.left) + (np.arange(self.width, dtype=np.float32)[None] + 0.5) \
            / np.float32(self.unit)

    def polygon(self, points: Sequence[tuple[float, float]], paint: Colour | Picture,
                opacity: float = 1.0) -> None:
        """Paint a polygon with a colour, or with a texture of the canvas's size in pixels."""
        part, mask, fixed = self._part(points, 0)
        cv2.fillPoly(mask, [fixed], 255, cv2.LINE_AA, _SHIFT)
        self._paint(part, mask, paint, opacity)

    def rectangle(self, left: float, top: float, right: float, bottom: float,
                  paint: Colour | Picture, opacity: float = 1.0) -> None:
        """Paint a rectangle."""
        self.polygon([(left, top), (right, top), (right, bottom), (left, bottom)], paint, opacity)

    def ellipse(self, x: float, y: float, width: float, height: float, paint: Colour | Picture,
                opacity: float = 1.0, angle: float = 0.0) -> None:
        """Paint an ellipse of a centre, a width and a height, turned by degrees."""
        turn = np.radians(angle)
        round_ = np.linspace(0, 2 * np.pi, 64, endpoint=False)
        dx, dy = width / 2 * np.cos(round_), height / 2 * np.sin(round_)
        xs = x + np.cos(turn) * dx - np.sin(turn) * dy
        ys = y + np.sin(turn) * dx + np.cos(turn) * dy
        self.polygon(list(zip(xs, ys)), paint, opacity)

    def line(self, points: Sequence[tuple[float, float]], thickness: float,
             paint: Colour | Picture, opacity: float = 1.0) -> None:
        """Paint an open line of a thickness in units; thinner than a pixel, it gets fainter."""
        pixels = thickness * self.unit
        part, mask, fixed = self._part(points, pixels)
        cv2.polylines(mask, [fixed], False, 255, max(1, round(pixels)), cv2.LINE_AA, _SHIFT)
        self._paint(part, mask, paint, opacity * min(1.0, pixels))

    def _part(self, points: Sequence[tuple[float, float]], margin: float) -> tuple[
            tuple[slice, slice], NDArray[np.uint8], NDArray[np.int32]]:
        """Return the part of the picture about some points, a mask for it, and the points."""
        pixels = (np.asarray(points, np.float64) - (self.left, self.top)) * self.unit - 0.5
        size = (self.width, self.height)
        low = np.clip(np.floor(pixels.min(axis=0) - margin - 2), 0, size).astype(int)
        high = np.clip(np.ceil(pixels.max(axis=0) + margin + 3), 0, size).astype(int)
        part = (slice(low[1], high[1]), slice(low[0], high[0]))
        mask = np.zeros((max(1, high[1] - low[1]), max(1, high[0] - low[0])), np.uint8)
        fixed = np.round((pixels - low) * (1 << _SHIFT)).astype(np.int32)
        return part, mask, fixed

    def _paint(self, part: tuple[slice, slice], mask: NDArray[np.uint8], paint: Colour | Picture,
               opacity: float) -> None:
        target = self.picture[part]
        if target.size == 0:
            return
        alpha = mask[..., None] * np.float32(opacity / 255)
        colour = paint[part] if isinstance(paint, np.ndarray) else np.array(paint, np.float32)
        target += alpha * (colour - target)
