"""People who stand, walk and run."""

from functools import lru_cache
import math

import numpy as np

from vtrack_ros.frame import Array
from vtrack_ros.scenes.canvas import Colour
from vtrack_ros.scenes.outdoor import Ground
from vtrack_ros.scenes.solid import (
    ball, Ellipsoid, limb, plain, render, rotation, striped, surface)
from vtrack_ros.scenes.sprite import Motion, Placement, Sprite
from vtrack_ros.scenes.stage import Actor

# Number of phases of a gait cycle (two steps) that are rendered.
_PHASES = 32


class Person:
    """A person 100 units tall, the origin on the ground between the feet; `unit` in pixels."""

    def __init__(self, unit: float, rng: np.random.Generator, *, shirt: Colour, trousers: Colour,
                 stripe: Colour | None = None, upright: bool = False, shorts: bool = False,
                 socks: Colour = (200, 200, 200), sleeves: bool = True,
                 hair: Colour = (35, 45, 60)) -> None:
        self._unit, self._shorts, self._sleeves = unit, shorts, sleeves
        cloth, denim, strand = surface(rng, 0.6), surface(rng, 0.5), surface(rng, 0.3, 3)
        self._shirt, self._plain_shirt = plain(shirt, cloth, 0.1), plain(shirt)
        if stripe is not None:
            self._shirt = striped(shirt, stripe, *((5, 0) if upright else (6, 1)), cloth)
        self._trousers = plain(trousers, denim, 0.12)
        self._skin = plain((125, 155, 200), denim, 0.04)
        self._hair = plain(hair, strand, 0.35)
        self._socks = plain(socks, cloth, 0.06)
        self._shoes = plain((40, 40, 45))
        self._render = lru_cache(maxsize=256)(self._rendered)

    def sprite(self, phase: float = 0.0, yaw: float = 0.0, stride: float = 1.0) -> Sprite:
        """Return the person; phase 1 is a gait cycle (two steps), yaw 0 frontal, stride 0 rest."""
        return self._render(round(phase * _PHASES) % _PHASES, round(yaw, 2), round(stride, 1))

    def _rendered(self, phase: int, yaw: float, stride: float) -> Sprite:
        parts = self._parts(2 * math.pi * phase / _PHASES, stride)
        return render(parts, rotation(yaw), self._unit, 0.55)

    def _parts(self, phase: float, stride: float) -> list[Ellipsoid]:
        rise = 1.2 * stride * math.cos(2 * phase)
        lean = 3.0 * max(0.0, stride - 0.8)
        head_z = 1.0 + 1.5 * lean
        eyes = plain((45, 50, 60))
        parts = [
            ball(0, -92.6 + rise, head_z, 5.5, 7.4, 6.2, self._skin),
            ball(0, -94.8 + rise, head_z - 1.5, 5.9, 6.1, 6.1, self._hair),
            ball(-2.1, -93.2 + rise, head_z + 5.6, 0.9, 0.5, 0.6, eyes),
            ball(2.1, -93.2 + rise, head_z + 5.6, 0.9, 0.5, 0.6, eyes),
            limb((0, -80 + rise, 0.5 * lean), (0, -88 + rise, head_z - 1), 3.1, self._skin),
            ball(0, -69 + rise, 0.4 * lean, 11.5, 15.5, 8.4, self._shirt),
            limb((-8, -80 + rise, lean), (8, -80 + rise, lean), 4.6, self._shirt),
            ball(0, -54.5 + rise, 0, 9.6, 7.5, 8.0, self._trousers),
        ]
        for side in (-1, 1):
            swing = phase if side > 0 else phase + math.pi
            parts += self._leg(side, swing, stride, rise)
            parts += self._arm(side, swing + math.pi, stride, rise, lean)
        return parts

    def _leg(self, side: int, swing: float, stride: float, rise: float) -> list[Ellipsoid]:
        thigh = 0.38 * stride * math.sin(swing)
        bend = stride * (0.12 + 0.55 * max(0.0, math.cos(swing + 0.4)))
        hip = np.array([5.0 * side, -52 + rise, 0])
        knee = hip + 25 * np.array([0, math.cos(thigh), math.sin(thigh)])
        shank = thigh - bend
        ankle = knee + 24 * np.array([0, math.cos(shank), math.sin(shank)])
        toe = ankle + np.array([1.0 * side, 1.8, 7.5])
        upper = self._skin if self._shorts else self._trousers
        lower = self._socks if self._shorts else self._trousers
        parts = [limb(hip, knee, 5.4, upper), limb(knee, ankle, 3.9, lower),
                 limb(ankle, toe, 2.7, self._shoes)]
        if self._shorts:
            parts.append(limb(hip, hip + 0.62 * (knee - hip), 6.6, self._trousers))
            parts.append(ball(knee[0], knee[1], knee[2], 3.9, 4.2, 4.0, self._skin))
        return parts

    def _arm(self, side: int, swing: float, stride: float, rise: float,
             lean: float) -> list[Ellipsoid]:
        upper = 0.34 * stride * math.sin(swing)
        bend = 0.25 + 0.75 * max(0.0, stride - 0.9)
        shoulder = np.array([11.5 * side, -79 + rise, lean])
        elbow = shoulder + 16.5 * np.array([0.12 * side, math.cos(upper), math.sin(upper)])
        fore = upper + bend
        wrist = elbow + 14 * np.array([0, math.cos(fore), math.sin(fore)])
        sleeve = self._shirt if self._sleeves else self._skin
        plain_sleeve = self._plain_shirt if self._sleeves else self._skin
        parts = [limb(shoulder, elbow, 3.3, sleeve), limb(elbow, wrist, 2.7, plain_sleeve),
                 ball(wrist[0], wrist[1] + 1.5, wrist[2] + 0.5, 2.2, 2.8, 2.4, self._skin)]
        if not self._sleeves:
            parts.append(limb(shoulder, shoulder + 0.5 * (elbow - shoulder), 4.0, self._shirt))
        return parts


def shadow(width: float, height: float, unit: float, strength: float = 0.5) -> Sprite:
    """Return a soft elliptical shadow, of a width and a height, centred at the origin."""
    columns, rows = max(8, int(width * unit * 1.6)), max(6, int(height * unit * 1.6))
    y, x = np.mgrid[0:rows, 0:columns]
    radius = np.hypot((x + 0.5) / columns * 2 - 1, (y + 0.5) / rows * 2 - 1)
    pixels = np.zeros((rows, columns, 4), np.float32)
    pixels[..., 3] = strength * np.clip(1 - radius, 0, 1) ** 1.2
    return Sprite(pixels, unit, -columns / unit / 2, -rows / unit / 2)


def walker(person: Person, ground: Ground, x: Motion, y: Motion, duration: float, *,
           stride: float = 1.0, phase: float = 0.12) -> tuple[Actor, Actor]:
    """
    Return a person's shadow and the person, walking with the feet at x(t), y(t), t in frames.

    `stride` is as in `Person.sprite`, `phase` is that of the gait cycle at time 0.
    """
    times = np.arange(-4.0, duration + 4.5, 0.5)
    xs, ys = np.array([x(t) for t in times]), np.array([y(t) for t in times])
    sizes = np.array([ground.size_at(value) for value in ys])
    # Distances towards the camera are foreshortened in y, by about this factor.
    toward = np.diff(ys) * 3.5
    paces = np.hypot(np.diff(xs), toward) / sizes[1:] / 115
    steps = np.concatenate([[0.0], np.cumsum(paces)]) / stride
    steps += phase - np.interp(0.0, times, steps)
    speed = np.gradient(steps, times)
    smooth = np.ones(9) / 9
    heading_x = np.convolve(np.pad(np.gradient(xs), 4, mode='edge'), smooth, 'valid')
    heading_y = np.convolve(np.pad(3.5 * np.gradient(ys), 4, mode='edge'), smooth, 'valid')
    yaws = np.unwrap(np.arctan2(heading_x, heading_y))
    still = speed < 0.004
    strides = np.where(still, 0.0, stride)

    def at(table: Array, time: float) -> float:
        return float(np.interp(time, times, table))

    def place(time: float) -> Placement:
        return Placement(at(xs, time), at(ys, time), at(sizes, time))

    def look(time: float) -> tuple[float, float, float]:
        nearest = int(np.clip(round((time - times[0]) * 2), 0, len(times) - 1))
        return at(steps, time), at(yaws, time), float(strides[nearest])

    dark = shadow(34, 9, 1.0)
    return (Actor(place, lambda time: dark), Actor(place, lambda time: person.sprite(*look(time))))
