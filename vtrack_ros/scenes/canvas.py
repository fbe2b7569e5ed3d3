"""
Textures, and a canvas that backdrops are painted on in world units, at any resolution.

Shapes (height, width) and cells of noise are in pixels; a length of 1 world unit has `unit`
pixels. Pictures are float32, shape (H, W, 3), noise is float32, shape (H, W).
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vtrack_ros.frame import Array32
from vtrack_ros.scenes.sprite import Sprite

#: A picture: float32, shape (H, W, 3), BGR, 0 to 255.
Picture = Array32
#: A colour: blue, green, red, 0 to 255.
Colour = tuple[float, float, float]
# Fixed-point bits of OpenCV's drawing coordinates.
_SHIFT = 6


def fractal_noise(shape: tuple[int, int], cell: float, rng: np.random.Generator,
                  persistence: float = 0.6) -> Array32:
    """
    Return noise of mean 0 and deviation about 1, whose spectrum falls off like natural images'.

    The largest structures have the size of a cell; the amplitude of each finer octave is
    `persistence` times that of the one before. Coarse octaves don't depend on the resolution.
    """
    height, width = shape
    noise = np.zeros(shape, np.float32)
    amplitude, power = 1.0, 0.0
    while True:
        rows, columns = int(np.ceil(height / cell)) + 3, int(np.ceil(width / cell)) + 3
        lattice = rng.standard_normal((rows, columns), np.float32)
        matrix = np.array([[1 / cell, 0, 0.5 / cell + 0.5], [0, 1 / cell, 0.5 / cell + 0.5]])
        noise += amplitude * cv2.warpAffine(
            lattice, matrix, (width, height), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REFLECT)
        power += 0.5 * amplitude ** 2
        if cell < 2.5:
            return np.asarray(noise / np.sqrt(power), np.float32)
        amplitude *= persistence
        cell /= 2


def tinted(noise: Array32, colour: Colour, contrast: float, hue: float = 0.0) -> Picture:
    """Return a colour; its brightness varies with noise by `contrast`, red minus blue by `hue`."""
    base = np.array(colour, np.float32)
    tint = np.array([-hue, 0.0, hue], np.float32)
    gain = 1 + contrast * noise[..., None] + tint * np.roll(noise, 7, axis=1)[..., None]
    return np.asarray(np.clip(base * gain, 0, 255), np.float32)


def lit(colour: Colour, gain: Array32) -> Picture:
    """Return one colour multiplied by a gain of shape (H, W)."""
    return np.asarray(np.clip(np.array(colour, np.float32) * gain[..., None], 0, 255), np.float32)


def foliage(shape: tuple[int, int], unit: float, rng: np.random.Generator, colour: Colour,
            leaf: float) -> Picture:
    """Return leaves in light and shadow; `leaf` is their typical length in world units."""
    height, width = shape
    shade = fractal_noise(shape, 22 * unit, rng)
    picture = np.asarray(tinted(shade, colour, 0.3), np.uint8).copy()
    count = int(0.9 * height * width / (unit * leaf) ** 2)
    places = rng.random((count, 2)) * (width, height)
    angles = rng.uniform(0, 180, count)
    lengths = unit * leaf * rng.uniform(0.3, 0.9, count)
    gains = rng.uniform(0.45, 1.55, count)
    warmth = rng.normal(0, 0.12, count)
    for place, angle, length, gain, warm in zip(places, angles, lengths, gains, warmth):
        gain *= 1 + 0.3 * float(shade[int(place[1]), int(place[0])])
        bgr = [max(0.0, min(255.0, c * gain * (1 + s * warm))) for c, s in zip(colour, (-1, 0, 1))]
        centre = (int(place[0] * 16), int(place[1] * 16))
        axes = (max(8, int(length * 16)), max(6, int(length * 6)))
        cv2.ellipse(picture, centre, axes, angle, 0, 360, bgr, -1, cv2.LINE_AA, 4)
    return picture.astype(np.float32)


def masonry(shape: tuple[int, int], unit: float, rng: np.random.Generator, colour: Colour,
            brick: tuple[float, float]) -> Picture:
    """Return courses of bricks of a (width, height), tiles or planks, of varied brightness."""
    step_x, step_y = brick[0] * unit, brick[1] * unit
    y, x = np.mgrid[:shape[0], :shape[1]].astype(np.float32)
    course = np.floor(y / step_y).astype(int)
    offset = 0.5 * step_x * (course % 2)
    column = np.floor((x + offset) / step_x).astype(int)
    gains = rng.normal(1, 0.09, (course.max() + 1, column.max() + 1))
    gain = gains[course, column]
    # A joint is darkest in its middle, and fades over half a unit to each side, at least 0.7 px.
    joint = np.minimum(
        np.minimum((x + offset) % step_x, step_x - (x + offset) % step_x),
        np.minimum(y % step_y, step_y - y % step_y))
    gain -= 0.22 * np.clip(1 - joint / max(0.5 * unit, 0.7), 0, 1)
    gain += 0.07 * fractal_noise(shape, 14 * unit, rng)
    return np.asarray(np.clip(gain[..., None] * np.array(colour), 0, 255), np.float32)


class Canvas:
    """A picture painted with anti-aliasing, in world units of `unit` pixels."""

    def __init__(self, left: float, top: float, right: float, bottom: float, unit: float,
                 colour: Colour = (128, 128, 128)) -> None:
        self.left, self.top, self.right, self.bottom = left, top, right, bottom
        self.unit = unit
        self.shape = (max(2, int(np.ceil((bottom - top) * unit))),
                      max(2, int(np.ceil((right - left) * unit))))
        self.picture: Picture = np.empty((*self.shape, 3), np.float32)
        self.picture[:] = colour

    def gain(self, gain: Array32) -> None:
        """Multiply the picture by a gain that broadcasts to its shape (height, width)."""
        self.picture = np.asarray(np.clip(self.picture * gain[..., None], 0, 255), np.float32)

    def upright(self) -> Sprite:
        """Return it as an opaque sprite; its origin is the middle of the bottom edge."""
        pixels = np.dstack([self.picture, np.ones(self.shape, np.float32)])
        return Sprite(pixels, self.unit, -(self.right - self.left) / 2, -(self.bottom - self.top))

    def rows(self) -> Array32:
        """Return the y of every pixel row, shape (height, 1)."""
        return np.float32(self.top) + (np.arange(self.shape[0], dtype=np.float32)[:, None] + 0.5) \
            / np.float32(self.unit)

    def columns(self) -> Array32:
        """Return the x of every pixel column, shape (1, width)."""
        return np.float32(self.left) + (np.arange(self.shape[1], dtype=np.float32)[None] + 0.5) \
            / np.float32(self.unit)

    def ragged(self, level: float, rough: float, cell: float,
               rng: np.random.Generator) -> list[tuple[float, float]]:
        """Return points of a line from left to right; y is `level` +/- `rough` times noise."""
        noise = fractal_noise((1, self.shape[1]), cell * self.unit, rng)[0]
        return list(zip(self.columns()[0, ::4].tolist(), (level + rough * noise)[::4].tolist()))

    def polygon(self, points: ArrayLike, paint: Colour | Picture, opacity: float = 1.0) -> None:
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
        """Paint an ellipse with a centre, a width and a height, rotated by an angle in degrees."""
        turn, round_ = np.radians(angle), np.linspace(0, 2 * np.pi, 64, endpoint=False)
        dx, dy = width / 2 * np.cos(round_), height / 2 * np.sin(round_)
        xs = x + np.cos(turn) * dx - np.sin(turn) * dy
        ys = y + np.sin(turn) * dx + np.cos(turn) * dy
        self.polygon(np.column_stack([xs, ys]), paint, opacity)

    def line(self, points: ArrayLike, thickness: float,
             paint: Colour | Picture, opacity: float = 1.0) -> None:
        """Paint an open line of a thickness in units; below a pixel, its opacity falls instead."""
        pixels = thickness * self.unit
        part, mask, fixed = self._part(points, pixels)
        cv2.polylines(mask, [fixed], False, 255, max(1, round(pixels)), cv2.LINE_AA, _SHIFT)
        self._paint(part, mask, paint, opacity * min(1.0, pixels))

    def _part(self, points: ArrayLike, margin: float) -> tuple[
            tuple[slice, slice], NDArray[np.uint8], NDArray[np.int32]]:
        """Return the part of the picture about points, an empty mask, and the points in it."""
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
