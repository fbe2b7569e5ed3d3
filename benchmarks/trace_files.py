"""Which files of the package one image crosses: the calls within a session's update."""

from __future__ import annotations

import argparse
from pathlib import Path
import statistics
import sys
from types import FrameType
from typing import Any

import numpy as np
import vtrack_ros
from vtrack_ros.geometry import Box
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import tracker_names

ROOT = Path(vtrack_ros.__file__).parent
SIDE, SHAPE = 40, (240, 320, 3)
INTERVAL = 33_333_333


def frame(index: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return noise on which a textured square moves to the right."""
    rng = np.random.default_rng(0)
    image = rng.integers(60, 120, SHAPE, dtype=np.uint8)
    x = 60 + 2 * index
    image[90:90 + SIDE, x:x + SIDE] = rng.integers(0, 255, (SIDE, SIDE, 3), dtype=np.uint8)
    return image


def crossed(session: TrackingSession, index: int) -> set[str]:
    """Return the files whose functions are called in the update with one frame."""
    files: set[str] = set()

    def note(caller: FrameType, event: str, _: Any) -> None:
        path = Path(caller.f_code.co_filename)
        if event == 'call' and ROOT in path.parents:
            files.add(str(path.relative_to(ROOT)))
    image = frame(index)
    sys.setprofile(note)
    try:
        session.update(image, index * INTERVAL)
    finally:
        sys.setprofile(None)
    return files


def main() -> None:
    """Print the median and the maximum number of files per frame, and the files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('tracker', nargs='?', default='gmpf', choices=tracker_names())
    parser.add_argument('--frames', type=int, default=60)
    arguments = parser.parse_args()
    session = TrackingSession(arguments.tracker)
    session.start(frame(0), 0, Box(60, 90, SIDE, SIDE))
    frames = [crossed(session, index) for index in range(1, arguments.frames + 1)]
    counts = [len(files) for files in frames]
    print(f'{arguments.tracker}: median {statistics.median(counts):g}, most {max(counts)} files')
    for name in sorted(set().union(*frames)):
        print(f'  {sum(name in files for files in frames):3d} of {len(frames)}  {name}')


if __name__ == '__main__':
    main()
