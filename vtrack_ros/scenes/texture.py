"""
Procedural textures: noise, foliage, masonry, cloth.

A shape is (height, width) in pixels, and so are cells; a length of 1 has `unit` pixels.
Pictures are float32, shape (H, W, 3), noise is float32, shape (H, W).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

#: A picture: float32, shape (H, W, 3), BGR, 0 to 255.
Picture = NDArray[np.float32]
#: A colour: blue, green, red, 0 to 255.
Colour = tuple[float, float, float]


def fractal_noise(
        shape: tuple[int, int], cell: float, rng: np.random.Generator,
        persistence: float = 0.6) -> NDArray[np.float32]:
    """
    Return noise of mean 0 and deviation about 1, whose spectrum falls off like natural images'.

    The coarse octaves don't depend on the resolution: the same generator, and a cell that grows
    with the picture, give the same picture with more detail. The largest structures have the size
    of a cell; each octave is weaker than the last by the factor `persistence`.
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


def tinted(noise: NDArray[np.float32], colour: Colour, contrast: float,
           hue: float = 0.0) -> Picture:
    """Return one colour whose brightness, and by a share `hue` its red, follow noise."""
    base = np.array(colour, np.float32)
    tint = np.array([-hue, 0.0, hue], np.float32)
    gain = 1 + contrast * noise[..., None] + tint * np.roll(noise, 7, axis=1)[..., None]
    return np.asarray(np.clip(base * gain, 0, 255), np.float32)


def lit(colour: Colour, gain: NDArray[np.float32]) -> Picture:
    """Return one colour under a gain of shape (H, W)."""
    return np.asarray(np.clip(np.array(colour, np.float32) * gain[..., None], 0, 255), np.float32)


def foliage(shape: tuple[int, int], unit: float, rng: np.random.Generator, colour: Colour,
            leaf: float) -> Picture:
    """Return leaves of a length in light and shadow."""
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
        bgr = [max(0.0, min(255.0, c * gain * (1 + s * warm)))
               for c, s in zip(colour, (-1, 0, 1))]
        centre = (int(place[0] * 16), int(place[1] * 16))
        axes = (max(8, int(length * 16)), max(6, int(length * 6)))
        cv2.ellipse(picture, centre, axes, angle, 0, 360, bgr, -1, cv2.LINE_AA, 4)
    return picture.astype(np.float32)


def masonry(shape: tuple[int, int], unit: float, rng: np.random.Generator, colour: Colour,
            brick: tuple[float, float]) -> Picture:
    """Return courses of bricks, tiles or planks (width, height) that differ a little."""
    step_x, step_y = brick[0] * unit, brick[1] * unit
    y, x = np.mgrid[:shape[0], :shape[1]].astype(np.float32)
    course = np.floor(y / step_y).astype(int)
    offset = 0.5 * step_x * (course % 2)
    column = np.floor((x + offset) / step_x).astype(int)
    gains = rng.normal(1, 0.09, (course.max() + 1, column.max() + 1))
    gain = gains[course, column]
    # Joints fade out where a brick is only a few pixels high.
    joint = np.minimum(
        np.minimum((x + offset) % step_x, step_x - (x + offset) % step_x),
        np.minimum(y % step_y, step_y - y % step_y))
    gain -= 0.22 * np.clip(1 - joint / max(0.5 * unit, 0.7), 0, 1)
    gain += 0.07 * fractal_noise(shape, 14 * unit, rng)
    return np.asarray(np.clip(gain[..., None] * np.array(colour), 0, 255), np.float32)
