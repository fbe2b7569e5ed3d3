"""
Whether the models keep their target for long: each shared video there and back, again and again.

`python benchmarks/long_runs.py [--frames N]` writes docs/results/long_runs.md: trackers as they
are, and without the search of the whole frame.
"""

from __future__ import annotations

from pathlib import Path

from ingredients import ALL, without
from joblib import delayed, Parallel
import numpy as np
from result_files import facts_text
from shared_sequences import folder_sequences, options

from vtrack_ros.evaluation import FolderSequence
from vtrack_ros.evaluation.metrics import off_target, overlaps
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.runner import one_thread, run_tracker
from vtrack_ros.evaluation.table import markdown
from vtrack_ros.frame import Array
from vtrack_ros.scenes.catalogue import story_times
from vtrack_ros.trackers import create_tracker

ROOT = Path(__file__).resolve().parents[1]
#: Parts of a run, from its beginning to its end.
PARTS = 3
#: What is left out in every second row, by what stands behind the tracker's name.
LEFT_OUT = {'': ALL, ' without': 'the global search'}


def follow(sequence: FolderSequence, tracker: str, frames: int, left_out: str) -> Array:
    """Return the mean overlap in each part of a run, and the share of wrong boxes."""
    shown = [int(time) for time in story_times(len(sequence), frames)]
    video = list(sequence.frames())
    with without(left_out), one_thread():
        run = run_tracker(
            create_tracker(tracker, seed=0), (video[index] for index in shown),
            sequence.first_box)
    overlap = overlaps(run.boxes, sequence.truth[shown])
    wrong = run.measured & off_target(overlap)
    return np.array([*map(np.nanmean, np.array_split(overlap, PARTS)), wrong.mean()])


def main() -> None:
    """Follow all targets, and write the page."""
    parser = options(__doc__)
    parser.set_defaults(frames=1500)
    parser.add_argument('--trackers', default='gmpf,dcf')
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results' / 'long_runs.md')
    arguments = parser.parse_args()
    found, _ = folder_sequences(arguments.sequences, None)
    rows = [['tracker', *(f'{part + 1}. third' for part in range(PARTS)), 'wrong']]
    for tracker in arguments.trackers.split(','):
        for behind, left_out in LEFT_OUT.items():
            scores = np.array(Parallel(arguments.jobs)(delayed(follow)(
                one, tracker, arguments.frames, left_out) for one in found))
            rows.append([tracker + behind, *(f'{value:.3f}' for value in scores.mean(axis=0))])
            print(rows[-1], flush=True)
    text = f"""# Long runs

Each of the {len(found)} targets of the shared videos, there and back for {arguments.frames}
frames, seed 0, one pass: the mean overlap with the truth in each third of the run, and the share
of frames in which the tracker said TRACKING with less than a tenth of overlap. *Without* is
without the search of the whole frame ([decision 29](../decisions.md)). A few videos kept or lost
by chance make .03 of difference; and each of these videos comes back to what it began with, as not
every camera does.

{facts_text(environment())}

{markdown(rows)}
"""
    arguments.out.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main()
