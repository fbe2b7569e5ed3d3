"""
What trackers say when the target has gone: another video comes in place of its own for a while.

`scripts/peers --python benchmarks/gone.py` tracks the targets of the shared sequences and writes
docs/results/gone.md. The target isn't in the other video, so TRACKING is always wrong there.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
import sys
from unittest.mock import patch

import cv2
from joblib import delayed, Parallel
import numpy as np
from numpy.typing import NDArray
from result_files import facts_text
from sequences import needed_peers_found
from shared_sequences import FOLDER, folder_sequences, half_of, HALVES

from vtrack_ros.evaluation import FolderSequence
from vtrack_ros.evaluation.metrics import on_target, overlaps
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.runner import one_thread, run_tracker
from vtrack_ros.evaluation.table import markdown
from vtrack_ros.frame import Frame
from vtrack_ros.localisation import presence
from vtrack_ros.scenes.catalogue import story_times
from vtrack_ros.trackers import create_tracker

ROOT = Path(__file__).resolve().parents[1]
#: Number of frames before the target disappears, without it, and after its return.
KNOWN, AWAY, BACK = 60, 300, 40
#: Parts of the frames without it: (first, end).
PARTS = {'1': (0, 1), '2 to 10': (1, 10), '11 to 30': (10, 30), '31 to 100': (30, 100),
         '101 to 300': (100, 300)}
#: Parts of the frames after its return.
LATER = {'1 to 10': (0, 10), '31 to 40': (30, 40)}
#: Distance in the list of targets to those whose videos are put in between.
OTHERS = (7, 11)
#: Suffix of a tracker's name: without the penalty on a target that was lost for long.
WITHOUT_PENALTY = ' without its doubt'


@dataclass(frozen=True)
class Visit:
    """
    The outcome of a run.

    `known` tells whether the box was on the target when that disappeared, `tracking` in which
    frames without it the state was TRACKING, `found` in which frames after its return the box was
    on it and the state TRACKING.
    """

    half: str
    known: bool
    tracking: NDArray[np.bool_]
    found: NDArray[np.bool_]


def interrupted(sequence: FolderSequence, other: FolderSequence) -> Iterator[Frame]:
    """Yield a sequence's frames, in between another's, resized and played to and fro."""
    own = list(islice(sequence.frames(), KNOWN + BACK))
    size = own[0].shape[1::-1]
    between = [cv2.resize(frame, size) for frame in islice(other.frames(), AWAY)]
    yield from own[:KNOWN]
    yield from (between[int(time)] for time in story_times(len(between), AWAY))
    yield from own[KNOWN:]


def visit(tracker: str, sequence: FolderSequence, other: FolderSequence) -> Visit:
    """Track a target whose video is interrupted by another one."""
    name = tracker.removesuffix(WITHOUT_PENALTY)
    with one_thread(), (patch.object(presence, '_MOST_DOUBT', 0.0)
                        if name != tracker else nullcontext()):
        run = run_tracker(create_tracker(name, seed=0), interrupted(sequence, other),
                          sequence.first_box)
    back = slice(KNOWN + AWAY, None)
    last = on_target(overlaps(run.boxes[:KNOWN], sequence.truth[:KNOWN]))[-1]
    found = on_target(overlaps(run.boxes[back], sequence.truth[KNOWN:KNOWN + BACK]))
    return Visit(half_of(sequence.name), bool(last), run.measured[KNOWN:KNOWN + AWAY],
                 found & run.measured[back])


def rows(visits: dict[str, list[Visit]], half: str) -> list[list[str]]:
    """Return a table: the shares of frames that are TRACKING, wrongly and rightly."""
    table = [['tracker', *PARTS, *(f'back, {name}' for name in LATER)]]
    for tracker, every in visits.items():
        ours = [one for one in every if one.half == half]
        wrong = np.array([one.tracking for one in ours])
        found = [np.concatenate([one.found[slice(*part)] for one in ours if one.known])
                 for part in LATER.values()]
        table.append([tracker, *(f'{100 * wrong[:, slice(*part)].mean():.1f} %'
                                 for part in PARTS.values()),
                      *(f'{100 * np.mean(each):.0f} %' for each in found)])
    return table


def main() -> int:
    """Track all targets, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--sequences', type=Path, default=FOLDER)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--trackers',
                        default=f'gmpf,gmpf{WITHOUT_PENALTY},pqkpf,abmspf,appf,pf,dcf,opencv_csrt')
    arguments = parser.parse_args()
    trackers = arguments.trackers.split(',')
    if any(one.startswith('opencv') for one in trackers) and not needed_peers_found('gone.py'):
        return 2
    found, _ = folder_sequences(arguments.sequences, None)
    pairs = [(one, found[(index + step) % len(found)])
             for step in OTHERS for index, one in enumerate(found)]
    visits: dict[str, list[Visit]] = {}
    for tracker in trackers:
        visits[tracker] = list(Parallel(arguments.jobs)(
            delayed(visit)(tracker, *pair) for pair in pairs))
        print(tracker, *(rows({tracker: visits[tracker]}, half)[1] for half in HALVES),
              flush=True)
    tables = '\n\n'.join(f'## The {title}\n\n{markdown(rows(visits, half))}'
                         for half, title in HALVES.items())
    text = f"""# When the target has gone

Each of the {len(found)} targets of the shared videos is tracked for {KNOWN} frames. Then another
target's video, resized to the same size, replaces its own for {AWAY} frames; then its own goes on
where it stopped. Each target has {len(OTHERS)} runs, with different videos, seed 0. It isn't in
those, so TRACKING is wrong there: the first columns are the share of frames in state TRACKING, by
the number of frames since the target disappeared. The columns *back* are the share of frames after
its return that are TRACKING with an overlap above 0.5, in the runs that were on the target when it
disappeared. *Without its doubt*: without the penalty on the confidence of a target that was lost
for long ([decision 50](../decisions.md)). The state of `opencv_csrt` is the return value of its
update.

{facts_text(environment())}

{tables}
"""
    (ROOT / 'docs' / 'results' / 'gone.md').write_text(text, encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
