"""A person's head and shoulders, from any side."""

from __future__ import annotations

from functools import lru_cache
import math

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.scenes.solid import (
    ball, limb, Paint, plain, render, rotation, striped, surface)
from vtrack_ros.scenes.sprite import Sprite
from vtrack_ros.scenes.texture import Colour


class Head:
    """A head, about 2 units high and 1.6 wide, its origin in the middle; `unit` in pixels."""

    def __init__(self, unit: float, rng: np.random.Generator, skin: Colour = (128, 160, 208),
                 hair: Colour = (34, 42, 58), shirt: Colour = (120, 70, 50),
                 stripe: Colour = (170, 160, 150)) -> None:
        self._unit = unit
        tuft = surface(rng, 0.25, 4)
        complexion = surface(rng, 0.5)
        brushed = plain(hair, tuft, 0.45)
        flesh = plain(skin, complexion, 0.035)
        self._head = [
            ball(0, 0, 0, 0.74, 1.0, 0.86, _face(skin, hair, complexion)),
            ball(0, -0.17, -0.15, 0.79, 0.90, 0.88, brushed),
            ball(-0.2, -0.76, 0.36, 0.46, 0.24, 0.38, brushed),
            ball(0.26, -0.77, 0.33, 0.42, 0.22, 0.36, brushed),
            ball(-0.74, 0.06, -0.02, 0.10, 0.20, 0.15, flesh),
            ball(0.74, 0.06, -0.02, 0.10, 0.20, 0.15, flesh),
            ball(0, 0.16, 0.84, 0.13, 0.25, 0.17, flesh),
        ]
        cloth = surface(rng, 0.5)
        knit = striped(shirt, stripe, 9, 1, cloth, 0.62)
        self._body = [
            limb((0, 0.5, -0.2), (0, 1.5, -0.3), 0.38, flesh),
            ball(0, 2.95, -0.45, 1.5, 1.6, 0.75, knit),
            ball(0, 2.0, -0.45, 1.45, 0.6, 0.55, plain(shirt, cloth)),
            limb((-1.3, 2.1, -0.45), (-1.65, 4.2, -0.3), 0.44, knit),
            limb((1.3, 2.1, -0.45), (1.65, 4.2, -0.3), 0.44, knit),
        ]
        self._render = lru_cache(maxsize=64)(self._rendered)

    def head(self, yaw: float = 0.0, pitch: float = 0.0) -> Sprite:
        """Return the head, turned by a yaw to the right and a pitch up, in radians."""
        return self._render(round(yaw, 3), round(pitch, 3), True)

    def body(self, yaw: float = 0.0) -> Sprite:
        """Return neck and shoulders, in the head's coordinates."""
        return self._render(round(yaw, 2), 0.0, False)

    def _rendered(self, yaw: float, pitch: float, head: bool) -> Sprite:
        return render(self._head if head else self._body, rotation(yaw, pitch), self._unit)


def _face(skin: Colour, hair: Colour, complexion: Paint) -> Paint:
    base = np.array(skin, np.float32)

    def paint(points: NDArray[np.float32]) -> NDArray[np.float32]:
        x, y, z = points[:, 0], points[:, 1], points[:, 2]
        colour = base * (1 + 0.035 * complexion(points))

        def blend(mask: NDArray[np.float32], tone: Colour, strength: float = 1.0) -> None:
            weight = (strength * mask * (z > 0))[:, None]
            colour[:] += weight * (np.array(tone, np.float32) - colour)

        dark = (base[0] * 0.55, base[1] * 0.5, base[2] * 0.55)
        lips = (base[0] * 0.75, base[1] * 0.6, base[2] * 0.88)
        side = np.abs(x)
        blend(_spot(side, y, 0.42, 0.25, 0.26, 0.2), (base[0] * 0.9, base[1] * 0.88, base[2]), 0.6)
        blend(_spot(side, y, 0.36, -0.10, 0.25, 0.16), dark, 0.55)
        blend(_spot(side, y, 0.36, -0.08, 0.16, 0.075), (205, 212, 215))
        blend(_spot(side, y, 0.35, -0.08, 0.068, 0.07), (35, 38, 45))
        blend(_spot(side, y, 0.37, -0.27, 0.22, 0.045), hair, 0.9)
        blend(_spot(x, y, 0, 0.36, 0.2, 0.055), dark, 0.75)
        blend(_spot(x, y, 0, 0.57, 0.28, 0.085), lips, 0.9)
        blend(_spot(x, y, 0, 0.575, 0.26, 0.022), (40, 40, 70), 0.9)
        blend(_spot(x, y, 0, 0.72, 0.2, 0.04), dark, 0.3)
        blend(_spot(x, y, 0, 0.85, 0.62, 0.45), (base[0] * 0.85, base[1] * 0.82, base[2] * 0.82),
              0.45)
        return np.asarray(colour, np.float32)

    return paint


def _spot(x: NDArray[np.float32], y: NDArray[np.float32], cx: float, cy: float, rx: float,
          ry: float) -> NDArray[np.float32]:
    """Return 1 inside an ellipse, 0 outside, smooth between."""
    radius = np.sqrt(((x - cx) / rx) ** 2 + ((y - cy) / ry) ** 2)
    return np.asarray(np.clip(3 * (1.15 - radius), 0, 1), np.float32)


def nod(time: float, period: float = 37.0) -> float:
    """Return the small angle, in radians, by which a living head is never still."""
    return 0.05 * math.sin(2 * math.pi * time / period) + 0.03 * math.sin(time / 3.1)
