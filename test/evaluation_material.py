"""Small sequences for the tests of the evaluation: a textured square that moves over noise."""

import json
import os
from pathlib import Path

import cv2
import numpy as np

from vtrack_ros.evaluation import FolderSequence
from vtrack_ros.evaluation.runner import Run
from vtrack_ros.evaluation.scoring import FIGURES

SIZE = 24
TIMED = {figure.key for figure in FIGURES if figure.timed}


class DeadlySequence(FolderSequence):
    """A sequence whose decoder ends the whole process."""

    def frames(self):
        """End the process as a crash in compiled code would."""
        os._exit(1)


def truth_of(index: int) -> tuple[int, int, int, int]:
    """Return the true box of a frame."""
    return (20 + 2 * index, 30 + index, SIZE, SIZE)


def picture(index: int, offset: int = 0) -> np.ndarray:
    """Return a frame of 160 x 120 px with the square at `truth_of`, plus an offset in x."""
    rng = np.random.default_rng(7)
    frame = rng.integers(90, 140, (120, 160, 3), dtype=np.uint8)
    square = rng.integers(0, 60, (SIZE, SIZE, 3), dtype=np.uint8)
    square[..., 2] += 180
    x, y, _, _ = truth_of(index)
    frame[y:y + SIZE, x + offset:x + offset + SIZE] = square
    return frame


def write_sequence(folder: Path, frames: int = 12, rows: list[str] | None = None) -> Path:
    """Write frames as PNG and a ground truth, by default the true one; return the folder."""
    (folder / 'img').mkdir(parents=True)
    for index in range(frames):
        cv2.imwrite(str(folder / 'img' / f'{index + 1:05}.png'), picture(index))
    write_truth(folder, rows or [','.join(map(str, truth_of(index))) for index in range(frames)])
    return folder


def write_truth(folder: Path, rows: list[str], name: str = 'groundtruth_rect.txt') -> None:
    """Write a ground truth."""
    (folder / name).write_text('\n'.join(rows) + '\n')


def boxes_run(boxes) -> Run:
    """Return a run with these boxes as estimates."""
    count = len(boxes)
    return Run(np.array(boxes, dtype=float), np.zeros((count, 2, 2)), np.ones(count),
               np.ones(count, dtype=bool), np.ones(count - 1), np.ones(count - 1))


class SignedSequence(FolderSequence):
    """A sequence that records which process decodes it, by a file named after its process ID."""

    def frames(self):
        """Write that file, and decode."""
        (self.images[0].parent.parent / f'{os.getpid()}.pid').touch()
        return super().frames()


def untimed(content: dict) -> dict:
    """Return results as JSON without what depends on the clock."""
    def stripped(scores):
        return {key: value for key, value in scores.items()
                if key.removesuffix('_std') not in TIMED}
    content = json.loads(json.dumps(content))
    for key in ('environment', 'timings'):
        del content[key]
    content['summary'] = {label: stripped(row) for label, row in content['summary'].items()}
    content['sequences'] = {name: {label: stripped(row) for label, row in rows.items()}
                            for name, rows in content['sequences'].items()}
    return content
