"""The scenes by name."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import zlib

import numpy as np

from vtrack_ros.scenes import faces, people, traffic
from vtrack_ros.scenes.stage import film, Scene, SceneFrame, View

#: The largest frame that scenes are made for, in pixels.
LARGEST = (1920, 1080)
#: The smallest.
SMALLEST = (64, 48)


@dataclass(frozen=True)
class SceneInfo:
    """
    A scene: its own size in pixels, and how many frames its story has.

    Where the number of random numbers depends on the size, `make` draws them from a separate
    (spawned) generator, so that motions are the same at every size.
    """

    name: str
    summary: str
    width: int
    height: int
    frames: int
    make: Callable[[View, np.random.Generator], Scene]


_SCENES = (
    SceneInfo('face_fast', 'A face moves quickly to the right and back, twice.',
              128, 96, 50, faces.face_fast),
    SceneInfo('football', 'Players dressed alike; the target is occluded in frames 53-84, and in '
              'the shade from frame 85 on.', 400, 240, 150, people.football),
    SceneInfo('similar_occlusion', 'A walker is occluded by somebody dressed alike from frame '
              '99 on.', 384, 288, 170, people.similar_occlusion),
    SceneInfo('pose_change', 'A face turns to the side and up in frames 53-62, and back later.',
              256, 192, 130, faces.pose_change),
    SceneInfo('scale_change', 'A walker approaches, turns round and goes away.',
              320, 240, 160, people.scale_change),
    SceneInfo('light_change', 'A face under light that goes out, changes colour and flickers.',
              320, 240, 130, faces.light_change),
    SceneInfo('light_step', 'A face; the light falls by half in frames 55-58, and somebody '
              'occludes a part of the face later.', 320, 240, 130, faces.light_step),
    SceneInfo('full_occlusion', 'A walker is hidden by a kiosk for about twenty frames.',
              320, 240, 140, people.full_occlusion),
    SceneInfo('car_approach', 'A car among similar cars approaches, grows fivefold and passes '
              'behind a lamp post.', 384, 288, 200, traffic.car_approach),
    SceneInfo('helicopter', 'A helicopter over a town, at changing distances and angles, partly '
              'occluded about frame 281.', 320, 240, 780, traffic.helicopter),
    SceneInfo('leave_and_return', 'A walker leaves the image and comes back forty frames later.',
              320, 240, 170, people.leave_and_return),
    SceneInfo('low_light_noise', 'A walker at night, in noisy images.',
              320, 240, 130, people.low_light_noise),
    SceneInfo('distractor_cross', 'Two walkers dressed alike cross twice.',
              320, 240, 130, people.distractor_cross),
)
_CATALOGUE = {scene.name: scene for scene in _SCENES}


def scene_names() -> tuple[str, ...]:
    """Return the names of all scenes."""
    return tuple(_CATALOGUE)


def scene_info(name: str) -> SceneInfo:
    """Return a scene of the catalogue; ValueError with a list of them if it's unknown."""
    if name not in _CATALOGUE:
        raise ValueError(f'unknown scene {name!r}; valid are ' + ', '.join(_CATALOGUE))
    return _CATALOGUE[name]


def render(name: str, size: tuple[int, int] | None = None, frames: int | None = None,
           seed: int = 0) -> Iterator[SceneFrame]:
    """
    Render a scene; ValueError if there's no such scene, or an argument is out of range.

    `size` in pixels is by default the scene's own, and may be from 64 x 48 to 1920 x 1080. Speeds
    and events are the same for any number of frames: fewer than the story has show its beginning,
    with more it is then played backwards and forwards in turn. The seed varies textures, clutter,
    small motions and noise, not the story.
    """
    info = scene_info(name)
    width, height = (info.width, info.height) if size is None else size
    count = info.frames if frames is None else frames
    if not (SMALLEST[0] <= width <= LARGEST[0] and SMALLEST[1] <= height <= LARGEST[1]):
        raise ValueError(
            f'size must be from {SMALLEST[0]}x{SMALLEST[1]} to {LARGEST[0]}x{LARGEST[1]}, '
            f'not {width}x{height}')
    if count < 1:
        raise ValueError(f'frames must be at least 1, not {count}')
    if seed < 0:
        raise ValueError(f'seed must not be negative, but is {seed}')
    building, sensor = np.random.default_rng([seed, zlib.crc32(name.encode())]).spawn(2)
    scene = info.make(View(width, height, info.width, info.height), building)
    return film(scene, story_times(info.frames, count), sensor)


def story_times(story: int, frames: int) -> Iterator[float]:
    """Return the story's time at each frame: forwards, then backwards, then forwards again."""
    for index in range(frames):
        rounds, rest = divmod(index, max(1, story - 1))
        yield float(rest if rounds % 2 == 0 else story - 1 - rest)
