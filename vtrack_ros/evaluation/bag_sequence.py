"""Bags with truth as sequences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.bags import BagReader, SequenceError
from vtrack_ros.evaluation.metrics import truth_rows
from vtrack_ros.evaluation.sequences import Sequence
from vtrack_ros.frame import Frame
from vtrack_ros.session.session import FrameIntervalEstimator


@dataclass(frozen=True)
class BagSequence(Sequence):
    """
    The images of a bag's topic, from the `first` one with a true box on.

    `intervals`, shape (n,), is the time since the image before, in frame intervals: more than 1
    where some dropped.
    """

    path: Path
    topic: str
    first: int
    intervals: NDArray[np.float64]

    @property
    def video(self) -> str:
        """Return bag and topic."""
        return f'{self.path}:{self.topic}'

    @property
    def steps(self) -> NDArray[np.float64]:
        """Return the intervals."""
        return self.intervals

    def frames(self) -> Iterable[Frame]:
        """Decode the images; errors as the base class."""
        with BagReader(self.path) as bag:
            for index, stamped in enumerate(bag.frames(self.topic)):
                if index >= self.first:
                    yield stamped.frame

    def fingerprint(self) -> str:
        """Return a hash of topic, truth and every file's content."""
        digest = hashlib.sha256(np.ascontiguousarray(self.truth).tobytes())
        digest.update(f'{self.topic} {self.first}'.encode())
        files = sorted(self.path.iterdir()) if self.path.is_dir() else [self.path]
        for file in files:
            if file.is_file():
                with file.open('rb') as opened:
                    digest.update(hashlib.file_digest(opened, 'sha256').digest())
        return digest.hexdigest()


def read_bag(path: str | Path, topic: str | None = None) -> BagSequence:
    """
    Return a bag, of whose image topics one is chosen, as a sequence named as its file or folder.

    SequenceError if it can't be read, or has no truth for an image after the first that has.
    """
    path = Path(path)
    with BagReader(path) as bag:
        name = bag.image_topic(topic).name
        boxes = bag.truth()
        stamps = [stamped.stamp for stamped in bag.frames(name)]
    if not boxes:
        raise SequenceError(f'{path}: the bag has no truth, neither as a topic nor as a CSV')
    first = next((index for index, stamp in enumerate(stamps) if boxes.get(stamp)), None)
    if first is None:
        raise SequenceError(f'{path}: none of the {len(stamps)} images has a true box')
    stamps = stamps[first:]
    unknown = sum(stamp not in boxes for stamp in stamps)
    if unknown:
        raise SequenceError(f'{path}: {unknown} of {len(stamps)} images have no truth; a target '
                            'that is absent has a row of NaN')
    estimator = FrameIntervalEstimator()
    intervals = [1.0, *(estimator.steps(after - before)
                        for before, after in zip(stamps, stamps[1:]))]
    return BagSequence(path.resolve().stem, truth_rows(boxes[stamp] for stamp in stamps), path,
                       name, first, np.array(intervals))
