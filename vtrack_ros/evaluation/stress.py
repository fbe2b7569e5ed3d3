"""Sequences made harder by a kind of stress, a severity and a seed, the truth changed alike."""

from collections.abc import Iterable, Iterator, Sequence as Ordered
from dataclasses import dataclass, field
import hashlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.bags.errors import SequenceError
from vtrack_ros.evaluation.cache import source_hash
from vtrack_ros.evaluation.sequences import Sequence
from vtrack_ros.evaluation.stress_kinds import planned, STRESS_KINDS
from vtrack_ros.evaluation.stress_plan import Footage, StressPlan
from vtrack_ros.frame import Array, Frame


class StressedFrames(NamedTuple):
    """An iterator of frames; true boxes (n, 4), hidden or not; visibility and steps (n,)."""

    frames: Iterator[Frame]
    truth: Array
    visible: NDArray[np.bool_]
    steps: Array


@dataclass(frozen=True)
class StressedSequence(Sequence):
    """
    A sequence under stress, made anew frame by frame at each call of `frames`.

    Its `truth` is NaN where the target is hidden, as in a scene; `boxes` has the box there too.
    `content` is the original's fingerprint if it's known already, else empty.
    """

    original: Sequence
    kind: str
    severity: float
    seed: int
    size: tuple[int, int]
    content: str = field(default='', repr=False)

    @property
    def video(self) -> str:
        """Return all that the frames are made from: the original's video, target and stress."""
        # the stress follows the target, and a part of a video is another plan
        target = hashlib.sha256(self.original.truth.tobytes() + self.original.steps.tobytes())
        return (f'{self.original.video} {self.original.name} {target.hexdigest()} {self.kind} '
                f'{self.severity:g} {self.seed}')

    @property
    def boxes(self) -> Array:
        """Return the true boxes, shape (n, 4), hidden or not; NaN where the original has none."""
        return self._plan()[0].truth

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Return where the target can be seen, shape (n,)."""
        return self._plan()[0].visible

    @property
    def steps(self) -> Array:
        """Return the time since the previous frame, in the original's frame intervals."""
        return self._plan()[0].steps

    def frames(self) -> Iterator[Frame]:
        """Make the frames one by one; errors as the original's."""
        return self.made_of(self.original.frames())

    def made_of(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Make them from the original's frames, which must be of one size, else SequenceError."""
        plan, rng = self._plan()
        kept = set(plan.kept.tolist())
        last = int(plan.kept[-1])
        checked = of_one_size(self.original.name, frames, self.size)
        return plan.frames((frame for index, frame in zip(range(last + 1), checked)
                            if index in kept), rng)

    def fingerprint(self) -> str:
        """Return a hash of original, truth, stress and of the source code that makes it."""
        parts = (self.content or self.original.fingerprint(), self.original.name, self.kind,
                 f'{self.severity:g}', str(self.seed),
                 source_hash('vtrack_ros.evaluation.stress_kinds'))
        return hashlib.sha256('\0'.join(parts).encode() + self.truth.tobytes()).hexdigest()

    def _plan(self) -> tuple[StressPlan, np.random.Generator]:
        return _planned(self.original, self.kind, self.severity, self.seed, self.size)


def frame_size(sequence: Sequence) -> tuple[int, int]:
    """Return width and height of a sequence's first frame; SequenceError if it can't be read."""
    height, width = next(iter(sequence.frames())).shape[:2]
    return width, height


def of_one_size(name: str, frames: Iterable[Frame],
                size: tuple[int, int] | None = None) -> Iterator[Frame]:
    """Yield a sequence's frames; SequenceError at one that hasn't the first one's size."""
    for index, frame in enumerate(frames):
        height, width = frame.shape[:2]
        size = size or (width, height)
        if (width, height) != size:
            raise SequenceError(f'{name}: frame {index} is {width} x {height} pixels, but the '
                                f'first is {size[0]} x {size[1]}: all must have the same size')
        yield frame


def stressed_sequence(sequence: Sequence, kind: str, severity: float, seed: int = 0,
                      size: tuple[int, int] | None = None, content: str = '') -> StressedSequence:
    """
    Return a sequence under stress, named as the original with kind and severity appended.

    The kind is `plain`, or one of `STRESS_KINDS` that changes frames, the severity in its unit;
    the reports use the three of its `severities`. Seed, name and kind seed the random numbers,
    which are the same at all severities. The original's `frame_size` and its fingerprint
    (`content`) are given if they're known already. ValueError if the kind is unknown or changes no
    frames, or the severity isn't positive, SequenceError if the first frame can't be read.
    """
    size = size or frame_size(sequence)
    plan, _ = _planned(sequence, kind, severity, seed, size)
    truth = np.where(plan.visible[:, None], plan.truth, np.nan)
    return StressedSequence(f'{sequence.name} ({kind} {severity:g})', truth, sequence, kind,
                            severity, seed, size, content)


def stressed_sequences(sequences: Ordered[Sequence], kinds: Ordered[str], seed: int,
                       with_content: bool) -> list[StressedSequence]:
    """Return the sequences under each kind at each severity; unreadable ones are left out."""
    made: list[StressedSequence] = []
    for sequence in sequences:
        try:
            size = frame_size(sequence)
            content = sequence.fingerprint() if with_content else ''
        except (OSError, SequenceError):
            continue
        made.extend(stressed_sequence(sequence, kind, severity, seed, size, content)
                    for kind in kinds if STRESS_KINDS[kind].plan is not None
                    for severity in STRESS_KINDS[kind].severities)
    return made


def stress(sequence: Sequence, kind: str, severity: float, seed: int = 0) -> StressedFrames:
    """Return a `stressed_sequence` as frames, true boxes, visibility and steps."""
    made = stressed_sequence(sequence, kind, severity, seed)
    return StressedFrames(made.frames(), made.boxes, made.visible, made.steps)


def _planned(sequence: Sequence, kind: str, severity: float, seed: int,
             size: tuple[int, int]) -> tuple[StressPlan, np.random.Generator]:
    return planned(Footage(sequence.name, sequence.truth, sequence.steps, size),
                   kind, severity, seed)
