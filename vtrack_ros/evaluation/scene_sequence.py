"""Rendered scenes as sequences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import hashlib

import numpy as np

from vtrack_ros.evaluation.metrics import truth_rows
from vtrack_ros.evaluation.sequences import Sequence
from vtrack_ros.frame import Frame
from vtrack_ros.scenes import render


@dataclass(frozen=True)
class SceneSequence(Sequence):
    """What `render` makes of these arguments, again whenever frames are asked for."""

    scene: str
    size: tuple[int, int] | None
    count: int | None
    seed: int
    digest: str

    @property
    def video(self) -> str:
        """Return what was rendered."""
        return f'scene {self.scene} {self.size} {self.count} {self.seed}'

    def frames(self) -> Iterable[Frame]:
        """Render the frames one by one."""
        return (shot.frame for shot in render(self.scene, self.size, self.count, self.seed))

    def fingerprint(self) -> str:
        """Return the hash of the frames and the truth, as they were rendered the first time."""
        return self.digest


def scene_sequence(
        scene: str, size: tuple[int, int] | None = None, frames: int | None = None,
        seed: int = 0, name: str | None = None) -> SceneSequence:
    """
    Render a scene once for its truth, and return it as a sequence.

    Its name in tables is by default the scene's name, with what differs from the scene's defaults;
    the other arguments and errors are those of `vtrack_ros.scenes.render`.
    """
    digest = hashlib.sha256()
    boxes = []
    for shot in render(scene, size, frames, seed):
        digest.update(np.ascontiguousarray(shot.frame).tobytes())
        boxes.append(shot.truth)
    truth = truth_rows(boxes)
    digest.update(truth.tobytes())
    if name is None:
        details = [f'{size[0]}x{size[1]}'] if size is not None else []
        details += [f'{frames} frames'] if frames is not None else []
        details += [f'seed {seed}'] if seed else []
        name = f'{scene} ({", ".join(details)})' if details else scene
    return SceneSequence(name, truth, scene, size, frames, seed, digest.hexdigest())
