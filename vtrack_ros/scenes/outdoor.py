"""Places in the open: a park, a football pitch, a shopping street."""

from __future__ import annotations

import numpy as np

from vtrack_ros.scenes.canvas import Canvas
from vtrack_ros.scenes.ground import Ground, speckle, tiles
from vtrack_ros.scenes.stage import View
from vtrack_ros.scenes.texture import Colour, foliage, fractal_noise, lit, masonry, tinted


def park(view: View, ground: Ground, rng: np.random.Generator, margin: float = 12.0) -> Canvas:
    """Return a meadow before a hedge, trees and a wall, with a path across."""
    canvas = view.canvas(margin)
    unit, span = canvas.unit, view.base_height / 240
    leaves = foliage(canvas.shape, unit * span, rng, (40, 88, 66), 3.2)
    canvas.fill(leaves)
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


def pitch(view: View, ground: Ground, rng: np.random.Generator, margin: float = 60.0) -> Canvas:
    """Return a football pitch with boards and a crowd behind it."""
    canvas = view.canvas(margin)
    unit = canvas.unit
    crowd = fractal_noise(canvas.shape, 2.2 * unit, rng, 0.8)
    canvas.fill(tinted(crowd, (88, 80, 92), 0.35, 0.3))
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


def arcade(view: View, ground: Ground, rng: np.random.Generator, margin: float = 12.0) -> Canvas:
    """Return a shopping arcade: shop windows, pillars, advertisements, a tiled floor."""
    canvas = view.canvas(margin)
    unit, span = canvas.unit, view.base_height / 288
    wall = fractal_noise(canvas.shape, 40 * unit * span, rng)
    canvas.fill(tinted(wall, (128, 142, 150), 0.05, 0.01))
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
    shine = 1 + 0.1 * np.sin(canvas.columns() / (23 * span)) * np.exp(
        -(canvas.rows() - floor) / (40 * span))
    canvas.rectangle(canvas.left, floor, canvas.right, canvas.bottom,
                     lit((150, 160, 166), gain * shine))
    canvas.rectangle(canvas.left, floor - 2 * span, canvas.right, floor + span, (70, 78, 84))
    return canvas
