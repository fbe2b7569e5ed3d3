"""Faces from any side, and scenes with one: fast motion, a change of pose, a change of light."""

from functools import lru_cache
import math

import numpy as np

from vtrack_ros.frame import Array, Array32
from vtrack_ros.scenes.canvas import Colour
from vtrack_ros.scenes.interior import office
from vtrack_ros.scenes.solid import ball, limb, Paint, plain, render, rotation, striped, surface
from vtrack_ros.scenes.sprite import keyframes, Motion, piecewise_linear, Placement, Sprite, unrest
from vtrack_ros.scenes.stage import Actor, FilmCamera, Light, Scene, View


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

    def paint(points: Array32) -> Array32:
        x, y, z = points[:, 0], points[:, 1], points[:, 2]
        colour = base * (1 + 0.035 * complexion(points))

        def blend(mask: Array32, tone: Colour, strength: float = 1.0) -> None:
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


def _spot(x: Array32, y: Array32, cx: float, cy: float, rx: float, ry: float) -> Array32:
    """Return 1 inside an ellipse, 0 outside, with a linear transition at its rim."""
    radius = np.sqrt(((x - cx) / rx) ** 2 + ((y - cy) / ry) ** 2)
    return np.asarray(np.clip(3 * (1.15 - radius), 0, 1), np.float32)


def nod(time: float, period: float = 37.0) -> float:
    """Return the small angle, in radians, by which a head moves all the time."""
    return 0.05 * math.sin(2 * math.pi * time / period) + 0.03 * math.sin(time / 3.1)


def person(head: Head, x: Motion, y: Motion, size: Motion, yaw: Motion, pitch: Motion,
           roll: Motion) -> tuple[Actor, Actor]:
    """Return a person's body and head, which move together; `size` is half the head's height."""
    def place(time: float, turn: float) -> Placement:
        return Placement(x(time), y(time), size(time), turn)

    body = Actor(lambda time: place(time, 0.25 * roll(time)),
                 lambda time: head.body(0.35 * yaw(time)))
    face = Actor(lambda time: place(time, roll(time)),
                 lambda time: head.head(yaw(time), pitch(time)))
    return body, face


def face_fast(view: View, rng: np.random.Generator) -> Scene:
    """Return a face that darts to the right and quickly back, twice."""
    backdrop = office(view, rng.spawn(1)[0])
    head = Head(15 * view.unit, rng)
    sway_x, sway_y = unrest(rng, 0.5, 11), unrest(rng, 0.9, 14)
    dash = keyframes((0, 31), (7, 30), (17, 98), (22, 99), (31, 30), (35, 29), (45, 99), (50, 98))
    lean = keyframes((0, 0), (7, 0), (12, 0.2), (17, 0), (22, 0), (26, -0.2), (31, 0), (35, 0),
                     (40, 0.2), (45, 0))
    body, face = person(
        head, lambda time: dash(time) + sway_x(time), lambda time: 43 + sway_y(time),
        keyframes((0, 15), (17, 14.2), (31, 15.4), (50, 14.6)),
        lambda time: 1.6 * lean(time) + nod(time), lambda time: nod(time, 23), lean)
    return Scene(view, backdrop, (body, face), 1, FilmCamera(exposure=0.5, noise=4, softness=0.4))


def pose_change(view: View, rng: np.random.Generator) -> Scene:
    """Return a face that turns far to the side, and up, in frames 53 to 62, and back later."""
    backdrop = office(view, rng.spawn(1)[0], size=2.0)
    head = Head(31 * view.unit, rng, hair=(28, 34, 44), shirt=(70, 90, 60), stripe=(80, 104, 74))
    sway_x, sway_y = unrest(rng, 2.5, 30), unrest(rng, 1.6, 26)
    x = keyframes((0, 92), (40, 118), (53, 128), (62, 152), (85, 168), (110, 130), (130, 120))
    y = keyframes((0, 88), (53, 84), (62, 92), (90, 88), (130, 84))
    yaw = keyframes((0, 0.1), (30, -0.3), (53, 0.05), (62, 1.35), (84, 1.15), (96, 0.3),
                    (112, -0.8), (124, -0.1))
    pitch = keyframes((0, 0), (53, 0), (62, 0.3), (84, 0.2), (96, -0.3), (112, 0), (124, 0))
    roll = keyframes((0, 0), (53, 0.03), (58, 0.16), (70, 0.05), (96, -0.12), (130, 0))
    body, face = person(
        head, lambda time: x(time) + sway_x(time), lambda time: y(time) + sway_y(time),
        keyframes((0, 30), (62, 31), (96, 33), (130, 29)), yaw,
        lambda time: pitch(time) + nod(time), roll)
    return Scene(view, backdrop, (body, face), 1, FilmCamera(noise=4))


def light_change(view: View, rng: np.random.Generator) -> Scene:
    """Return a face under lights that go out, change colour, come from one side, and flicker."""
    backdrop = office(view, rng.spawn(1)[0], size=2.5)
    head = Head(32 * view.unit, rng, hair=(40, 70, 104), shirt=(60, 50, 120),
                stripe=(140, 150, 160))
    sway_x, sway_y = unrest(rng, 3.0, 26), unrest(rng, 2.4, 22)
    x = keyframes((0, 90), (28, 130), (40, 168), (62, 210), (80, 196), (100, 140), (130, 110))
    y = keyframes((0, 118), (40, 104), (80, 122), (130, 112))
    turn = keyframes((0, 0.2), (35, -0.3), (62, 0.35), (95, -0.4), (130, 0.1))
    body, face = person(
        head, lambda time: x(time) + sway_x(time), lambda time: y(time) + sway_y(time),
        keyframes((0, 30), (45, 34), (80, 27), (130, 31)), turn, nod,
        lambda time: 0.25 * turn(time))
    red = piecewise_linear((0, 1.0), (30, 1.0), (35, 0.34), (62, 0.34), (65, 1.32), (96, 1.28),
                           (104, 0.8))
    green = piecewise_linear((0, 1.0), (30, 1.0), (35, 0.38), (62, 0.38), (65, 1.1), (96, 1.06),
                             (104, 0.8))
    blue = piecewise_linear((0, 1.0), (30, 1.0), (35, 0.5), (62, 0.5), (65, 0.72), (96, 0.7),
                            (104, 0.86))
    slant = piecewise_linear((0, 0.0), (62, 0.0), (66, 1.0), (96, 1.0), (106, 0.0))

    def colour(time: float) -> tuple[float, float, float]:
        flicker = 1 + 0.2 * math.sin(2.2 * time) * (104 < time < 122)
        return blue(time) * flicker, green(time) * flicker, red(time) * flicker

    def lamp(time: float, at_x: Array, at_y: Array) -> Array:
        """Brighten what is near a lamp to the right, and darken the rest."""
        near = np.exp(-((at_x - 260) / 130) ** 2 - ((at_y - 90) / 150) ** 2)
        return np.asarray(1 + slant(time) * (0.95 * near - 0.5))

    return Scene(view, backdrop, (body, face), 1, FilmCamera(noise=4), Light(colour, lamp))


def light_step(view: View, rng: np.random.Generator) -> Scene:
    """Return a face whose light falls by half in frames 55 to 58, partly covered later on."""
    backdrop = office(view, rng.spawn(1)[0], size=2.5)
    head = Head(32 * view.unit, rng, hair=(40, 70, 104), shirt=(60, 50, 120),
                stripe=(140, 150, 160))
    other = Head(40 * view.unit, rng, skin=(110, 140, 190), hair=(30, 30, 34))
    sway_x, sway_y = unrest(rng, 3.0, 26), unrest(rng, 2.4, 22)
    x = keyframes((0, 90), (40, 150), (70, 196), (100, 150), (130, 120))
    turn = keyframes((0, 0.2), (35, -0.3), (70, 0.3), (100, -0.3), (130, 0.1))
    body, face = person(
        head, lambda time: x(time) + sway_x(time), lambda time: 112 + sway_y(time),
        lambda time: 30.0, turn, nod, lambda time: 0.25 * turn(time))
    passer = person(
        other, keyframes((70, 380), (112, -60)), lambda time: 138.0, lambda time: 38.0,
        lambda time: -0.8, nod, lambda time: 0.0)
    dim = piecewise_linear((0, 1.0), (55, 1.0), (58, 0.5))
    return Scene(view, backdrop, (body, face, *passer), 1, FilmCamera(noise=4),
                 Light(lambda time: (dim(time),) * 3))
