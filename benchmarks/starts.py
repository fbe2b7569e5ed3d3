"""
Accuracy from other frames than the first one: figures that no choice of a constant was made by.

`python benchmarks/starts.py [--trackers gmpf,dcf] [--frames N]` tracks each target of the shared
sequences, of which it takes the first 150 frames, or N (0: all), from eight starts: forwards from
the first frame and from 15, 30, 45 and 60 % of them, backwards from the last frame and from 80 and
60 %. It prints the mean AUC of both halves of the videos, from the first frame and from the other
starts, and its difference from that of the last tracker named; and how far what the tracker says
of itself is true: TRACKING off the target, false alarms, and the covariance.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
import sys

import numpy as np
from result_files import interval_text
from sequences import interval
from shared_sequences import folder_sequences, half_of, HALVES, options

from vtrack_ros.cli.progress import ProgressBar
from vtrack_ros.evaluation import evaluate, FolderSequence, parse_trackers
from vtrack_ros.evaluation.cache import default_folder, RunCache
from vtrack_ros.evaluation.scoring import mean
from vtrack_ros.frame import Array

#: Figures of what the tracker says of itself, and what they are called.
SAID = {'wrong_tracking': 'TRACKING off the target', 'false_alarms': 'false alarms',
        'coverage90': 'centres in the 90 % ellipse'}
#: Starts, as shares of the sequence.
FORWARDS, BACKWARDS = (0.0, 0.15, 0.3, 0.45, 0.6), (1.0, 0.8, 0.6)


def means(targets: dict[str, list[dict[str, float]]], key: str) -> Array:
    """Return a figure's mean over each target's starts; NaN where it's undefined in all."""
    return np.array([mean([figures[key] for figures in runs]) for runs in targets.values()])


def started(one: FolderSequence) -> list[FolderSequence]:
    """Return a sequence for each start, in order, from the next frame with the target on."""
    count = len(one)
    orders = [np.arange(int(start * count), count) for start in FORWARDS]
    orders += [np.arange(int(start * count))[::-1] for start in BACKWARDS]
    result = []
    for index, order in enumerate(orders):
        order = order[int(np.isfinite(one.truth[order]).all(axis=1).argmax()):]
        result.append(replace(one, name=f'{one.name}.start{index}', truth=one.truth[order],
                              images=tuple(one.images[at] for at in order)))
    return result


def main() -> int:
    """Measure and print."""
    parser = options(__doc__)
    parser.add_argument('--trackers', default='gmpf,dcf')
    parser.add_argument('--seeds', type=int, default=1)
    arguments = parser.parse_args()
    sequences, broken = folder_sequences(arguments.sequences, arguments.frames or None)
    results = evaluate(
        parse_trackers(arguments.trackers), [each for one in sequences for each in started(one)],
        arguments.seeds, arguments.jobs, ProgressBar('starts'), RunCache(default_folder()))
    for half in HALVES:
        for title, first in (('first frame', True), ('other starts', False)):
            runs: dict[str, dict[str, list[dict[str, float]]]] = defaultdict(
                lambda: defaultdict(list))
            for name, row in results.by_sequence.items():
                target, start = name.rsplit('.start', 1)
                if half_of(target) == half and (start == '0') is first:
                    for tracker, figures in row.items():
                        runs[tracker][target].append(figures)
            base = list(runs)[-1]
            for tracker, targets in runs.items():
                auc = means(targets, 'auc')
                above = '' if tracker == base else (
                    f', above {base} {interval_text(interval(auc - means(runs[base], "auc")))}')
                said = ', '.join(f'{text} {100 * mean(means(targets, key)):.1f} %'
                                 for key, text in SAID.items())
                print(f'{half}, {title}: {tracker} {auc.mean():.3f}{above}; {said}')
    for problem in [*broken.values(), *results.problems]:
        print(f'failed: {problem}', file=sys.stderr)
    return 1 if broken or results.problems else 0


if __name__ == '__main__':
    sys.exit(main())
