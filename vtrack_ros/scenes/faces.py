"""Scenes with a face: the first paper's fast one, and the second's change of pose."""

from __future__ import annotations

import numpy as np

from vtrack_ros.scenes.head import Head, nod
from vtrack_ros.scenes.interior import office
from vtrack_ros.scenes.motion import keyframes, Motion, unrest
from vtrack_ros.scenes.sprite import Placement
from vtrack_ros.scenes.stage import Actor, Camera, Scene, View


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
    backdrop = office(view, rng)
    head = Head(15 * view.unit, rng)
    sway_x, sway_y = unrest(rng, 0.5, 11), unrest(rng, 0.9, 14)
    dash = keyframes((0, 31), (7, 30), (17, 98), (22, 99), (31, 30), (35, 29), (45, 99), (50, 98))
    lean = keyframes((0, 0), (7, 0), (12, 0.2), (17, 0), (22, 0), (26, -0.2), (31, 0), (35, 0),
                     (40, 0.2), (45, 0))
    body, face = person(
        head, lambda time: dash(time) + sway_x(time), lambda time: 43 + sway_y(time),
        keyframes((0, 15), (17, 14.2), (31, 15.4), (50, 14.6)),
        lambda time: 1.6 * lean(time) + nod(time), lambda time: nod(time, 23), lean)
    return Scene(view, backdrop, (body, face), 1, Camera(exposure=0.5, noise=4, softness=0.4))
