"""Scenes with a face: fast motion, a change of pose, a change of light."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.scenes.head import Head, nod
from vtrack_ros.scenes.interior import office
from vtrack_ros.scenes.motion import keyframes, Motion, stepwise, unrest
from vtrack_ros.scenes.sprite import Placement
from vtrack_ros.scenes.stage import Actor, FilmCamera, Light, Scene, View


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
    red = stepwise((0, 1.0), (30, 1.0), (35, 0.34), (62, 0.34), (65, 1.32), (96, 1.28), (104, 0.8))
    green = stepwise((0, 1.0), (30, 1.0), (35, 0.38), (62, 0.38), (65, 1.1), (96, 1.06),
                     (104, 0.8))
    blue = stepwise((0, 1.0), (30, 1.0), (35, 0.5), (62, 0.5), (65, 0.72), (96, 0.7), (104, 0.86))
    slant = stepwise((0, 0.0), (62, 0.0), (66, 1.0), (96, 1.0), (106, 0.0))

    def colour(time: float) -> tuple[float, float, float]:
        flicker = 1 + 0.2 * math.sin(2.2 * time) * (104 < time < 122)
        return blue(time) * flicker, green(time) * flicker, red(time) * flicker

    def lamp(time: float, at_x: NDArray[np.float64],
             at_y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Brighten what is near a lamp to the right, and darken the rest."""
        near = np.exp(-((at_x - 260) / 130) ** 2 - ((at_y - 90) / 150) ** 2)
        return np.asarray(1 + slant(time) * (0.95 * near - 0.5))

    return Scene(view, backdrop, (body, face), 1, FilmCamera(noise=4), Light(colour, lamp))
