"""Procedural textures: noise, foliage, masonry, cloth."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

#: A picture: float32, shape (H, W, 3), BGR, 0 to 255.
Picture = NDArray[np.float32]
#: A colour: blue, green, red, 0 to 255.
Colour = tuple[float, float, float]


def fractal_noise(
        height: int, width: int, cell: float, rng: np.random.Generator,
        persistence: float = 0.6) -> NDArray[np.float32]:
    """
    Return noise whose spectrum falls off like that of natural images.

    The coarse octaves don't depend on the resolution: the same generator, and a cell that grows
    with the picture, give the same picture with more detail.

    Parameters
    ----------
    height, width : int, [px]
        The size of the picture.
    cell : float, [px]
        The size of the largest structures.
    rng : numpy.random.Generator
        Where the noise comes from.
    persistence : float
        How much weaker each octave is than the last.

    Returns
    -------
    noise : ndarray of float32, shape (height, width)
        Of mean 0 and standard deviation about 1.

    """
    noise = np.zeros((height, width), np.float32)
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


def wood_grain(height: int, width: int, unit: float,
               rng: np.random.Generator) -> NDArray[np.float32]:
    """Return noise in streaks from top to bottom, as `fractal_noise`; `unit` in pixels."""
    streaks = fractal_noise(max(2, height // 12), width, 4 * unit, rng, 0.8)
    return np.asarray(cv2.resize(streaks, (width, height), interpolation=cv2.INTER_CUBIC),
                      np.float32)


def tinted(noise: NDArray[np.float32], colour: Colour, contrast: float,
           hue: float = 0.0) -> Picture:
    """
    Return a picture of one colour whose brightness, and a little its hue, follow some noise.

    Parameters
    ----------
    noise : ndarray of float32, shape (H, W)
        Of standard deviation 1.
    colour : tuple of float
        Blue, green, red.
    contrast : float
        The standard deviation of the brightness, as a part of it.
    hue : float
        The same for red against blue.

    """
    base = np.array(colour, np.float32)
    tint = np.array([-hue, 0.0, hue], np.float32)
    gain = 1 + contrast * noise[..., None] + tint * np.roll(noise, 7, axis=1)[..., None]
    return np.asarray(np.clip(base * gain, 0, 255), np.float32)


def foliage(height: int, width: int, unit: float, rng: np.random.Generator,
            colour: Colour = (45, 95, 70), leaf: float = 2.5) -> Picture:
    """
    Return leaves in light and shadow.

    Parameters
    ----------
    height, width : int, [px]
        The size of the picture.
    unit : float, [px]
        How many pixels a length of 1 has.
    rng : numpy.random.Generator
        Varies everything.
    colour : tuple of float
        Blue, green, red.
    leaf : float
        The length of a leaf.

    """
    shade = fractal_noise(height, width, 22 * unit, rng)
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


def masonry(height: int, width: int, unit: float, rng: np.random.Generator,
            colour: Colour = (95, 110, 150), brick: tuple[float, float] = (10, 4.5)) -> Picture:
    """
    Return a wall of bricks, tiles or planks: courses of rectangles that differ a little.

    Parameters
    ----------
    height, width : int, [px]
        The size of the picture.
    unit : float, [px]
        How many pixels a length of 1 has.
    rng : numpy.random.Generator
        Varies everything.
    colour : tuple of float
        Blue, green, red.
    brick : tuple of float
        Width and height of a brick.

    """
    step_x, step_y = brick[0] * unit, brick[1] * unit
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
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
    gain += 0.07 * fractal_noise(height, width, 14 * unit, rng)
    return np.asarray(np.clip(gain[..., None] * np.array(colour), 0, 255), np.float32)
