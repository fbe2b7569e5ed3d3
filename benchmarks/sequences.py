"""
Accuracy of every tracker, and of OpenCV's, on the shared sequences.

`scripts/peers --python benchmarks/sequences.py [--seeds K]` writes docs/results/sequences.json and
.md, of the targets on which constants were tuned, and sequences_other.json and .md of the others;
it checks that the harness gives the same AUC of CSRT and KCF as an external one.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
import sys

import numpy as np
from result_files import facts_text, interval_text, write_json
from shared_sequences import FOLDER, folder_sequences, half_of

from vtrack_ros.cli.progress import ProgressBar
from vtrack_ros.evaluation import evaluate, parse_trackers, Results
from vtrack_ros.evaluation.cache import default_folder, RunCache
from vtrack_ros.evaluation.results_json import as_json
from vtrack_ros.evaluation.table import markdown, number_text, summary_table, TITLES
from vtrack_ros.frame import Array
from vtrack_ros.trackers import available_peers

ROOT = Path(__file__).resolve().parents[1]
#: (mean AUC over the sixteen targets by an external harness with OpenCV 5.0, tolerance).
REFERENCE = {'opencv_csrt': (0.58, 0.02), 'opencv_kcf': (0.25, 0.03)}
PAGES = {'tuned': 'sequences', 'others': 'sequences_other'}
TITLE = {'tuned': 'The sequences: every tracker and its peers',
         'others': 'Sixteen other targets'}
WHICH = {
    'tuned': 'Constants were chosen on these videos; the others are in '
             '[sequences_other.md](sequences_other.md).',
    'others': 'Constants were chosen on the videos of [sequences.md](sequences.md). On these '
              '(drones, a thermal camera, small and fast targets, camera shake) decisions were '
              'confirmed; the confidence threshold was chosen on both. Nothing was chosen on the '
              'videos of [davis.md](davis.md).'}
COLUMNS = ('auc', 'precision20', 'normalised_precision', 'rmse_mean', 'failures', 'auroc',
           'losses_reported', 'report_frames', 'false_alarms', 'wrong_tracking', 'coverage50',
           'coverage90', 'cpu_ms_median')


def main(argv: list[str] | None = None) -> int:
    """Evaluate, write the results and check the references."""
    arguments = _arguments(argv)
    if not needed_peers_found('sequences.py'):
        return 2
    sequences, broken = folder_sequences(arguments.sequences)
    problems = [f'{name}: {why}' for name, why in broken.items()]
    arguments.out.mkdir(parents=True, exist_ok=True)
    holds = True
    for half, page in PAGES.items():
        results = evaluate(
            parse_trackers(arguments.trackers),
            [one for one in sequences if half_of(one.name) == half], arguments.seeds,
            arguments.jobs, ProgressBar(half), RunCache(default_folder()))
        problems += map(str, results.problems)
        print(summary_table(results))
        write_json(arguments.out / f'{page}.json', _shown(results))
        (arguments.out / f'{page}.md').write_text(_page(results, half), encoding='utf-8')
        holds = holds and (half != 'tuned' or _references_hold(results))
    for problem in problems:
        print(f'failed: {problem}', file=sys.stderr)
    return 1 if problems or not holds else 0


def needed_peers_found(call: str) -> bool:
    """Tell whether OpenCV has CSRT and KCF; if not, print how to call a benchmark with them."""
    found = {'opencv_csrt', 'opencv_kcf'} <= set(available_peers())
    if not found:
        print('this OpenCV has neither CSRT nor KCF; run it as\n'
              f'  scripts/peers --python benchmarks/{call}', file=sys.stderr)
    return found


def difference(results: Results, tracker: str, other: str) -> tuple[float, float, float]:
    """
    Return the mean difference of two trackers' AUC, and its 95 % bootstrap interval over targets.

    Parameters
    ----------
    results : Results
        Results that contain both.
    tracker, other : str
        Labels; positive where the first is better.

    """
    rows = [row for row in results.by_sequence.values() if tracker in row and other in row]
    return interval(np.array([row[tracker]['auc'] - row[other]['auc'] for row in rows]))


def interval(gaps: Array) -> tuple[float, float, float]:
    """Return the mean of one value for each target, and its 95 % bootstrap interval."""
    draws = np.random.default_rng(0).integers(0, len(gaps), (10000, len(gaps)))
    low, high = np.percentile(gaps[draws].mean(axis=1), [2.5, 97.5])
    return float(gaps.mean()), float(low), float(high)


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--sequences', type=Path, default=FOLDER)
    parser.add_argument('--trackers', default='all,opencv_csrt,opencv_kcf')
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument('--jobs', type=int)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results')
    return parser.parse_args(argv)


def _references_hold(results: Results) -> bool:
    holds = True
    for peer, (expected, tolerance) in REFERENCE.items():
        if peer not in results.summary:
            continue
        measured = results.summary[peer]['auc']
        good = abs(measured - expected) <= tolerance
        holds = holds and good
        print(f'{peer}: AUC {measured:.3f}, outside harness {expected:.2f} +- {tolerance:.2f}: '
              f'{"agrees" if good else "DISAGREES"}')
    return holds


def _shown(results: Results) -> dict[str, object]:
    """Return what the page shows, as JSON."""
    whole = as_json(results)
    return {
        **{key: whole[key] for key in ('environment', 'seeds', 'timings', 'problems')},
        'sequences': {name: {tracker: row['auc'] for tracker, row in rows.items()}
                      for name, rows in whole['sequences'].items()},
        'summary': {tracker: {key: row[key] for key in (*COLUMNS, 'auc_std')}
                    for tracker, row in whole['summary'].items()}}


def _page(results: Results, half: str) -> str:
    ranked = sorted(results.summary, key=lambda label: -results.summary[label]['auc'])
    seeds = len(results.seeds)
    head = (
        f'# {TITLE[half]}\n\n'
        f'{len(results.sequences)} targets, all frames, {seeds} seed{"s" * (seeds != 1)}, the '
        f'same defaults for all, one pass from the first true box, one thread. {WHICH[half]} Made '
        'by `scripts/peers --python benchmarks/sequences.py`; the figures are explained in '
        '[evaluate.md](../evaluate.md).\n\n'
        + facts_text(as_json(results)['environment'])
        + f'. Times ({results.timings}): median processor time of an update.\n')
    rows = [['tracker', *(TITLES[key] for key in COLUMNS), 'AUC minus CSRT [95 %]']]
    for label in ranked:
        scores = results.summary[label]
        cells = [number_text(scores[key], key) for key in COLUMNS]
        if scores['auc_std']:
            cells[0] += f' ± {scores["auc_std"]:.3f}'
        rows.append([label, *cells, _gap(results, label)])
    by_sequence = [['target', *ranked]]
    for name, row in results.by_sequence.items():
        by_sequence.append([name, *(number_text(
            row.get(label, {}).get('auc', math.nan), 'auc') for label in ranked)])
    return (f'{head}\n## Means over the targets\n\n{markdown(rows)}\n\n'
            'Overlap, centre error and calibration are means over the targets; AUROC is over all '
            'frames together. The interval is from a bootstrap over the targets. The peers give '
            'no covariance; their confidence is only whether the target was found.\n\n'
            f'## AUC by target\n\n{markdown(by_sequence)}\n'
            + (f'\n{_checks(results)}' if half == 'tuned' else ''))


def _gap(results: Results, label: str) -> str:
    if label == 'opencv_csrt' or 'opencv_csrt' not in results.summary:
        return '-'
    return interval_text(difference(results, label, 'opencv_csrt'))


def _checks(results: Results) -> str:
    lines = ['## Does the harness measure right?', '']
    for peer, (expected, tolerance) in REFERENCE.items():
        if peer in results.summary:
            measured = results.summary[peer]['auc']
            verdict = 'agrees' if abs(measured - expected) <= tolerance else 'does not agree'
            lines.append(f'- {peer}: mean AUC {measured:.3f} here, {expected:.2f} by an external '
                         f'harness; within {tolerance:.2f} it {verdict}.')
    return '\n'.join(lines) + '\n'


if __name__ == '__main__':
    sys.exit(main())
