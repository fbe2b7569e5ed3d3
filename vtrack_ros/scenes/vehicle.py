"""Cars and helicopters, from any side."""

from functools import lru_cache
import math

import cv2
import numpy as np

from vtrack_ros.frame import Array32
from vtrack_ros.scenes.canvas import Colour, fractal_noise
from vtrack_ros.scenes.solid import ball, limb, plain, render, rotation, striped, surface
from vtrack_ros.scenes.sprite import Sprite

# The outline of a car from the side, in metres: (along, up); the front is at +2.1.
_BODY = ((2.10, 0.22), (2.14, 0.58), (1.95, 0.80), (0.95, 0.95), (-1.55, 0.97), (-2.05, 0.90),
         (-2.14, 0.55), (-2.10, 0.22))
_CABIN = ((0.95, 0.95), (0.30, 1.40), (-0.95, 1.42), (-1.55, 0.97))
_FRONT_PANE = ((0.72, 0.99), (0.26, 1.35), (-0.22, 1.36), (-0.22, 0.99))
_REAR_PANE = ((-0.3, 0.99), (-0.3, 1.36), (-0.9, 1.36), (-1.3, 1.0))
_GLASS: Colour = (70, 62, 54)
_SUN = np.array([-0.45, 0.75, 0.5]) / np.linalg.norm([-0.45, 0.75, 0.5])

_Point = tuple[float, float, float]
_Face = tuple[list[_Point], Colour]


class Car:
    """A car 1.75 units wide; its origin is on the ground below its middle, `unit` in pixels."""

    def __init__(self, unit: float, rng: np.random.Generator, colour: Colour) -> None:
        self._unit = unit
        self._faces = _car_faces(colour)
        self._reflection = 1 + 0.07 * fractal_noise((256, 256), 60, rng)
        self._render = lru_cache(maxsize=128)(self._rendered)

    def sprite(self, yaw: float, pitch: float) -> Sprite:
        """Return the car; a yaw of 0 shows its front, and a pitch above 0 its roof, in radians."""
        return self._render(round(yaw, 2), round(pitch, 2))

    def _rendered(self, yaw: float, pitch: float) -> Sprite:
        # A camera above looks down on it: the far side rises.
        turn = rotation(yaw, -pitch)
        fine, reach = 3, 2.6
        size = int(2 * reach * self._unit * fine)
        picture = np.zeros((size, size, 3), np.uint8)
        alpha = np.zeros((size, size), np.uint8)
        for corners, colour in self._faces:
            points = np.array([(x, -y, z) for x, y, z in corners]) @ turn.T
            edges = np.diff(points[[0, 1, 2], :], axis=0)
            normal = np.cross(edges[0], edges[1])
            if normal[2] >= 0:
                continue
            world = np.cross(*np.diff(np.array(corners)[:3], axis=0))
            world /= np.linalg.norm(world)
            lit = 0.55 + 0.6 * max(0.0, float(world @ _SUN))
            paint = [min(255.0, c * lit) for c in colour]
            fixed = np.round((points[:, :2] + (reach, 2 * reach - 0.9)) * self._unit * fine * 16)
            cv2.fillPoly(picture, [fixed.astype(np.int32)], paint, cv2.LINE_8, 4)
            cv2.fillPoly(alpha, [fixed.astype(np.int32)], 255, cv2.LINE_8, 4)
        mirror = cv2.resize(self._reflection, (size, size))
        colour_ = np.clip(picture * mirror[..., None], 0, 255) * (alpha[..., None] > 0)
        full = np.dstack([colour_, alpha / 255]).astype(np.float32)
        small = cv2.resize(full, (size // fine, size // fine), interpolation=cv2.INTER_AREA)
        unit = self._unit * fine * (size // fine) / size
        return Sprite(np.asarray(small, np.float32), unit, -reach, -(2 * reach - 0.9))


def _car_faces(colour: Colour) -> list[_Face]:
    """Return the car's faces in the order of painting; normals point outward (see `_face`)."""
    dark: Colour = (28, 28, 30)
    faces: list[_Face] = []
    for end in (-1, 1):
        for side in (-1, 1):
            wheel = _upright(0.58 * side, 0.82 * side, 0.0, 0.5, 1.6 * end)
            faces.append(_face(wheel, (0, 0, end), dark))
    for side in (-1, 1):
        faces.append(_face([(0.87 * side, y, z) for z, y in _BODY], (side, 0, 0), colour))
        for z in (1.3, -1.3):
            for radius, x, paint in ((0.34, 0.875, dark), (0.19, 0.88, (150, 150, 152))):
                rim = [(x * side, 0.31 + radius * math.sin(a), z + radius * math.cos(a))
                       for a in np.linspace(0, 2 * math.pi, 20, endpoint=False)]
                faces.append(_face(rim, (side, 0, 0), paint))
    faces += _across(_BODY, colour, colour)
    for side in (-1, 1):
        for pane, paint in ((_CABIN, colour), (_FRONT_PANE, _GLASS), (_REAR_PANE, _GLASS)):
            corners = [((0.84 if y < 1.2 else 0.66) * side, y, z) for z, y in pane]
            faces.append(_face(corners, (side, 0.4, 0), paint))
    faces += _across(_CABIN, colour, _GLASS)
    for end in (-1, 1):
        lamp: Colour = (225, 235, 240) if end > 0 else (40, 40, 190)
        for x0, y0, x1, y1, paint in (
                (-0.84, 0.24, 0.84, 0.34, dark), (-0.27, 0.33, 0.27, 0.45, (205, 215, 215)),
                (-0.45, 0.48, 0.45, 0.62, (35, 35, 38) if end > 0 else colour),
                (-0.82, 0.5, -0.52, 0.66, lamp), (0.52, 0.5, 0.82, 0.66, lamp)):
            faces.append(_face(_upright(x0, x1, y0, y1, 2.15 * end), (0, 0, end), paint))
    return faces


def _face(corners: list[_Point], outward: _Point, colour: Colour) -> _Face:
    """Return a face, its corners ordered so that its normal points outward."""
    normal = np.cross(*np.diff(np.array(corners)[:3], axis=0))
    return (corners if normal @ np.array(outward) > 0 else corners[::-1]), colour


def _upright(x0: float, x1: float, y0: float, y1: float, z: float) -> list[_Point]:
    return [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]


def _across(profile: tuple[tuple[float, float], ...], level: Colour, steep: Colour) -> list[_Face]:
    """Return the faces between the two sides of an outline, in the colours `level` or `steep`."""
    faces = []
    for (z0, y0), (z1, y1) in zip(profile, profile[1:]):
        wide0, wide1 = (0.66 if y > 1.2 else 0.855 for y in (y0, y1))
        corners = [(-wide0, y0, z0), (wide0, y0, z0), (wide1, y1, z1), (-wide1, y1, z1)]
        faces.append(_face(corners, (0, z0 - z1, y1 - y0), level if abs(y1 - y0) < 0.1 else steep))
    return faces


class Helicopter:
    """A helicopter about 5 units long, its origin in the cabin; the rotor is another sprite."""

    def __init__(self, unit: float, rng: np.random.Generator) -> None:
        self._unit = unit
        skin = surface(rng, 0.6)
        hull = striped((70, 66, 165), (205, 210, 212), 3.4, 1, skin, 0.6)
        tail = plain((76, 72, 160), skin)
        metal = plain((70, 72, 76))
        self._parts = [
            ball(0, 0, 0, 0.62, 0.66, 1.35, hull),
            ball(0, -0.08, 0.62, 0.55, 0.5, 0.76, plain((96, 78, 60), skin, 0.25)),
            ball(0, -0.52, -0.35, 0.36, 0.3, 0.8, tail),
            limb((0, -0.12, -1.0), (0, -0.42, -3.5), 0.19, tail),
            ball(0, -0.75, -3.5, 0.08, 0.62, 0.3, plain((200, 205, 208), skin)),
            ball(0, -0.38, -3.0, 0.6, 0.05, 0.2, tail),
            limb((0, -0.6, -0.1), (0, -1.02, -0.1), 0.12, metal),
            *(limb((0.55 * s, 0.98, -0.9), (0.55 * s, 0.98, 1.1), 0.07, metal) for s in (-1, 1)),
            *(limb((0.3 * s, 0.5, z), (0.55 * s, 0.98, z), 0.06, metal)
              for s in (-1, 1) for z in (-0.5, 0.6)),
        ]
        self._render = lru_cache(maxsize=64)(self._rendered)

    def sprite(self, yaw: float, pitch: float, roll: float) -> Sprite:
        """Return the hull; a yaw of 0 faces the viewer, and one of pi / 2 right; radians."""
        return self._render(round(yaw, 2), round(pitch, 2), round(roll, 2))

    def _rendered(self, yaw: float, pitch: float, roll: float) -> Sprite:
        turn = rotation(0, pitch, roll) @ rotation(yaw)
        return render(self._parts, turn, self._unit, 0.45)

    def rotor(self, time: float, pitch: float) -> Sprite:
        """Return the blurred rotor disc at a time, foreshortened by the pitch in radians."""
        radius, unit = 3.0, self._unit
        size = int(2 * radius * unit)
        y, x = (np.mgrid[0:size, 0:size].astype(np.float32) + 0.5) / unit - radius
        flat = 0.1 + abs(math.sin(pitch))
        distance = np.hypot(x, y / flat)
        alpha = 0.2 * (distance < radius)
        turned = np.arctan2(y / flat, x) - 2.3 * time
        blade = np.abs((turned + math.pi / 4) % (math.pi / 2) - math.pi / 4) * distance < 0.22
        alpha = np.where(blade & (distance < radius), 0.42, alpha)
        pixels: Array32 = np.zeros((size, size, 4), np.float32)
        pixels[..., 3] = alpha
        pixels[..., :3] = 58 * alpha[..., None]
        return Sprite(pixels, unit, -radius, -radius - 1.05)
