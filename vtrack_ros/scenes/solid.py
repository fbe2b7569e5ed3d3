"""Ellipsoids, lit and rendered from the front, that heads and bodies are made of."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import math

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.frame import Array, Array32
from vtrack_ros.scenes.canvas import Colour, fractal_noise
from vtrack_ros.scenes.sprite import Sprite

#: Points on the unit sphere, shape (n, 3), -> colours, shape (n, 3), or values, shape (n, 1).
Paint = Callable[[Array32], Array32]

_LIGHT = np.array([-0.42, -0.62, 0.66], np.float32) / np.float32(0.998)


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The unit sphere mapped by `axes`, (3, 3), about a centre; z points to the viewer."""

    centre: Array
    axes: Array
    paint: Paint


def ball(x: float, y: float, z: float, rx: float, ry: float, rz: float, paint: Paint) -> Ellipsoid:
    """Return an ellipsoid along the axes, with a centre and three radii."""
    return Ellipsoid(np.array([x, y, z]), np.diag([rx, ry, rz]), paint)


def limb(start: ArrayLike, end: ArrayLike, radius: float, paint: Paint) -> Ellipsoid:
    """Return an ellipsoid that reaches from one joint to another."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(b - a))
    along = (b - a) / length
    side = np.cross(along, [0.0, 0.0, 1.0])
    if np.linalg.norm(side) < 1e-6:
        side = np.array([1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    axes = np.column_stack([radius * side, (length / 2 + 0.55 * radius) * along,
                            radius * np.cross(side, along)])
    return Ellipsoid((a + b) / 2, axes, paint)


def rotation(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Array:
    """Return the rotation matrix of a yaw to the right, then a pitch up, then a roll; radians."""
    cy, sy, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    cr, sr = math.cos(roll), math.sin(roll)
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_z = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_x @ about_y, np.float64)


def render(solids: Sequence[Ellipsoid], turn: Array, unit: float, ambient: float = 0.5) -> Sprite:
    """Return rotated solids in orthographic projection; `ambient` is the ambient light's share."""
    solids = [replace(solid, centre=turn @ solid.centre, axes=turn @ solid.axes)
              for solid in solids]
    extents = [np.linalg.norm(solid.axes[:2], axis=1) for solid in solids]
    lows = np.array([solid.centre[:2] - extent for solid, extent in zip(solids, extents)])
    highs = np.array([solid.centre[:2] + extent for solid, extent in zip(solids, extents)])
    margin = 2 / unit
    left, top = lows.min(axis=0) - margin
    columns, rows = np.ceil((highs.max(axis=0) + margin - (left, top)) * unit).astype(int)
    # Supersampling: rendered at a finer resolution than the sprite's, for smooth outlines.
    area = columns * rows
    fine = 3 if area < 40_000 else 2 if area < 250_000 else 1
    step = 1 / (unit * fine)
    colour = np.zeros((rows * fine, columns * fine, 4), np.float32)
    depth = np.full(colour.shape[:2], -np.inf, np.float32)
    for solid, low, high in zip(solids, lows, highs):
        first = np.maximum(((low - (left, top)) / step).astype(int), 0)
        last = np.ceil((high - (left, top)) / step).astype(int) + 1
        part = (slice(first[1], last[1]), slice(first[0], last[0]))
        _cast(solid, colour[part], depth[part], left + (first[0] + 0.5) * step,
              top + (first[1] + 0.5) * step, step, ambient)
    size = (int(columns), int(rows))
    pixels = cv2.resize(colour, size, interpolation=cv2.INTER_AREA)
    return Sprite(np.asarray(pixels, np.float32), unit, float(left), float(top))


def _cast(solid: Ellipsoid, colour: Array32, depth: Array32, left: float,
          top: float, step: float, ambient: float) -> None:
    """Cast a ray through every pixel of a part of the picture and keep the nearest hits."""
    inverse = np.linalg.inv(solid.axes).astype(np.float32)
    y, x = np.mgrid[0:depth.shape[0], 0:depth.shape[1]].astype(np.float32) * np.float32(step)
    x += np.float32(left - solid.centre[0])
    y += np.float32(top - solid.centre[1])
    start = np.stack([x, y, np.full_like(x, -solid.centre[2])], axis=-1) @ inverse.T
    along = inverse[:, 2]
    a, b = along @ along, start @ along
    discriminant = b * b - a * (np.einsum('ijk,ijk->ij', start, start) - 1)
    reach = (np.sqrt(np.maximum(discriminant, 0)) - b) / a
    hit = (discriminant > 0) & (reach > depth)
    if not hit.any():
        return
    local = start[hit] + reach[hit][:, None] * along
    normal = local @ inverse
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    lit = np.clip(normal @ _LIGHT, 0, 1)
    # Surfaces at grazing angles are darker, as ambient light is partly occluded there.
    rim = 0.72 + 0.28 * np.clip(normal[:, 2], 0, 1)
    shade = (ambient + (1 - ambient) * 1.25 * lit) * rim
    colour[hit, :3] = np.clip(solid.paint(local) * shade[:, None], 0, 255)
    colour[hit, 3] = 1
    depth[hit] = reach[hit]


def surface(rng: np.random.Generator, cell: float, stretch: float = 1.0) -> Paint:
    """Return noise on the sphere with a cell in radians, stretched by a factor along meridians."""
    noise = fractal_noise((256, 512), cell * (256 / math.pi), rng, 0.7)
    if stretch > 1:
        noise = np.asarray(cv2.resize(noise[:int(256 / stretch)], (512, 256)), np.float32)

    def values(points: Array32) -> Array32:
        latitude = np.arcsin(np.clip(points[:, 1], -1, 1)) / math.pi + 0.5
        longitude = np.arctan2(points[:, 0], points[:, 2]) / (2 * math.pi) + 0.5
        rows = np.clip((latitude * 256).astype(int), 0, 255)
        columns = np.clip((longitude * 512).astype(int), 0, 511)
        return np.asarray(noise[rows, columns][:, None], np.float32)

    return values


def plain(colour: Colour, grain: Paint | None = None, contrast: float = 0.1) -> Paint:
    """Return a paint of one colour, whose brightness varies with the grain by `contrast`."""
    base = np.array(colour, np.float32)

    def paint(points: Array32) -> Array32:
        noise = contrast * grain(points) if grain is not None else np.float32(0)
        return np.asarray(np.broadcast_to(base * (1 + noise), (len(points), 3)), np.float32)

    return paint


def striped(one: Colour, other: Colour, count: float, axis: int, grain: Paint,
            share: float = 0.5) -> Paint:
    """Return a paint of stripes across an axis of the unit sphere."""
    first, second = plain(one, grain), plain(other, grain)

    def paint(points: Array32) -> Array32:
        phase = (points[:, axis:axis + 1] * count / 2) % 1
        return np.asarray(np.where(phase < share, first(points), second(points)), np.float32)

    return paint
