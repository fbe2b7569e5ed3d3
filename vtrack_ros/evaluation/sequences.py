"""Sequences with truth: folders as the benchmarks publish them, bags and rendered scenes."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
import hashlib
import os
from pathlib import Path

import numpy as np

from vtrack_ros.bags import BagReader, SequenceError
from vtrack_ros.bags.image_folder import (
    GROUND_TRUTH, ground_truth_files, image_files, read_ground_truth, read_image)
from vtrack_ros.evaluation.metrics import truth_rows
from vtrack_ros.file_names import printable
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box
from vtrack_ros.scenes import render
from vtrack_ros.session.frame_interval import FrameIntervalEstimator


@dataclass(frozen=True)
class Sequence(ABC):
    """
    Frames, and the true box of the target in each.

    `truth`, shape (n, 4), has x, y, width, height in pixels for each frame, NaN where the target
    is absent; SequenceError if it's absent in the first frame, where a tracker is started.
    """

    name: str
    truth: Array

    def __post_init__(self) -> None:
        if np.isnan(self.truth[0]).any():
            raise SequenceError(f'{self.name}: the first frame has no box to start a tracker on')

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.truth)

    @property
    def first_box(self) -> Box:
        """Return the box that a tracker is started on."""
        return Box(*self.truth[0])

    @property
    def steps(self) -> Array:
        """Return the time since the frame before, in frame intervals, for each frame."""
        return np.ones(len(self))

    @property
    @abstractmethod
    def video(self) -> str:
        """Return an identifier of the video, shared by all targets in it."""

    @abstractmethod
    def frames(self) -> Iterable[Frame]:
        """Decode the frames; SequenceError if one can't be read."""

    def pick(self, indices: Iterable[int]) -> dict[int, Frame]:
        """Return some frames by index; errors as `frames`."""
        wanted = set(indices)
        return {index: frame for index, frame in enumerate(self.frames()) if index in wanted}

    @abstractmethod
    def fingerprint(self) -> str:
        """
        Return a hash of all that the frames and the truth are made from.

        OSError or SequenceError if a part of that can't be read.
        """


@dataclass(frozen=True)
class FolderSequence(Sequence):
    """A folder with a `groundtruth_rect.txt` and images, the frames' files in order."""

    images: tuple[Path, ...]

    @property
    def video(self) -> str:
        """Return the images' paths: one folder's images may be cut or ordered in several ways."""
        return '\n'.join(map(str, self.images))

    def frames(self) -> Iterable[Frame]:
        """Decode the frames one by one, in BGR; errors as the base class."""
        return map(read_image, self.images)

    def pick(self, indices: Iterable[int]) -> dict[int, Frame]:
        """Decode only the frames that are wanted; errors as the base class."""
        return {index: read_image(self.images[index]) for index in indices}

    def fingerprint(self) -> str:
        """Return a hash of the truth and of every image file's content."""
        digest = hashlib.sha256(self.truth.tobytes())
        for path in self.images:
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()


def read_folder(folder: Path) -> list[FolderSequence]:
    """
    Return the sequences of one folder, one for each ground truth in it.

    `groundtruth_rect.txt` is the target named as the folder; `groundtruth_rect.2.txt` is a second
    target in the same video, named NAME.2, and so on. SequenceError if images or truth are
    missing, don't fit each other or can't be understood.
    """
    sequences, broken = _targets(folder)
    for text in broken.values():
        raise SequenceError(text)
    return sequences


def _targets(folder: Path) -> tuple[list[FolderSequence], dict[str, str]]:
    """Return the sequences of one folder, and target -> error message for the unusable ones."""
    images = image_files(folder)
    files = ground_truth_files(folder)
    if not files:
        raise SequenceError(f'{folder}: no {GROUND_TRUTH}.txt')
    result, broken = [], {}
    for path in files:
        # `.` has no name to Path, and stress depends on the name
        name = printable(os.path.basename(os.path.abspath(folder))
                         + path.name.removeprefix(GROUND_TRUTH).removesuffix('.txt'))
        try:
            truth = truth_rows(read_ground_truth(path))
            if len(truth) != len(images):
                raise SequenceError(
                    f'{path}: {len(truth)} boxes, but {len(images)} images in {images[0].parent}')
            result.append(FolderSequence(name, truth, images))
        except SequenceError as error:
            broken[name] = str(error)
    return result, broken


@dataclass(frozen=True)
class BagSequence(Sequence):
    """
    The images of a bag's topic, from index `first` on: the first image with a true box.

    `intervals`, shape (n,), is the time since the previous image, in frame intervals: more than 1
    where images were dropped. `notice` is the reader's, for a bag that the recorder didn't finish.
    """

    path: Path
    topic: str
    first: int
    intervals: Array
    notice: str | None = None

    @property
    def video(self) -> str:
        """Return bag, topic and first image."""
        return f'{self.path}:{self.topic}:{self.first}'

    @property
    def steps(self) -> Array:
        """Return the intervals."""
        return self.intervals

    def frames(self) -> Iterable[Frame]:
        """Decode the images; errors as the base class."""
        with BagReader(self.path) as bag:
            for index, stamped in enumerate(bag.frames(self.topic)):
                if index >= self.first:
                    yield stamped.frame

    def fingerprint(self) -> str:
        """Return a hash of topic, truth, intervals and every file's content."""
        digest = hashlib.sha256(self.truth.tobytes())
        # Not in the files: how the stamps are understood, which changes from version to version.
        digest.update(self.intervals.tobytes())
        digest.update(f'{self.topic} {self.first}'.encode())
        files = sorted(self.path.iterdir()) if self.path.is_dir() else [self.path]
        for file in files:
            if file.is_file():
                with file.open('rb') as opened:
                    digest.update(hashlib.file_digest(opened, 'sha256').digest())
        return digest.hexdigest()


def read_bag(path: str | Path, topic: str | None = None) -> BagSequence:
    """
    Return one image topic of a bag as a sequence, named as the bag's file or folder.

    `topic` is needed if there are several. SequenceError if the bag can't be read, if no image has
    a true box, or if an image after the first that has one has no truth.
    """
    path = Path(path)
    with BagReader(path) as bag:
        name = bag.image_topic(topic).name
        boxes = bag.truth()
        stamps = [stamped.stamp for stamped in bag.frames(name)]
        notice = bag.notice
    if not boxes:
        raise SequenceError(f'{path}: the bag has no ground truth, neither as topic nor as CSV')
    first = next((index for index, stamp in enumerate(stamps) if boxes.get(stamp)), None)
    if first is None:
        raise SequenceError(f'{path}: none of the {len(stamps)} images has a true box')
    stamps = stamps[first:]
    unknown = sum(stamp not in boxes for stamp in stamps)
    if unknown:
        raise SequenceError(f'{path}: {unknown} of {len(stamps)} images have no truth; an absent '
                            'target needs a row of NaN')
    estimator = FrameIntervalEstimator()
    intervals = [1.0, *(estimator.steps(after - before)
                        for before, after in zip(stamps, stamps[1:]))]
    place = path.resolve()
    return BagSequence(printable(place.name if place.is_dir() else place.stem),
                       truth_rows(boxes[stamp] for stamp in stamps), path, name, first,
                       np.array(intervals), notice)


@dataclass(frozen=True)
class SceneSequence(Sequence):
    """A scene with the defaults of `render`, rendered anew at each call of `frames`."""

    scene: str
    digest: str

    @property
    def video(self) -> str:
        """Return what is rendered."""
        return f'scene {self.scene}'

    def frames(self) -> Iterable[Frame]:
        """Render the frames one by one."""
        return (shot.frame for shot in render(self.scene))

    def fingerprint(self) -> str:
        """Return a hash of the truth, and of the frames as they were rendered the first time."""
        return hashlib.sha256(self.truth.tobytes() + self.digest.encode()).hexdigest()


def scene_sequence(scene: str) -> SceneSequence:
    """Render a scene once for its truth, and return it as a sequence; errors as `render`."""
    digest = hashlib.sha256()
    boxes = []
    for shot in render(scene):
        digest.update(np.ascontiguousarray(shot.frame).tobytes())
        boxes.append(shot.truth)
    return SceneSequence(scene, truth_rows(boxes), scene, digest.hexdigest())


def find_sequences(root: Path) -> tuple[list[Sequence], dict[str, str]]:
    """
    Return the sequences of a folder of sequence folders, or of one such, sorted by folder name.

    Also returns name -> error message for the folders and targets that can't be used;
    SequenceError if `root` isn't a folder, or nothing in it looks like a sequence.
    """
    if not root.is_dir():
        raise SequenceError(f'{root}: no such folder')
    folders = ([root] if _like_a_sequence(root)
               else sorted(path for path in root.iterdir() if path.is_dir()))
    if not any(map(_like_a_sequence, folders)):
        raise SequenceError(
            f'{root}: no sequences; expected folders with img/ and groundtruth_rect.txt')
    sequences: list[Sequence] = []
    broken = {}
    for folder in folders:
        try:
            targets, unusable = _targets(folder)
        except (OSError, SequenceError) as error:
            broken[folder.name] = str(error)
        else:
            sequences.extend(targets)
            broken.update(unusable)
    return sequences, broken


def uniquely_named(sequences: Iterable[Sequence]) -> list[Sequence]:
    """Return the sequences; repeated names get the next free number: NAME, NAME (2), and so on."""
    taken: set[str] = set()
    result = []
    for sequence in sequences:
        name, number = sequence.name, 1
        while name in taken:
            number += 1
            name = f'{sequence.name} ({number})'
        taken.add(name)
        result.append(sequence if number == 1 else replace(sequence, name=name))
    return result


def _like_a_sequence(folder: Path) -> bool:
    # os.path's is false in a folder that may not be searched, where Path's is an error
    return os.path.isdir(folder / 'img') or bool(ground_truth_files(folder))
