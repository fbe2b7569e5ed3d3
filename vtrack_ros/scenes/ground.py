"""Ground that runs away from the camera, and people who walk on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.scenes.canvas import Canvas
from vtrack_ros.scenes.figure import Person, shadow
from vtrack_ros.scenes.motion import Motion
from vtrack_ros.scenes.sprite import Placement
from vtrack_ros.scenes.stage import Actor
from vtrack_ros.scenes.texture import fractal_noise


@dataclass(frozen=True)
class Ground:
    """
    A level ground in perspective, up to the y of the horizon; x of the vanishing point: `middle`.

    `scale` is how high a person 100 units tall appears per unit below the horizon, in hundreds.
    """

    horizon: float
    scale: float
    middle: float

    def size_at(self, y: float) -> float:
        """Return how large things are that stand at y."""
        return self.scale * max(1.0, y - self.horizon)

    def plane(self, canvas: Canvas) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the ground's coordinates (across, away), in units of a thing of size 1."""
        below = np.maximum(canvas.rows() - self.horizon, 0.4).astype(np.float64)
        size = self.scale * below
        across = (canvas.columns() - self.middle) / size
        away = np.broadcast_to(1 / self.scale ** 2 / below * 2, across.shape)
        return across, away


def tiles(canvas: Canvas, ground: Ground, edge: float, contrast: float,
          rng: np.random.Generator) -> NDArray[np.float32]:
    """Return the gain of square tiles of an edge on the ground; they fade in the distance."""
    across, away = ground.plane(canvas)
    column, row = np.floor(across / edge).astype(int), np.floor(away / edge).astype(int)
    table = rng.normal(0, 1, (61, 67))
    gain = table[row % 61, column % 67]
    joint = np.minimum(across % edge, edge - across % edge) < 0.035 * edge
    joint |= np.minimum(away % edge, edge - away % edge) < 0.05 * edge
    seen = np.clip((canvas.rows() - ground.horizon) * ground.scale * edge / 8, 0, 1)
    return np.asarray(1 + contrast * seen * (gain - 2.2 * joint), np.float32)


def speckle(canvas: Canvas, ground: Ground, cell: float, contrast: float,
            rng: np.random.Generator) -> NDArray[np.float32]:
    """Return the gain of irregular ground, such as grass or asphalt, in perspective."""
    across, away = ground.plane(canvas)
    noise = fractal_noise((512, 512), 64, rng, 0.75)
    u, v = np.abs(across / cell * 64 + 300), np.abs(away / cell * 64)
    # There and back again, so that no seam shows.
    columns, rows = (np.abs(w.astype(int) % 1022 - 511) for w in (u, v))
    far = noise[rows, columns]
    flat = fractal_noise(canvas.shape, 3 * canvas.unit, rng, 0.8)
    return np.asarray(1 + contrast * (0.7 * far + 0.6 * flat), np.float32)


def walker(person: Person, ground: Ground, x: Motion, y: Motion, duration: float, *,
           stride: float = 1.0, phase: float = 0.12) -> tuple[Actor, Actor]:
    """
    Return a person's shadow and the person, walking where x(t) and y(t) put the feet, in frames.

    `stride` is as in `Person.sprite`, `phase` where in a double step they are at time 0.
    """
    times = np.arange(-4.0, duration + 4.5, 0.5)
    xs, ys = np.array([x(t) for t in times]), np.array([y(t) for t in times])
    sizes = np.array([ground.size_at(value) for value in ys])
    # Ways towards the camera look shorter than they are.
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

    def at(table: NDArray[np.float64], time: float) -> float:
        return float(np.interp(time, times, table))

    def place(time: float) -> Placement:
        return Placement(at(xs, time), at(ys, time), at(sizes, time))

    def look(time: float) -> tuple[float, float, float]:
        nearest = int(np.clip(round((time - times[0]) * 2), 0, len(times) - 1))
        return at(steps, time), at(yaws, time), float(strides[nearest])

    dark = shadow(34, 9, 1.0)
    return (Actor(place, lambda time: dark),
            Actor(place, lambda time: person.sprite(*look(time))))
