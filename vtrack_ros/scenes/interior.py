"""Indoor backdrops: a room behind people."""

import cv2
import numpy as np

from vtrack_ros.scenes.canvas import Canvas, Colour, fractal_noise, masonry, tinted
from vtrack_ros.scenes.stage import View


def office(view: View, rng: np.random.Generator, size: float = 1.0) -> Canvas:
    """
    Return the wall of an office: shelf, door, window, posters, some of them skin-coloured.

    A size of 1 fits a view that is 100 units high.
    """
    canvas = view.canvas(12)
    unit = canvas.unit * size
    plaster = fractal_noise(canvas.shape, 30 * unit, rng)
    canvas.picture[:] = tinted(plaster, (150, 168, 172), 0.055, 0.01)
    canvas.gain(1.12 - 0.0025 / size * (canvas.columns() - view.left))
    middle, width = view.base_width / 2, 190 * size
    first = int(np.floor((canvas.left - middle) / width - 0.5))
    last = int(np.ceil((canvas.right - middle) / width + 0.5))
    for index in sorted(range(first, last + 1), key=abs):
        for offset, piece in ((-62, door), (-26, shelf), (20, posters), (48, window),
                              (86, cartons)):
            piece(canvas, middle + index * width + offset * size, view.bottom, size, rng)
    desk(canvas, view.bottom, size, rng)
    return canvas


def door(canvas: Canvas, x: float, bottom: float, size: float, rng: np.random.Generator) -> None:
    """Paint a wooden door."""
    top = bottom - 92 * size
    height, width = canvas.shape
    streaks = fractal_noise((max(2, height // 12), width), 4 * (canvas.unit * size), rng, 0.8)
    wood = tinted(np.asarray(cv2.resize(streaks, (width, height), interpolation=cv2.INTER_CUBIC),
                             np.float32), (92, 128, 172), 0.08)
    canvas.rectangle(x - 2 * size, top - 2 * size, x + 32 * size, bottom, (90, 98, 104))
    canvas.rectangle(x, top, x + 30 * size, bottom, wood)
    for left, upper, lower in ((4, 6, 38), (17, 6, 38), (4, 44, 84), (17, 44, 84)):
        panel = (x + left * size, top + upper * size, x + (left + 9) * size, top + lower * size)
        canvas.rectangle(*panel, (50, 74, 112), 0.6)
        canvas.rectangle(panel[0] + size, panel[1] + size, panel[2], panel[3], wood, 0.8)
    canvas.ellipse(x + 27.5 * size, top + 46 * size, 2.4 * size, 2.4 * size, (60, 150, 190))


def shelf(canvas: Canvas, x: float, bottom: float, size: float, rng: np.random.Generator) -> None:
    """Paint a shelf full of books."""
    top, width = bottom - 84 * size, 38 * size
    canvas.rectangle(x - size, top - size, x + width + size, bottom, (62, 84, 112))
    colours: list[Colour] = [
        (60, 60, 150), (120, 70, 40), (70, 110, 60), (140, 160, 175), (60, 130, 190),
        (40, 40, 46), (110, 140, 190), (150, 120, 80), (90, 90, 100), (84, 120, 176)]
    for row in range(5):
        upper = top + (1 + 16.5 * row) * size
        floor = upper + 14.5 * size
        canvas.rectangle(x, upper, x + width, floor, (34, 44, 56))
        place = x + rng.uniform(0, 1) * size
        while place < x + width - 4 * size:
            thick, high = rng.uniform(1.2, 3.4) * size, rng.uniform(8.5, 13.5) * size
            if rng.random() < 0.1:
                place += thick
                continue
            colour = colours[int(rng.integers(len(colours)))]
            shade = float(rng.uniform(0.7, 1.2))
            paint: Colour = tuple(shade * c for c in colour)  # type: ignore[assignment]
            canvas.rectangle(place, floor - high, place + thick, floor, paint)
            canvas.rectangle(place + 0.8 * thick, floor - high, place + thick, floor, (20, 20, 20),
                             0.35)
            band = floor - high * rng.uniform(0.6, 0.85)
            canvas.rectangle(place, band, place + thick, band + size, (170, 200, 205), 0.6)
            place += thick


def posters(canvas: Canvas, x: float, bottom: float, size: float,
            rng: np.random.Generator) -> None:
    """Paint two prints in warm colours, one of them with an oval that a face could be."""
    top = bottom - 82 * size
    canvas.rectangle(x, top, x + 20 * size, top + 27 * size, (52, 56, 60))
    canvas.rectangle(x + size, top + size, x + 19 * size, top + 26 * size, (105, 140, 165))
    canvas.ellipse(x + 10 * size, top + 12 * size, 10 * size, 13.5 * size, (128, 160, 205))
    canvas.ellipse(x + 10 * size, top + 7.5 * size, 10.5 * size, 8 * size, (40, 48, 66))
    canvas.ellipse(x + 10 * size, top + 24.5 * size, 18 * size, 9 * size, (70, 60, 120))
    lower = top + 32 * size
    print_ = tinted(fractal_noise(canvas.shape, 9 * canvas.unit * size, rng, 0.5),
                    (110, 145, 190), 0.32, 0.2)
    canvas.rectangle(x + 2 * size, lower, x + 22 * size, lower + 15 * size, (190, 200, 205))
    canvas.rectangle(x + 3 * size, lower + size, x + 21 * size, lower + 14 * size, print_)


def window(canvas: Canvas, x: float, bottom: float, size: float, rng: np.random.Generator) -> None:
    """Paint a window with blinds, bright."""
    top = bottom - 88 * size
    sky = tinted(fractal_noise(canvas.shape, 18 * canvas.unit * size, rng), (235, 222, 208), 0.06)
    canvas.rectangle(x, top, x + 34 * size, top + 44 * size, (175, 182, 186))
    canvas.rectangle(x + 2 * size, top + 2 * size, x + 32 * size, top + 42 * size, sky)
    for slat in range(13):
        y = top + (3 + 3 * slat) * size
        canvas.rectangle(x + 2 * size, y, x + 32 * size, y + 1.1 * size, (128, 140, 146), 0.75)
    canvas.rectangle(x + 16.2 * size, top + 2 * size, x + 17.8 * size, top + 42 * size,
                     (165, 172, 176))


def cartons(canvas: Canvas, x: float, bottom: float, size: float,
            rng: np.random.Generator) -> None:
    """Paint a pile of cardboard boxes."""
    board = tinted(fractal_noise(canvas.shape, 12 * canvas.unit * size, rng),
                   (108, 146, 180), 0.07)
    for left, top, width, height in ((0, 20, 26, 20), (3, 42, 22, 22), (6, 58, 17, 16)):
        a, b = x + left * size, bottom - top * size
        c, d = a + width * size, b + height * size
        canvas.rectangle(a - 0.5 * size, b - 0.5 * size, c + 0.5 * size, d, (62, 88, 112))
        canvas.rectangle(a, b, c, d, board)
        canvas.rectangle(a, b + 0.42 * (d - b), c, b + 0.54 * (d - b), (120, 160, 190), 0.7)
        canvas.rectangle(a + 3 * size, b + 2.5 * size, a + 9 * size, b + 6 * size, (215, 220, 222))


def desk(canvas: Canvas, bottom: float, size: float, rng: np.random.Generator) -> None:
    """Paint the edge of a desk along the bottom."""
    top = bottom - 9 * size
    wood = masonry(canvas.shape, canvas.unit * size, rng, (70, 92, 122), (60, 3))
    canvas.rectangle(canvas.left, top, canvas.right, canvas.bottom, wood)
    canvas.rectangle(canvas.left, top, canvas.right, top + 1.2 * size, (150, 160, 170), 0.6)
