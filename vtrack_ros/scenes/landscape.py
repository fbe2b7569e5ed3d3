"""Wide places: a road between houses, and hills with a town below."""

from __future__ import annotations

import numpy as np

from vtrack_ros.scenes.canvas import Canvas
from vtrack_ros.scenes.ground import Ground, speckle
from vtrack_ros.scenes.stage import View
from vtrack_ros.scenes.texture import (
    Colour, foliage, fractal_noise, lit, masonry, Picture, tinted)

_WALLS: tuple[Colour, ...] = (
    (110, 130, 160), (150, 165, 175), (120, 140, 150), (95, 110, 140), (160, 160, 158))


def sky(canvas: Canvas, rng: np.random.Generator) -> Picture:
    """Return clouds, of the canvas's shape."""
    high = tinted(fractal_noise(canvas.shape, 90 * canvas.unit, rng, 0.55),
                  (216, 200, 182), 0.09, -0.02)
    haze = np.clip((canvas.rows() - canvas.top) / (canvas.bottom - canvas.top), 0, 1)
    return np.asarray(np.clip(high + 22 * haze[..., None], 0, 255), np.float32)


def house(canvas: Canvas, left: float, top: float, right: float, bottom: float,
          wall: Picture, colour: Colour, storey: float, rng: np.random.Generator) -> None:
    """Paint the front of a house: a wall whose texture takes on a colour, and its windows."""
    canvas.rectangle(left, top, right, bottom, wall)
    canvas.rectangle(left, top, right, bottom, colour, 0.6)
    canvas.rectangle(left - 0.1 * storey, top - 0.12 * storey, right + 0.1 * storey,
                     top + 0.08 * storey, (70, 74, 84))
    y = top + 0.35 * storey
    while y + 0.62 * storey < bottom:
        x = left + 0.28 * storey
        while x + 0.45 * storey < right:
            shade = float(rng.uniform(0.4, 1.1))
            pane: Colour = (92 * shade, 84 * shade, 76 * shade)
            canvas.rectangle(x - 0.05 * storey, y - 0.05 * storey, x + 0.45 * storey,
                             y + 0.62 * storey, (185, 190, 192), 0.8)
            canvas.rectangle(x, y, x + 0.4 * storey, y + 0.57 * storey, pane)
            x += 0.8 * storey
        y += storey


def road(view: View, ground: Ground, rng: np.random.Generator, margin: float = 14.0) -> Canvas:
    """Return a road that comes out of the distance between houses and trees."""
    canvas = view.canvas(margin)
    unit, far = canvas.unit, ground.middle
    canvas.fill(sky(canvas, rng))
    leaves = foliage(canvas.shape, unit, rng, (44, 86, 66), 3.0)
    brick = masonry(canvas.shape, unit, rng, (118, 132, 158), (8, 3.5))
    canvas.polygon([*canvas.ragged(ground.horizon - 17, 4, 40, rng), (canvas.right, 140), (canvas.left, 140)], leaves)
    x, reach = far - 30, 15.0
    while x > canvas.left - 60:
        colour = _WALLS[int(rng.integers(len(_WALLS)))]
        high = reach * float(rng.uniform(2.0, 2.8))
        house(canvas, x - 2.2 * reach, ground.horizon - high, x, ground.horizon + 0.7 * reach,
              brick, colour, 0.75 * reach, rng)
        x -= 2.3 * reach
        reach *= 1.45
    x, reach = far + 26, 12.0
    while x < canvas.right + 40:
        for _ in range(9):
            dx, dy = rng.normal(0, 0.5, 2) * reach
            canvas.ellipse(x + dx, ground.horizon - 1.2 * reach + dy, 1.3 * reach, 1.1 * reach,
                           leaves, 1.0, float(rng.uniform(0, 180)))
        canvas.rectangle(x - 0.08 * reach, ground.horizon - reach, x + 0.08 * reach,
                         ground.horizon + 0.7 * reach, (40, 52, 62))
        x += 1.5 * reach
        reach *= 1.3
    gain = speckle(canvas, ground, 40, 0.09, rng)
    bottom, depth = canvas.bottom, canvas.bottom - ground.horizon

    def strip(from_: float, to: float, paint: Picture | Colour, opacity: float = 1.0,
              start: float = 0.03, end: float = 1.0) -> None:
        """Paint a strip along the road, between two slopes against the direction of view."""
        canvas.polygon([(far + slope * at * depth, ground.horizon + at * depth)
                        for slope, at in ((from_, start), (to, start), (to, end), (from_, end))],
                       paint, opacity)

    canvas.rectangle(canvas.left, ground.horizon + 2, canvas.right, bottom,
                     lit((62, 112, 100), gain))
    strip(-1.6, 1.75, lit((136, 144, 150), gain))
    strip(-1.15, 1.4, lit((98, 98, 100), gain))
    strip(-1.16, -1.11, (170, 174, 176), 0.8)
    strip(1.37, 1.42, (170, 174, 176), 0.8)
    for index in range(14):
        near = 0.05 * 1.28 ** index
        if near < 1:
            strip(0.12, 0.17, (205, 210, 212), 0.85, near, min(1.0, near * 1.14))
    return canvas


def valley(view: View, rng: np.random.Generator, reach: float) -> Canvas:
    """Return hills, woods and a town under the sky, `reach` wider than the view to the right."""
    canvas = Canvas(view.left - 50, view.top - 50, view.right + reach + 50, view.bottom + 50,
                    view.unit)
    unit = canvas.unit
    canvas.fill(sky(canvas, rng))
    woods = foliage(canvas.shape, unit, rng, (46, 84, 62), 3.6)
    brick = masonry(canvas.shape, unit, rng, (118, 132, 158), (8, 3.5))
    slope = fractal_noise(canvas.shape, 14 * unit, rng, 0.75)
    for level, rough, hill in ((96, 9, tinted(slope, (176, 156, 132), 0.12)),
                               (112, 11, tinted(slope, (140, 132, 104), 0.12)), (138, 9, woods)):
        canvas.polygon([*canvas.ragged(level, rough, 110, rng), (canvas.right, canvas.bottom),
                        (canvas.left, canvas.bottom)], hill)
    for base, storey, gap in ((192, 8, 34), (226, 11, 26)):
        x = canvas.left
        while x < canvas.right:
            wide, high = float(rng.uniform(24, 58)), float(rng.uniform(20, 62)) * storey / 9
            colour = _WALLS[int(rng.integers(len(_WALLS)))]
            house(canvas, x, base - high, x + wide, base + 60, brick, colour, storey, rng)
            x += wide + float(rng.uniform(2, gap))
            for _ in range(5):
                canvas.ellipse(x - float(rng.uniform(0, gap)), base - float(rng.uniform(0, 6)),
                               float(rng.uniform(10, 20)), float(rng.uniform(10, 18)), woods)
    return canvas
