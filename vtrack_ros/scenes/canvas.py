"""A picture that is painted in units of its own, at any resolution."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vtrack_ros.scenes.sprite import Sprite
from vtrack_ros.scenes.texture import Colour, fractal_noise, Picture

# Fixed-point bits of OpenCV's drawing coordinates.
_SHIFT = 6


class Canvas:
    """A picture of a shape (height, width), painted smoothly in units of `unit` pixels."""

    def __init__(self, left: float, top: float, right: float, bottom: float, unit: float,
                 colour: Colour = (128, 128, 128)) -> None:
        self.left, self.top, self.right, self.bottom = left, top, right, bottom
        self.unit = unit
        self.shape = (max(2, int(np.ceil((bottom - top) * unit))),
                      max(2, int(np.ceil((right - left) * unit))))
        self.picture: Picture = np.empty((*self.shape, 3), np.float32)
        self.picture[:] = colour

    def fill(self, texture: Picture) -> None:
        """Cover everything with a texture of its shape."""
        self.picture[:] = texture

    def gain(self, gain: NDArray[np.float32]) -> None:
        """Brighten or darken by factors that broadcast to its shape."""
        self.picture = np.asarray(np.clip(self.picture * gain[..., None], 0, 255), np.float32)

    def upright(self) -> Sprite:
        """Return it as something that stands on its origin, without a gap."""
        pixels = np.dstack([self.picture, np.ones(self.shape, np.float32)])
        return Sprite(pixels, self.unit, -(self.right - self.left) / 2, -(self.bottom - self.top))

    def rows(self) -> NDArray[np.float32]:
        """Return the y of every pixel row, shape (height, 1)."""
        return np.float32(self.top) + (np.arange(self.shape[0], dtype=np.float32)[:, None] + 0.5) \
            / np.float32(self.unit)

    def columns(self) -> NDArray[np.float32]:
        """Return the x of every pixel column, shape (1, width)."""
        return np.float32(self.left) + (np.arange(self.shape[1], dtype=np.float32)[None] + 0.5) \
            / np.float32(self.unit)

    def ragged(self, level: float, rough: float, cell: float,
               rng: np.random.Generator) -> list[tuple[float, float]]:
        """Return points of a line from left to right that rises and falls about a level."""
        noise = fractal_noise((1, self.shape[1]), cell * self.unit, rng)[0]
        return list(zip(self.columns()[0, ::4].tolist(), (level + rough * noise)[::4].tolist()))

    def polygon(self, points: ArrayLike, paint: Colour | Picture,
                opacity: float = 1.0) -> None:
        """Paint a polygon."""
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
        turn, round_ = np.radians(angle), np.linspace(0, 2 * np.pi, 64, endpoint=False)
        dx, dy = width / 2 * np.cos(round_), height / 2 * np.sin(round_)
        xs = x + np.cos(turn) * dx - np.sin(turn) * dy
        ys = y + np.sin(turn) * dx + np.cos(turn) * dy
        self.polygon(np.column_stack([xs, ys]), paint, opacity)

    def line(self, points: ArrayLike, thickness: float,
             paint: Colour | Picture, opacity: float = 1.0) -> None:
        """Paint an open line of a thickness in units; thinner than a pixel, it gets fainter."""
        pixels = thickness * self.unit
        part, mask, fixed = self._part(points, pixels)
        cv2.polylines(mask, [fixed], False, 255, max(1, round(pixels)), cv2.LINE_AA, _SHIFT)
        self._paint(part, mask, paint, opacity * min(1.0, pixels))

    def _part(self, points: ArrayLike, margin: float) -> tuple[
            tuple[slice, slice], NDArray[np.uint8], NDArray[np.int32]]:
        """Return the part of the picture about some points, a mask for it, and the points."""
        pixels = (np.asarray(points, np.float64) - (self.left, self.top)) * self.unit - 0.5
        size = self.shape[::-1]
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
