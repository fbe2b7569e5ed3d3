"""
What trackers say when the target has gone: another video comes in place of its own for a while.

`scripts/peers --python benchmarks/gone.py` follows the targets of the shared sequences and writes
docs/results/gone.md. Nothing of the target is in the other video, so every TRACKING is wrong.
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
#: Frames before the target goes, without it, and after it came back.
KNOWN, AWAY, BACK = 60, 300, 40
#: The frames without it, in parts.
PARTS = {'1': (0, 1), '2 to 10': (1, 10), '11 to 30': (10, 30), '31 to 100': (30, 100),
         '101 to 300': (100, 300)}
#: The frames after it came back.
LATER = {'1 to 10': (0, 10), '31 to 40': (30, 40)}
#: How far on in the list of targets is the one whose video comes in between.
OTHERS = (7, 11)
#: What stands behind the name of a tracker without the doubt of who was lost for long.
WITHOUT = ' without its doubt'


@dataclass(frozen=True)
class Visit:
    """A run: whether it was on the target last, and what it said without it, and on its return."""

    half: str
    known: bool
    tracking: NDArray[np.bool_]
    found: NDArray[np.bool_]


def interrupted(sequence: FolderSequence, other: FolderSequence) -> Iterator[Frame]:
    """Yield a sequence's frames with another one's in between, there and back, in its size."""
    own = list(islice(sequence.frames(), KNOWN + BACK))
    size = own[0].shape[1::-1]
    between = [cv2.resize(frame, size) for frame in islice(other.frames(), AWAY)]
    yield from own[:KNOWN]
    yield from (between[int(time)] for time in story_times(len(between), AWAY))
    yield from own[KNOWN:]


def visit(tracker: str, sequence: FolderSequence, other: FolderSequence) -> Visit:
    """Follow a target through another video."""
    name = tracker.removesuffix(WITHOUT)
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
    """Follow all targets, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--sequences', type=Path, default=FOLDER)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--trackers',
                        default=f'gmpf,gmpf{WITHOUT},pqkpf,abmspf,appf,pf,dcf,opencv_csrt')
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

Each of the {len(found)} targets of the shared videos is followed for {KNOWN} frames. Then comes
another target's video in place of its own, in the same size, for {AWAY} frames, and then its own
again where it was left; with {len(OTHERS)} other videos each, seed 0. Nothing of the target is in
the other one, so whoever says TRACKING there is wrong: the first columns are the shares of the
frames in which it's said, by how many frames ago the target went. The last ones are, of the runs
that were on the target when it went, the shares of frames in which it's TRACKING with half of
overlap after it came back. *Without its doubt*: of a target that was lost for long as of any other
([decision 50](../decisions.md)). `opencv_csrt` says it by the value that its update returns.

{facts_text(environment())}

{tables}
"""
    (ROOT / 'docs' / 'results' / 'gone.md').write_text(text, encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
