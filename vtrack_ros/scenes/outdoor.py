"""Backdrops of places: a park, a football pitch, a shopping arcade, a road, a town in hills."""

from dataclasses import dataclass

import numpy as np

from vtrack_ros.frame import Array, Array32
from vtrack_ros.scenes.canvas import (
    Canvas, Colour, foliage, fractal_noise, lit, masonry, Picture, tinted)
from vtrack_ros.scenes.stage import View

_WALLS: tuple[Colour, ...] = (
    (110, 130, 160), (150, 165, 175), (120, 140, 150), (95, 110, 140), (160, 160, 158))


@dataclass(frozen=True)
class Ground:
    """
    A level ground in perspective; `horizon` is its y, `middle` the x of the vanishing point.

    `scale` is the size factor of things (see `size_at`) per unit of y below the horizon; a person
    100 units tall appears 100 times the size factor high.
    """

    horizon: float
    scale: float
    middle: float

    def size_at(self, y: float) -> float:
        """Return the size factor of things that stand at y."""
        return self.scale * max(1.0, y - self.horizon)

    def plane(self, canvas: Canvas) -> tuple[Array, Array]:
        """Return each pixel's ground coordinates (across, away), in units at size factor 1."""
        below = np.maximum(canvas.rows() - self.horizon, 0.4).astype(np.float64)
        size = self.scale * below
        across = (canvas.columns() - self.middle) / size
        away = np.broadcast_to(1 / self.scale ** 2 / below * 2, across.shape)
        return across, away


def tiles(canvas: Canvas, ground: Ground, edge: float, contrast: float,
          rng: np.random.Generator) -> Array32:
    """Return the gain of square tiles of an edge length on the ground; distant ones fade."""
    across, away = ground.plane(canvas)
    column, row = np.floor(across / edge).astype(int), np.floor(away / edge).astype(int)
    table = rng.normal(0, 1, (61, 67))
    gain = table[row % 61, column % 67]
    joint = np.minimum(across % edge, edge - across % edge) < 0.035 * edge
    joint |= np.minimum(away % edge, edge - away % edge) < 0.05 * edge
    seen = np.clip((canvas.rows() - ground.horizon) * ground.scale * edge / 8, 0, 1)
    return np.asarray(1 + contrast * seen * (gain - 2.2 * joint), np.float32)


def speckle(canvas: Canvas, ground: Ground, cell: float, contrast: float,
            rng: np.random.Generator) -> Array32:
    """Return the gain of irregular ground, such as grass or asphalt, in perspective."""
    across, away = ground.plane(canvas)
    noise = fractal_noise((512, 512), 64, rng, 0.75)
    u, v = np.abs(across / cell * 64 + 300), np.abs(away / cell * 64)
    # The noise is repeated mirrored, so that no seam shows.
    columns, rows = (np.abs(w.astype(int) % 1022 - 511) for w in (u, v))
    far = noise[rows, columns]
    flat = fractal_noise(canvas.shape, 3 * canvas.unit, rng, 0.8)
    return np.asarray(1 + contrast * (0.7 * far + 0.6 * flat), np.float32)


def park(view: View, ground: Ground, rng: np.random.Generator) -> Canvas:
    """Return a meadow in front of a hedge, trees and a wall, with a path across."""
    canvas = view.canvas(12)
    unit, span = canvas.unit, view.base_height / 240
    leaves = foliage(canvas.shape, unit * span, rng, (40, 88, 66), 3.2)
    canvas.picture[:] = leaves
    sky = tinted(fractal_noise(canvas.shape, 60 * unit, rng), (222, 208, 192), 0.05)
    trees = canvas.ragged(canvas.top + 0.14 * (ground.horizon - canvas.top), 7 * span, 50, rng)
    canvas.polygon([(canvas.left, canvas.top - 9), *trees, (canvas.right, canvas.top - 9)], sky)
    for x in np.arange(canvas.left + rng.uniform(0, 30), canvas.right, 47 * span):
        width = rng.uniform(3, 6) * span
        top = ground.horizon - rng.uniform(55, 90) * span
        canvas.polygon([(x - 0.7 * width, ground.horizon), (x - 0.4 * width, top),
                        (x + 0.4 * width, top), (x + 0.7 * width, ground.horizon)],
                       (38, 52, 66), 0.85)
    wall = masonry(canvas.shape, unit * span, rng, (92, 112, 150), (9, 4))
    middle = view.base_width / 2
    canvas.rectangle(middle - 12 * span, ground.horizon - 34 * span, middle + 150 * span,
                     ground.horizon, wall)
    canvas.rectangle(middle - 13 * span, ground.horizon - 37 * span, middle + 151 * span,
                     ground.horizon - 33 * span, (120, 132, 140))
    canvas.rectangle(canvas.left, ground.horizon, canvas.right, canvas.bottom,
                     lit((52, 112, 92), speckle(canvas, ground, 90, 0.16, rng)))
    path = lit((132, 152, 166), speckle(canvas, ground, 60, 0.07, rng))
    depth = 0.5 * (ground.horizon + view.base_height)
    canvas.polygon([(canvas.left, depth - 14 * span), (canvas.right, depth + 2 * span),
                    (canvas.right, depth + 30 * span), (canvas.left, depth + 10 * span)],
                   path, 0.9)
    return canvas


def pitch(view: View, ground: Ground, rng: np.random.Generator) -> Canvas:
    """Return a football pitch with boards and a crowd behind it."""
    canvas = view.canvas(60)
    unit = canvas.unit
    crowd = fractal_noise(canvas.shape, 2.2 * unit, rng, 0.8)
    canvas.picture[:] = tinted(crowd, (88, 80, 92), 0.35, 0.3)
    top = ground.horizon + 8
    lengths = rng.uniform(30, 62, 60)
    colours: list[Colour] = [(150, 60, 40), (60, 60, 190), (225, 225, 225), (50, 150, 210),
                             (60, 60, 64), (90, 130, 50)]
    x = canvas.left
    for length in lengths:
        colour = colours[int(rng.integers(len(colours)))]
        canvas.rectangle(x, top - 15, x + length, top, colour)
        letter = x + 5
        while letter < x + length - 8:
            wide = float(rng.uniform(2.5, 5))
            canvas.rectangle(letter, top - 11, letter + wide, top - 4.5, (235, 235, 235), 0.8)
            canvas.rectangle(letter + 0.3 * wide, top - 9, letter + 0.7 * wide, top - 7, colour)
            letter += wide + 2
        x += length
        if x > canvas.right:
            break
    mown = np.sign(np.sin(ground.plane(canvas)[0] / 150 + 0.4)).astype(np.float32)
    gain = speckle(canvas, ground, 120, 0.1, rng) * (1 + 0.07 * mown)
    canvas.rectangle(canvas.left, top, canvas.right, canvas.bottom, lit((58, 138, 96), gain))
    white: Colour = (205, 220, 215)
    middle, bottom = ground.middle, canvas.bottom
    canvas.line([(canvas.left, top + 12), (canvas.right, top + 12)], 1.6, white, 0.85)
    canvas.line([(middle - 20, top + 12), (middle - 130, bottom)], 2.0, white, 0.85)
    turn = np.linspace(0, 2 * np.pi, 80)
    canvas.line(np.column_stack([middle - 62 + 105 * np.cos(turn), top + 88 + 42 * np.sin(turn)]),
                1.9, white, 0.8)
    return canvas


def arcade(view: View, ground: Ground, rng: np.random.Generator) -> Canvas:
    """Return a shopping arcade: shop windows, pillars, advertisements, a tiled floor."""
    canvas = view.canvas(12)
    unit, span = canvas.unit, view.base_height / 288
    wall = fractal_noise(canvas.shape, 40 * unit * span, rng)
    canvas.picture[:] = tinted(wall, (128, 142, 150), 0.05, 0.01)
    floor = ground.horizon + 46 * span
    goods: list[Colour] = [(60, 70, 160), (150, 120, 70), (70, 130, 90), (170, 180, 190),
                           (50, 140, 200), (50, 50, 60), (125, 155, 200)]
    x = canvas.left
    while x < canvas.right:
        width = float(rng.uniform(70, 105)) * span
        left, right, top = x + 6 * span, x + width - 6 * span, floor - 98 * span
        glow = tinted(fractal_noise(canvas.shape, 16 * unit * span, rng),
                      (150, 178, 190), 0.07, 0.012)
        canvas.rectangle(left - 2 * span, top - 2 * span, right + 2 * span, floor, (58, 66, 74))
        canvas.rectangle(left, top, right, floor - 3 * span, glow)
        for _ in range(16):
            wide, high = rng.uniform(4, 15, 2) * span
            at, base = rng.uniform(left, right - wide), floor - rng.choice([5, 30, 55]) * span
            canvas.rectangle(at, base - high, at + wide, base,
                             goods[int(rng.integers(len(goods)))], 0.8)
        for level in (30, 55):
            canvas.rectangle(left, floor - level * span, right, floor - (level - 1.6) * span,
                             (96, 108, 118))
        sign = goods[int(rng.integers(len(goods)))]
        canvas.rectangle(left, top - 22 * span, right, top - 6 * span, sign)
        for index in range(int(rng.integers(4, 8))):
            at = left + (6 + 8 * index) * span
            canvas.rectangle(at, top - 18 * span, at + 5 * span, top - 10 * span, (220, 225, 228),
                             0.85)
        canvas.rectangle(right + 3 * span, canvas.top, right + 9 * span, floor, (108, 120, 128))
        canvas.rectangle(right + 3 * span, canvas.top, right + 4.4 * span, floor, (150, 158, 164))
        x += width
    gain = tiles(canvas, ground, 45, 0.05, rng) * speckle(canvas, ground, 200, 0.035, rng)
    shine: Picture = np.float32(0.1) * np.sin(canvas.columns() / (23 * span)) * np.exp(
        -(canvas.rows() - floor) / (40 * span)) + 1
    canvas.rectangle(canvas.left, floor, canvas.right, canvas.bottom,
                     lit((150, 160, 166), gain * shine))
    canvas.rectangle(canvas.left, floor - 2 * span, canvas.right, floor + span, (70, 78, 84))
    return canvas


def sky(canvas: Canvas, rng: np.random.Generator) -> Picture:
    """Return clouds, of the canvas's shape."""
    high = tinted(fractal_noise(canvas.shape, 90 * canvas.unit, rng, 0.55),
                  (216, 200, 182), 0.09, -0.02)
    haze = np.clip((canvas.rows() - canvas.top) / (canvas.bottom - canvas.top), 0, 1)
    return np.asarray(np.clip(high + 22 * haze[..., None], 0, 255), np.float32)


def house(canvas: Canvas, left: float, top: float, right: float, bottom: float,
          wall: Picture, colour: Colour, storey: float, rng: np.random.Generator) -> None:
    """Paint the front of a house: a textured wall tinted by a colour, and its windows."""
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


def road(view: View, ground: Ground, rng: np.random.Generator) -> Canvas:
    """Return a road from the vanishing point towards the viewer, between houses and trees."""
    canvas = view.canvas(14)
    unit, far = canvas.unit, ground.middle
    canvas.picture[:] = sky(canvas, rng)
    leaves = foliage(canvas.shape, unit, rng, (44, 86, 66), 3.0)
    brick = masonry(canvas.shape, unit, rng, (118, 132, 158), (8, 3.5))
    canvas.polygon([*canvas.ragged(ground.horizon - 17, 4, 40, rng), (canvas.right, 140),
                    (canvas.left, 140)], leaves)
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
        """Paint a strip along the road, between two slopes dx / dy from the vanishing point."""
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
    """Return hills, woods and a town under the sky, reaching `reach` beyond the view's right."""
    canvas = Canvas(view.left - 50, view.top - 50, view.right + reach + 50, view.bottom + 50,
                    view.unit)
    unit = canvas.unit
    canvas.picture[:] = sky(canvas, rng)
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
