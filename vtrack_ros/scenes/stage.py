"""A scene and its rendering: backdrop, actors, camera and light become frames."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Array, Array32
from vtrack_ros.geometry import Box
from vtrack_ros.scenes.canvas import Canvas
from vtrack_ros.scenes.sprite import Affine, compose, mapped_bounds, Placement, Sprite

#: Visible share of the target below which it counts as absent.
VISIBLE = 0.1


@dataclass(frozen=True)
class View:
    """
    The part of the world in a frame of width x height pixels.

    It is at least (0, 0) to (base_width, base_height); more is seen on two opposite sides if the
    frame's aspect ratio is another one.
    """

    width: int
    height: int
    base_width: float
    base_height: float

    @property
    def unit(self) -> float:
        """Return the number of pixels per world unit."""
        return min(self.width / self.base_width, self.height / self.base_height)

    @property
    def left(self) -> float:
        """Return the x of the left edge; negative where the frame is wider than the base."""
        return (self.base_width - self.width / self.unit) / 2

    @property
    def right(self) -> float:
        """Return the x of the right edge."""
        return self.base_width - self.left

    @property
    def top(self) -> float:
        """Return the y of the upper edge; negative where the frame is higher than the base."""
        return (self.base_height - self.height / self.unit) / 2

    @property
    def bottom(self) -> float:
        """Return the y of the lower edge."""
        return self.base_height - self.top

    def canvas(self, margin: float) -> Canvas:
        """Return a canvas for a backdrop that reaches beyond the view by a margin."""
        return Canvas(self.left - margin, self.top - margin, self.right + margin,
                      self.bottom + margin, self.unit)


@dataclass(frozen=True)
class Actor:
    """An object before the backdrop; its placement and sprite depend on the time in frames."""

    placement: Callable[[float], Placement]
    sprite: Callable[[float], Sprite]


@dataclass(frozen=True)
class FilmCamera:
    """
    The camera; its motion is the view's offset, rotation and scale (above 1 it sees more).

    `exposure` is in frames. `noise` is roughly the noise's standard deviation at full brightness,
    in levels of 0 to 255; in the dark it's a third of that. `softness` is the standard deviation
    of the lens's blur in pixels, at one pixel per world unit.
    """

    motion: Callable[[float], Placement] = field(default=lambda time: Placement(0, 0))
    exposure: float = 0.5
    noise: float = 3.0
    softness: float = 0.35


@dataclass(frozen=True)
class Light:
    """Gains at a time: `colour` for (blue, green, red), and `field` at each place (x, y)."""

    colour: Callable[[float], tuple[float, float, float]] = field(
        default=lambda time: (1.0, 1.0, 1.0))
    field: Callable[[float, Array, Array], Array] | None = None


@dataclass(frozen=True)
class Scene:
    """All that's filmed: actors from back to front; `target` is the target's index in them."""

    view: View
    backdrop: Canvas
    actors: tuple[Actor, ...]
    target: int
    camera: FilmCamera = FilmCamera()
    light: Light = Light()


@dataclass(frozen=True)
class SceneFrame:
    """
    A rendered frame, uint8, shape (H, W, 3), and the truth about it.

    `outline` is the bounding box of the whole target in the middle of the exposure, hidden or not.
    `visibility` is the visible share of the target; `truth` is the outline, or None while less
    than a tenth of the target is visible.
    """

    frame: NDArray[np.uint8]
    truth: Box | None
    index: int
    visibility: float
    outline: Box


def film(scene: Scene, times: Iterator[float], rng: np.random.Generator) -> Iterator[SceneFrame]:
    """Render the scene at some times, in frames; the generator makes the sensor noise."""
    for index, time in enumerate(times):
        frame = _developed(scene, _exposed(scene, time), time, rng)
        box, visibility = _truth(scene, time)
        yield SceneFrame(frame, box if visibility >= VISIBLE else None, index, visibility, box)


def _world_to_image(scene: Scene, time: float) -> Affine:
    view, look = scene.view, scene.camera.motion(time)
    unit = view.unit / look.scale
    cos, sin = unit * math.cos(look.angle), unit * math.sin(look.angle)
    linear = np.array([[cos, sin], [-sin, cos]])
    looked_at = np.array([view.base_width / 2 + look.x, view.base_height / 2 + look.y])
    middle = np.array([view.width / 2, view.height / 2])
    return np.column_stack([linear, middle - linear @ looked_at])


def _exposed(scene: Scene, time: float) -> Array32:
    """Return the picture of backdrop and actors, averaged over the exposure (motion blur)."""
    half = scene.camera.exposure / 2
    picture = np.zeros((scene.view.height, scene.view.width, 3), np.float32)
    matrices = _exposure(lambda when: _world_to_image(scene, when), time, half)
    for matrix in matrices:
        picture += _backdrop(scene, matrix)
    picture /= len(matrices)
    for actor in scene.actors:
        _lay(picture, scene, actor, time, half)
    return picture


def _exposure(matrix: Callable[[float], Affine], time: float, half: float) -> list[Affine]:
    """Return the maps at moments of the exposure, less than a pixel apart, but 24 at most."""
    before, after = matrix(time - half), matrix(time + half)
    probes = np.array([[0.0, 0.0, 1.0], [80.0, 0.0, 1.0], [0.0, 80.0, 1.0]])
    steps = min(24, 2 + int(1.3 * float(np.abs((after - before) @ probes.T).max())))
    moments = np.linspace(time - half, time + half, steps) if steps > 2 else [time]
    return [matrix(moment) for moment in moments]


def _backdrop(scene: Scene, world_to_image: Affine) -> Array32:
    canvas = scene.backdrop
    to_world = np.array([[1 / canvas.unit, 0, canvas.left + 0.5 / canvas.unit],
                         [0, 1 / canvas.unit, canvas.top + 0.5 / canvas.unit]])
    to_pixels = np.array([[1.0, 0, -0.5], [0, 1.0, -0.5]])
    full = compose(to_pixels, compose(world_to_image, to_world))
    size = (scene.view.width, scene.view.height)
    return np.asarray(cv2.warpAffine(canvas.picture, full, size, flags=cv2.INTER_LINEAR,
                                     borderMode=cv2.BORDER_REFLECT), np.float32)


def _lay(picture: Array32, scene: Scene, actor: Actor, time: float, half: float) -> None:
    sprite = actor.sprite(time)
    matrices = _exposure(lambda when: compose(
        _world_to_image(scene, when), actor.placement(when).matrix()), time, half)
    bounds = np.array([sprite.bounds(each) for each in matrices])
    height, width = picture.shape[:2]
    left, top = max(0, bounds[:, 0].min()), max(0, bounds[:, 1].min())
    right, bottom = min(width, bounds[:, 2].max()), min(height, bounds[:, 3].max())
    if right <= left or bottom <= top:
        return
    layer = np.zeros((bottom - top, right - left, 4), np.float32)
    for each in matrices:
        layer += sprite.warped(each, (left, top, right, bottom))
    layer /= len(matrices)
    part = picture[top:bottom, left:right]
    part *= 1 - layer[..., 3:]
    part += layer[..., :3]


def _developed(scene: Scene, picture: Array32, time: float,
               rng: np.random.Generator) -> NDArray[np.uint8]:
    """Apply light, lens and sensor."""
    view = scene.view
    picture *= np.array(scene.light.colour(time), np.float32)
    if scene.light.field is not None:
        columns, rows = max(2, view.width // 4), max(2, view.height // 4)
        x = np.linspace(view.left, view.right, columns)[None, :]
        y = np.linspace(view.top, view.bottom, rows)[:, None]
        gain = np.broadcast_to(scene.light.field(time, x, y), (rows, columns))
        picture *= cv2.resize(gain.astype(np.float32), (view.width, view.height),
                              interpolation=cv2.INTER_LINEAR)[..., None]
    # The blur in pixels grows with the resolution, but less than in proportion.
    sigma = scene.camera.softness * view.unit ** 0.4
    if sigma > 0.25:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.float32)
    picture = np.clip(picture, 0, 255)
    grain = rng.standard_normal(picture.shape, np.float32)
    # Noise correlated between neighbouring pixels and colours, as after demosaicing, compression.
    grain = 0.75 * grain.mean(axis=2, keepdims=True) * np.float32(math.sqrt(3)) + 0.65 * grain
    grain = np.asarray(cv2.GaussianBlur(grain, (0, 0), 0.55), np.float32) * np.float32(1.7)
    spread = scene.camera.noise * np.sqrt(0.1 + 0.9 * picture / 255)
    return np.asarray(np.clip(np.rint(picture + spread * grain), 0, 255), np.uint8)


def _truth(scene: Scene, time: float) -> tuple[Box, float]:
    camera = _world_to_image(scene, time)
    target = scene.actors[scene.target]
    sprite = target.sprite(time)
    matrix = compose(camera, target.placement(time).matrix())
    box = Box(*mapped_bounds(sprite.outline, matrix))
    bounds = sprite.bounds(matrix)
    alpha = sprite.warped(matrix, bounds)[..., 3]
    seen = alpha.copy()
    for actor in scene.actors[scene.target + 1:]:
        front = actor.sprite(time)
        place = compose(camera, actor.placement(time).matrix())
        other = front.bounds(place)
        if (bounds[0] < other[2] and other[0] < bounds[2]
                and bounds[1] < other[3] and other[1] < bounds[3]):
            seen *= 1 - front.warped(place, bounds)[..., 3]
    left, top = max(0, -bounds[0]), max(0, -bounds[1])
    inside = seen[top:max(top, scene.view.height - bounds[1]),
                  left:max(left, scene.view.width - bounds[0])]
    return box, float(inside.sum() / alpha.sum())
