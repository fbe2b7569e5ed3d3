"""The shared sequences, whole or cut, and which of them constants were tuned on."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from vtrack_ros.evaluation import find_sequences, FolderSequence

#: The folder with them.
FOLDER = Path(__file__).resolve().parents[2] / 'shared' / 'sequences'
#: The videos on which constants were tuned.
TUNED = frozenset((
    'Bird2', 'Couple', 'Crossing', 'David', 'Dog1', 'DragonBaby', 'FaceOcc1', 'Football1',
    'Freeman1', 'Human7', 'Jogging1', 'Man', 'MotorRolling', 'Toy', 'VOT_ball1'))
HALVES = {'tuned': 'videos on which constants were tuned', 'others': 'other videos'}


def is_tuned(name: str) -> bool:
    """Whether constants were tuned on a target, whose name is the video's, a dot and a number."""
    return name.split('.')[0] in TUNED


def half_of(name: str) -> str:
    """Return which of `HALVES` a target is of."""
    return 'tuned' if is_tuned(name) else 'others'


def options(description: str | None) -> argparse.ArgumentParser:
    """Return the common options of benchmarks that track the sequences' targets."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('--sequences', type=Path, default=FOLDER)
    parser.add_argument('--frames', type=int, default=150)
    parser.add_argument('--jobs', type=int, default=2)
    return parser


def folder_sequences(
        folder: Path, frames: int | None = None) -> tuple[list[FolderSequence], dict[str, str]]:
    """Return a folder's sequences, their first frames, and name -> problem of broken ones."""
    found, broken = find_sequences(folder)
    return [replace(one, truth=one.truth[:frames], images=one.images[:frames])
            for one in found if isinstance(one, FolderSequence)], broken
