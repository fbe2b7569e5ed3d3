"""A replay's results on disk: table, bag and pictures; all replace earlier ones together."""

from collections.abc import Mapping
from contextlib import ExitStack, suppress
import csv
import hashlib
import math
import os
from pathlib import Path
import shutil
import tempfile
from typing import Any, Self

from vtrack_ros.bags import messages
from vtrack_ros.bags.errors import BagError, writing
from vtrack_ros.bags.reader import BagReader
from vtrack_ros.bags.replay import Step, WAITING
from vtrack_ros.bags.writer import BagWriter
from vtrack_ros.drawing import SHEET_FILE, VIDEO_FILE

_TABLE, _BAG = 'results.csv', 'bag'
_FILES = (_BAG, _TABLE, VIDEO_FILE, SHEET_FILE)
_COLUMNS = ('stamp_ns', 'x', 'y', 'width', 'height', 'angle', 'confidence', 'state')
_DETECTIONS, _POSE, _TWIST = '/detections', '/pose', '/twist'


class ResultFolder:
    """
    Writes the results of a replay into a folder; a context manager.

    They replace earlier results when they're complete: an error or an interruption before leaves
    the folder as it was.

    The bag's notes have digests of the pictures, by which these are known as a replay's results.
    The folder is created if it's missing; `source` is the bag that is read, which the results must
    not replace. Until it's complete everything is written in the temporary folder `place`, where
    the pictures have to be written as well. BagError if the folder can't be written, or has files
    of these names that aren't the result of a replay.
    """

    def __init__(self, path: Path, source: Path) -> None:
        self._path = path
        self._source = source

    def __enter__(self) -> Self:
        """Check existing files, and open the new ones."""
        self._check()
        self._made = not self._path.exists()
        try:
            self._path.mkdir(parents=True, exist_ok=True)
            self._scratch = Path(tempfile.mkdtemp(dir=self._path, prefix='.vtrack-'))
        except OSError as error:
            raise BagError(f"can't write results into {self._path}: {error.strerror}") from None
        self.place = self._scratch / 'new'
        with ExitStack() as stack:
            stack.enter_context(writing(self._path))
            stack.push(self._finish)
            self.place.mkdir()
            self._bag = stack.enter_context(BagWriter(self.place / _BAG))
            file = stack.enter_context((self.place / _TABLE).open('w', newline=''))
            self._table = csv.writer(file, lineterminator='\n')
            self._table.writerow(_COLUMNS)
            stack.push(self._note_pictures)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        """Move the results to their place, or remove them after an error."""
        self._stack.__exit__(*error)

    def write(self, step: Step) -> None:
        """Append a frame to the table, in full precision, and to the bag as the node's output."""
        image, estimate = step.image, step.estimate
        values, state = [math.nan] * 6, WAITING
        if estimate is not None:
            values = [*estimate.box.as_array().tolist(), estimate.angle, estimate.confidence]
            state = estimate.state.value
        self._table.writerow([image.stamp, *(repr(float(value)) for value in values), state])
        if estimate is None or not estimate.measured:
            found = messages.detections(None, image.stamp, image.frame_id)
        else:
            found = messages.detections(
                estimate.box, image.stamp, image.frame_id, estimate.angle, estimate.confidence)
            pose = messages.pose(*estimate.box.center, estimate.angle, image.stamp, image.frame_id)
            self._bag.write(_POSE, pose, image.received)
        if step.motion is not None:
            twist = messages.twist(step.motion, image.stamp, image.frame_id)
            self._bag.write(_TWIST, twist, image.received)
        self._bag.write(_DETECTIONS, found, image.received)

    def _check(self) -> None:
        """Raise BagError where the results would replace anything but earlier results."""
        bag, table = self._path / _BAG, self._path / _TABLE
        target, read = bag.resolve(), self._source.resolve()
        if target.is_relative_to(read) or read.is_relative_to(target):
            raise BagError(f'{bag} overlaps with the bag that is read: give another folder')
        if self._path.exists() and not self._path.is_dir():
            raise BagError(f"can't write results into {self._path}: it's a file, not a folder")
        present = [self._path / name for name in _FILES if os.path.lexists(self._path / name)]
        notes = _result_notes(bag)
        ours = {bag: notes is not None, table: _is_result_table(table)}
        foreign = [path for path in present if not (
            ours[path] if path in ours else _is_noted(path, notes or {}))]
        if foreign:
            raise BagError(f"{foreign[0]} exists already and isn't the result of a replay: give "
                           'another folder, or remove it first')

    def _note_pictures(self, kind: type[BaseException] | None, *_: object) -> None:
        for name in (VIDEO_FILE, SHEET_FILE):
            if kind is None and (self.place / name).exists():
                self._bag.note(name, _digest(self.place / name))

    def _finish(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            # If this is interrupted, the scratch folder keeps earlier files and unmoved new ones.
            earlier = self._scratch / 'earlier'
            earlier.mkdir()
            for name in _FILES:
                if os.path.lexists(self._path / name):
                    (self._path / name).rename(earlier / name)
                if (self.place / name).exists():
                    (self.place / name).rename(self._path / name)
        shutil.rmtree(self._scratch, ignore_errors=True)
        if kind is not None and self._made:
            with suppress(OSError):
                self._path.rmdir()


def _is_result_table(path: Path) -> bool:
    try:
        with path.open(newline='', encoding='utf-8') as file:
            return file.readline().rstrip('\n') == ','.join(_COLUMNS)
    except (OSError, UnicodeDecodeError):
        return False


def _result_notes(path: Path) -> dict[str, str] | None:
    """Return the notes of a result bag; None for anything else."""
    if not path.is_dir() or {file.name for file in path.iterdir()} != {
            'metadata.yaml', f'{_BAG}.mcap'}:
        return None
    try:
        with BagReader(path) as bag:
            ours = {_DETECTIONS} <= set(bag.topics) <= {_DETECTIONS, _POSE, _TWIST}
            return bag.notes if ours else None
    except BagError:
        return None


def _is_noted(picture: Path, notes: Mapping[str, str]) -> bool:
    try:
        return picture.name in notes and _digest(picture) == notes[picture.name]
    except OSError:
        return False


def _digest(path: Path) -> str:
    with path.open('rb') as file:
        return hashlib.file_digest(file, 'sha256').hexdigest()
