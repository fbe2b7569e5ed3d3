"""Sequences with truth: folders of images as the tracking benchmarks publish them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.bags.errors import SequenceError
from vtrack_ros.bags.image_folder import (
    GROUND_TRUTH, ground_truth_files, image_files, read_ground_truth, read_image)
from vtrack_ros.evaluation.metrics import truth_rows
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box


@dataclass(frozen=True)
class Sequence(ABC):
    """
    Frames, and where the target really is in them.

    Parameters
    ----------
    name : str
        What it's called in tables.
    truth : ndarray, shape (n, 4), [px]
        Rows of x, y, width, height, one per frame; NaN where the target is absent.

    Raises
    ------
    SequenceError
        If the target isn't there in the first frame, in which a tracker is started.

    """

    name: str
    truth: NDArray[np.float64]

    def __post_init__(self) -> None:
        if np.isnan(self.truth[0]).any():
            raise SequenceError(
                f'{self.name}: the first frame has no box to start a tracker on')

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.truth)

    @property
    def first_box(self) -> Box:
        """Return the box that a tracker is started on."""
        return Box(*self.truth[0])

    @property
    def steps(self) -> NDArray[np.float64]:
        """Return the time since the frame before, in frame intervals, for each frame."""
        return np.ones(len(self))

    @property
    @abstractmethod
    def video(self) -> str:
        """Return what tells one video from another; targets of one video share it."""

    @abstractmethod
    def frames(self) -> Iterable[Frame]:
        """Decode the frames; SequenceError if one can't be read."""

    def pick(self, indices: Iterable[int]) -> dict[int, Frame]:
        """Return some frames by index; errors as `frames`."""
        wanted = set(indices)
        return {index: frame for index, frame in enumerate(self.frames()) if index in wanted}

    @abstractmethod
    def fingerprint(self) -> str:
        """Return a hash of all that the frames and the truth are made from."""


@dataclass(frozen=True)
class FolderSequence(Sequence):
    """A folder with a `groundtruth_rect.txt` and images, the frames' files in order."""

    images: tuple[Path, ...]

    @property
    def video(self) -> str:
        """Return the folder of the images."""
        return str(self.images[0].parent)

    def frames(self) -> Iterable[Frame]:
        """Decode the frames one by one, in BGR; errors as the base class."""
        return map(read_image, self.images)

    def pick(self, indices: Iterable[int]) -> dict[int, Frame]:
        """Decode only the frames that are wanted; errors as the base class."""
        return {index: read_image(self.images[index]) for index in indices}

    def fingerprint(self) -> str:
        """Return a hash of the truth and of every image file's content."""
        digest = hashlib.sha256(np.ascontiguousarray(self.truth).tobytes())
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
    images = image_files(folder)
    files = ground_truth_files(folder)
    if not files:
        raise SequenceError(f'{folder}: no {GROUND_TRUTH}.txt')
    result = []
    for path in files:
        suffix = path.name.removeprefix(GROUND_TRUTH).removesuffix('.txt')
        truth = truth_rows(read_ground_truth(path))
        if len(truth) != len(images):
            raise SequenceError(
                f'{path}: {len(truth)} boxes, but {len(images)} images in {images[0].parent}')
        result.append(FolderSequence(folder.name + suffix, truth, images))
    return result


def find_sequences(root: Path) -> tuple[list[Sequence], dict[str, str]]:
    """
    Return the sequences of a folder of sequence folders, or of one, sorted by name.

    Also returns name -> what's wrong for those that can't be used; SequenceError if it isn't a
    folder, or nothing in it looks like a sequence.
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
            sequences.extend(read_folder(folder))
        except SequenceError as error:
            broken[folder.name] = str(error)
    return sequences, broken


def uniquely_named(sequences: Iterable[Sequence]) -> list[Sequence]:
    """Return the sequences; each further one of a name has its number behind it."""
    count: dict[str, int] = {}
    result = []
    for sequence in sequences:
        number = count[sequence.name] = count.get(sequence.name, 0) + 1
        result.append(sequence if number == 1
                      else replace(sequence, name=f'{sequence.name} ({number})'))
    return result


def _like_a_sequence(folder: Path) -> bool:
    return (folder / 'img').is_dir() or bool(ground_truth_files(folder))
