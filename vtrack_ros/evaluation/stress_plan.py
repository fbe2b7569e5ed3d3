"""Plans of a sequence under stress: the frames kept, how they are changed, and the truth."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.evaluation.frame_changes import shifted
from vtrack_ros.evaluation.metrics import present
from vtrack_ros.frame import Array, Frame

Frames = Iterator[Frame]
#: (index, frame, random generator) -> the changed frame.
Edit = Callable[[int, Frame, np.random.Generator], Frame]


@dataclass(frozen=True)
class Footage:
    """A sequence: truth, shape (n, 4), NaN where absent; steps, shape (n,); image size [px]."""

    name: str
    truth: Array
    steps: Array
    size: tuple[int, int]

    @property
    def boxes(self) -> Array:
        """Return the truth with the last known box where the target is absent."""
        known = np.where(present(self.truth), np.arange(len(self.truth)), 0)
        return self.truth[np.maximum.accumulate(known)]

    @property
    def sides(self) -> Array:
        """Return the square root of the target's area in each frame, shape (n,), [px]."""
        sides: Array = np.sqrt(self.boxes[:, 2:].prod(axis=1))
        return sides


@dataclass(frozen=True)
class StressPlan:
    """
    The changes of a sequence under stress.

    `kept`, shape (m,), are the indices of the frames that remain; `truth`, shape (m, 4), the boxes
    in these as changed, hidden or not, NaN where the original has no target. `visible`, shape
    (m,), tells whether at least a part of the target can be seen; `steps`, shape (m,), are the
    times since the previous frame, in the original's frame intervals. `frames` makes the changed
    frames from the kept ones.
    """

    kept: NDArray[np.intp]
    truth: Array
    visible: NDArray[np.bool_]
    steps: Array
    frames: Callable[[Iterable[Frame], np.random.Generator], Frames]


def thinned(footage: Footage, kept: NDArray[np.bool_]) -> StressPlan:
    """Keep the frames of a mask that includes the first one; steps are the elapsed time."""
    indices = np.flatnonzero(kept)
    times = np.cumsum(footage.steps)[indices]
    truth = footage.truth[indices]
    return StressPlan(indices, truth, present(truth),
                      np.concatenate([footage.steps[:1], np.diff(times)]),
                      lambda frames, rng: iter(frames))


def edited(footage: Footage, edit: Edit, truth: Array | None = None) -> StressPlan:
    """Keep all frames, each one edited."""
    return StressPlan(
        np.arange(len(footage.truth)), footage.truth if truth is None else truth,
        present(footage.truth), footage.steps, lambda frames, rng: (
            edit(index, frame, rng) for index, frame in enumerate(frames)))


def moved(footage: Footage, offsets: Array) -> StressPlan:
    """Move each frame and its truth by offsets, rounded to whole pixels."""
    pixels = np.rint(offsets).astype(int)
    truth = footage.truth + np.pad(pixels, ((0, 0), (0, 2)))
    return edited(footage, lambda index, frame, rng: shifted(frame, pixels[index].tolist()), truth)


def room(footage: Footage) -> tuple[Array, Array]:
    """Return minimum and maximum offset (n, 2) that move no more of the box out of the frame."""
    boxes = footage.boxes
    return (np.ceil(np.minimum(0, -boxes[:, :2])),
            np.floor(np.maximum(0, np.array(footage.size) - boxes[:, :2] - boxes[:, 2:])))


def random_stretches(count: int, least: int, most: int, rng: np.random.Generator) -> (
        Iterator[tuple[int, int]]):
    """Divide frames into stretches of random length from `least` to `most`: begin, end."""
    begin = 0
    while begin < count:
        end = begin + int(rng.integers(least, most + 1))
        yield begin, min(end, count)
        begin = end


def now_and_then(count: int, least: int, most: int, rng: np.random.Generator) -> Array:
    """Return a random angle [rad] for each second stretch's frames, NaN for the others."""
    angles = np.full(count, np.nan)
    for number, (begin, end) in enumerate(random_stretches(count, least, most, rng)):
        if number % 2:
            angles[begin:end] = rng.uniform(0, 2 * math.pi)
    return angles
