"""Scenes with vehicles: the fourth paper's car and helicopter."""

import math

import numpy as np

from vtrack_ros.scenes import outdoor
from vtrack_ros.scenes.canvas import Canvas, masonry
from vtrack_ros.scenes.figure import shadow
from vtrack_ros.scenes.outdoor import Ground
from vtrack_ros.scenes.sprite import keyframes, Motion, Placement, Sprite, unrest
from vtrack_ros.scenes.stage import Actor, FilmCamera, Scene, View
from vtrack_ros.scenes.vehicle import Car, Helicopter

# World units per metre, at size factor 1.
_METRE = 24.0


def _driven(car: Car, ground: Ground, x: Motion, y: Motion, yaw: Motion) -> tuple[Actor, Actor]:
    """Return a car's shadow and the car, on the ground where x(t) and y(t) put it."""
    def place(time: float) -> Placement:
        return Placement(x(time), y(time), _METRE * ground.size_at(y(time)))

    dark = shadow(5.4, 1.3, 20.0, 0.75)
    return (Actor(place, lambda time: dark),
            Actor(place, lambda time: car.sprite(yaw(time), 0.06 + 0.0011 * (y(time) - 84))))


def _post(unit: float, height: float) -> Sprite:
    """Return a lamp post that stands on its origin."""
    canvas = Canvas(-4, -height, 22, 0, unit)
    alpha = Canvas(-4, -height, 22, 0, unit, (0, 0, 0))
    for picture, colour in ((canvas, (84, 92, 92)), (alpha, (1, 1, 1))):
        picture.rectangle(-2.4, -height + 4, 2.4, 0, colour)
        picture.rectangle(-3.6, -26, 3.6, 0, colour)
        picture.line([(0, -height + 5), (9, -height + 2), (20, -height + 3)], 2.6, colour)
    canvas.rectangle(0.6, -height + 4, 2.4, 0, (52, 58, 60), 0.7)
    mask = np.clip(alpha.picture[..., :1], 0, 1)
    return Sprite(np.concatenate([canvas.picture * mask, mask], axis=2), unit, -4, -height)


def car_approach(view: View, rng: np.random.Generator) -> Scene:
    """Return a car that comes near and grows fivefold, behind a lamp post, among similar cars."""
    ground = Ground(84, 0.0125, 140)
    backdrop = outdoor.road(view, ground, rng.spawn(1)[0])
    near = 2.1 * _METRE * view.unit
    target = Car(near, rng, (150, 122, 104))
    alike = [Car(near / 2, rng, colour) for colour in (
        (150, 122, 104), (140, 116, 106), (60, 62, 150), (156, 128, 108), (170, 176, 178))]
    x = keyframes((0, 158), (60, 168), (120, 198), (165, 244), (200, 286))
    y = keyframes((0, 122), (60, 134), (120, 160), (165, 196), (200, 240))
    yaw = keyframes((0, 0.22), (70, 0.3), (130, 0.42), (165, 0.62), (200, 0.5))
    shade, car = _driven(target, ground, x, y, yaw)
    parked: list[Actor] = []
    for index, (place_x, place_y) in enumerate(((118, 108), (104, 121), (72, 150))):
        parked += _driven(alike[index], ground, keyframes((0, place_x), (1, place_x)),
                          keyframes((0, place_y), (1, place_y)), lambda time: 0.12)
    follower = _driven(alike[3], ground, keyframes((0, 148), (70, 150), (200, 186)),
                       keyframes((0, 100), (70, 106), (200, 150)), lambda time: 0.25)
    leaving = _driven(alike[4], ground, keyframes((0, 20), (90, 118), (200, 134)),
                      keyframes((0, 236), (90, 132), (200, 104)), lambda time: math.pi + 0.3)
    post = _post(view.unit, 190)
    shake_x, shake_y = unrest(rng, 0.6, 28), unrest(rng, 0.6, 22)
    actors = (*follower, *parked, *leaving, shade, car,
              Actor(lambda time: Placement(208, 262), lambda time: post))
    return Scene(view, backdrop, actors, len(actors) - 2,
                 FilmCamera(lambda time: Placement(shake_x(time), shake_y(time)), noise=4))


def _chimney(view: View, width: float, height: float, rng: np.random.Generator) -> Sprite:
    """Return a factory chimney that stands on its origin."""
    canvas = Canvas(0, 0, width, height, view.unit)
    canvas.picture[:] = masonry(canvas.shape, view.unit, rng, (92, 104, 150), (6, 3))
    canvas.gain(1.15 - 0.55 * (canvas.columns() / width))
    for row in (4.0, 16.0):
        canvas.rectangle(0, row, width, row + 5, (205, 210, 215), 0.8)
    return canvas.upright()


def helicopter(view: View, rng: np.random.Generator) -> Scene:
    """Return a helicopter over a town: near and far, from all sides, covered at frame 281."""
    backdrop = outdoor.valley(view, rng.spawn(1)[0], 620)
    machine = Helicopter(26 * view.unit, rng)
    drift_x, drift_y = unrest(rng, 4, 70), unrest(rng, 3, 50)
    x = keyframes((0, 130), (60, 160), (200, 300), (268, 372), (296, 520), (330, 556), (430, 660),
                  (540, 720), (600, 690), (700, 570), (780, 500))
    y = keyframes((0, 84), (80, 70), (180, 120), (268, 150), (300, 148), (380, 96), (470, 120),
                  (560, 172), (640, 140), (720, 84), (780, 96))
    size = keyframes((0, 17), (90, 13), (200, 10), (268, 8.5), (300, 9), (390, 15), (470, 25),
                     (540, 22), (620, 12), (720, 9), (780, 16))
    yaw = keyframes((0, 1.3), (120, 1.9), (220, 1.4), (300, 1.6), (400, 0.9), (480, 0.2),
                    (560, -0.6), (620, -1.4), (700, -1.7), (780, -0.9))
    roll = keyframes((0, 0.05), (262, 0.05), (275, 0.28), (300, -0.1), (330, 0), (480, -0.12),
                     (600, 0.14), (650, -0.25), (700, -0.06), (780, 0.1))
    pitch = keyframes((0, 0.1), (200, 0.0), (300, 0.1), (470, 0.25), (640, 0.05), (780, 0.15))

    def place(time: float, turn: float = 0.0) -> Placement:
        return Placement(x(time) + drift_x(time), y(time) + drift_y(time), size(time), turn)

    hull = Actor(place, lambda time: machine.sprite(yaw(time), pitch(time), roll(time)))
    rotor = Actor(lambda time: place(time, roll(time)),
                  lambda time: machine.rotor(time, pitch(time)))
    stack = _chimney(view, 26, 190, rng.spawn(1)[0])
    middle = place(281.5).x
    # The camera follows with a delay (7 frames in x, 9 in y), and shakes.
    late_x = keyframes(*((float(t), x(max(0, t - 7)) - 160) for t in range(0, 790, 12)))
    late_y = keyframes(*((float(t), 0.35 * (y(max(0, t - 9)) - 110)) for t in range(0, 790, 12)))
    shake_x, shake_y = unrest(rng, 5, 45), unrest(rng, 4, 36)
    camera = FilmCamera(lambda time: Placement(
        min(max(late_x(time), 0), 610) + shake_x(time), late_y(time) + shake_y(time)), noise=4)
    return Scene(view, backdrop, (
        rotor, hull, Actor(lambda time: Placement(middle, 262), lambda time: stack)), 1, camera)
