"""
Whether the models keep their target for long: each shared video there and back, again and again.

`python benchmarks/long_runs.py [--frames N] [--seeds N]` writes docs/results/long_runs.md: the
trackers, and the same without the global search.
"""

from __future__ import annotations

from pathlib import Path

from ingredients import ALL, without
from joblib import delayed, Parallel
import numpy as np
from result_files import facts_text, interval_text
from sequences import interval
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
#: Number of parts of a run with a mean overlap each.
PARTS = 3
#: Suffix of the tracker's name in the table -> ingredient left out.
LEFT_OUT = {'': ALL, ' without global search': 'the global search'}


def follow(sequence: FolderSequence, tracker: str, seed: int, frames: int,
           left_out: str) -> Array:
    """Return the mean overlap in each part of a run, and the share of wrong boxes."""
    shown = [int(time) for time in story_times(len(sequence), frames)]
    video = list(sequence.frames())
    with without(left_out), one_thread():
        run = run_tracker(
            create_tracker(tracker, seed=seed), (video[index] for index in shown),
            sequence.first_box)
    overlap = overlaps(run.boxes, sequence.truth[shown])
    wrong = run.measured & off_target(overlap)
    return np.array([*map(np.nanmean, np.array_split(overlap, PARTS)), wrong.mean()])


def main() -> None:
    """Track all targets, and write the page."""
    parser = options(__doc__)
    parser.set_defaults(frames=1500)
    parser.add_argument('--trackers', default='gmpf,dcf')
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results' / 'long_runs.md')
    arguments = parser.parse_args()
    found, _ = folder_sequences(arguments.sequences, None)
    jobs = [(one, seed) for one in found for seed in range(arguments.seeds)]
    rows = [['tracker', *(f'{part + 1}. third' for part in range(PARTS)), 'wrong',
             'global search: 3. third']]
    for tracker in arguments.trackers.split(','):
        means = {behind: np.array(Parallel(arguments.jobs)(delayed(follow)(
            one, tracker, seed, arguments.frames, left_out) for one, seed in jobs))
            .reshape(len(found), arguments.seeds, PARTS + 1).mean(axis=1)
            for behind, left_out in LEFT_OUT.items()}
        every, without_search = (values[:, PARTS - 1] for values in means.values())
        gains = [interval_text(interval(every - without_search)), '']
        for (behind, values), gain in zip(means.items(), gains):
            scores = [f'{value:.3f}' for value in values.mean(axis=0)]
            rows.append([tracker + behind, *scores, gain])
            print(rows[-1], flush=True)
    text = f"""# Long runs

Each of the {len(found)} targets of the shared videos, played forwards and backwards for
{arguments.frames} frames, mean of {arguments.seeds} seeds: mean overlap with the true box in each
third of the run, and share of frames in state TRACKING with an overlap below 0.1 (*wrong*). The
global search covers the whole frame (decisions [29](../decisions.md) and [58](../decisions.md));
the last column is what it gains in the last third, with the 95 % interval of a paired bootstrap
over the targets. Played backwards, each video returns to its first view, which a real camera may
not do.

{facts_text(environment())}

{markdown(rows)}
"""
    arguments.out.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main()
