"""
A network under a filter beside the same network alone, as OpenCV's TrackerNano runs it.

`VTRACK_NANOTRACK=FOLDER python benchmarks/localisers.py [--seeds K] [--frames N]` writes
docs/results/localisers.json and .md; the folder has nanotrack_backbone_sim.onnx and
nanotrack_head_sim.onnx. Under stress, a seed is that of the random changes and of the trackers.
Runs are cached as by `vtrack evaluate`: after an interruption, finished ones aren't run again.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
import os
from pathlib import Path
import sys

import numpy as np
from result_files import facts_text, interval_text, write_json
from sequences import difference, interval
from shared_sequences import FOLDER as SEQUENCES, folder_sequences, is_tuned

from vtrack_ros.cli.progress import ProgressBar
from vtrack_ros.evaluation import evaluate, Results, TrackerSpecification
from vtrack_ros.evaluation.cache import default_folder, RunCache
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.stress import stressed_sequences
from vtrack_ros.evaluation.stress_kinds import STRESS_KINDS, stress_kinds
from vtrack_ros.evaluation.table import markdown, number_text, TITLES
from vtrack_ros.frame import Array

ROOT = Path(__file__).resolve().parents[1]
FOLDER = 'VTRACK_NANOTRACK'
DCF, SIAMESE, ALONE = 'gmpf, dcf', 'gmpf, siamese', 'opencv_nano'
COLUMNS = ('auc', 'auroc', 'coverage90', 'false_alarms', 'wrong_tracking', 'cpu_ms_median',
           'ms_p99')


def main(argv: list[str] | None = None) -> int:
    """Evaluate, and write the results."""
    arguments = _arguments(argv)
    if FOLDER not in os.environ:
        print(f'{FOLDER} has to name the folder of the networks', file=sys.stderr)
        return 2
    trackers = trackers_with_network(Path(os.environ[FOLDER]))
    whole, _ = folder_sequences(arguments.sequences, arguments.frames or None)
    short, _ = folder_sequences(arguments.sequences, arguments.stressed or None)
    cache = RunCache(default_folder())
    plain = evaluate(trackers, whole, arguments.seeds, arguments.jobs, ProgressBar('runs'), cache)
    kinds = [kind for kind in stress_kinds(arguments.kinds) if STRESS_KINDS[kind].plan is not None]
    networks = [one for one in trackers if one.label != DCF]
    under = [evaluate(networks, stressed_sequences(short, kinds, seed, with_content=True), [seed],
                      arguments.jobs, ProgressBar(f'stress {seed}'), cache)
             for seed in range(arguments.stress_seeds)]
    stressed = {kind: {one.label: by_target(under, kind, one.label) for one in networks}
                for kind in kinds}
    problems = [str(one) for results in (plain, *under) for one in results.problems]
    for problem in problems:
        print(f'failed: {problem}', file=sys.stderr)
    write_json(arguments.out / 'localisers.json', {
        'environment': environment(), 'seeds': arguments.seeds, 'problems': problems,
        'plain': {name: {tracker: row['auc'] for tracker, row in rows.items()}
                  for name, rows in plain.by_sequence.items()},
        'stressed': {kind: {tracker: np.round(auc, 4).tolist() for tracker, auc in of_kind.items()}
                     for kind, of_kind in stressed.items()}})
    page = _page(plain, stressed, arguments)
    (arguments.out / 'localisers.md').write_text(page, encoding='utf-8')
    print(page)
    return 1 if problems else 0


def trackers_with_network(folder: Path) -> list[TrackerSpecification]:
    """Return `gmpf` with and without the network, and the network alone."""
    backbone, head = (str(folder / f'nanotrack_{part}_sim.onnx') for part in ('backbone', 'head'))
    return [
        TrackerSpecification(DCF, 'gmpf'),
        TrackerSpecification(SIAMESE, 'gmpf', (
            ('localiser', 'siamese'), ('siamese.backbone', backbone), ('siamese.head', head))),
        TrackerSpecification(ALONE, 'opencv_nano', (('backbone', backbone), ('head', head)))]


def by_target(results: list[Results], kind: str, tracker: str) -> Array:
    """Return a tracker's AUC under a kind of stress, shape (targets,), the mean of its runs."""
    found = defaultdict(list)
    for one in results:
        for name, sequence in one.sequences.items():
            if sequence.kind == kind:
                found[sequence.original.name].append(one.by_sequence[name][tracker]['auc'])
    return np.array([np.mean(each) for each in found.values()])


def severities(kind: str) -> str:
    """Return the severities of a kind of stress, as a page shows them."""
    return ', '.join(f'{severity:g}' for severity in STRESS_KINDS[kind].severities)


def _page(plain: Results, stressed: dict[str, dict[str, Array]],
          arguments: argparse.Namespace) -> str:
    rows = [['', *(TITLES[key] for key in COLUMNS), 'AUC, tuned targets', 'others',
             f'AUC minus {ALONE} [95 %]']]
    for label, scores in plain.summary.items():
        halves = ([row[label]['auc'] for name, row in plain.by_sequence.items()
                   if is_tuned(name) is tuned] for tuned in (True, False))
        rows.append([label, *(number_text(scores[key], key) for key in COLUMNS),
                     *(f'{np.mean(half):.3f}' for half in halves),
                     '-' if label == ALONE else interval_text(difference(plain, label, ALONE))])
    under = [['', SIAMESE, ALONE, f'{SIAMESE}, minus {ALONE} [95 %]']]
    rates = {f'{kind} {severities(kind)} ({STRESS_KINDS[kind].unit})': list(of_kind.values())
             for kind, of_kind in stressed.items()}
    rates['**mean**'] = np.mean(list(rates.values()), axis=0)
    for kind, (ours, alone) in rates.items():
        under.append([kind, f'{ours.mean():.3f}', f'{alone.mean():.3f}',
                      interval_text(interval(ours - alone))])
    by_target = [['target', DCF, SIAMESE, ALONE]]
    by_target += [[name, *(f'{row[label]["auc"]:.3f}' for label in (DCF, SIAMESE, ALONE))]
                  for name, row in plain.by_sequence.items()]
    length, stressed_length = (
        f'the first {frames} frames' if frames else 'all frames'
        for frames in (arguments.frames, arguments.stressed))
    return (
        '# Localisers: a network under a filter, and alone\n\n'
        f'Made by `{FOLDER}=FOLDER python benchmarks/localisers.py --frames {arguments.frames} '
        f'--seeds {arguments.seeds} --stress-seeds {arguments.stress_seeds}` with the public '
        f'weights of NanoTrack V2 ([localisers.md](../localisers.md)): {len(plain.sequences)} '
        f'targets, {length} of each, seeds: {arguments.seeds}, one thread. The figures are '
        'explained in [evaluate.md](../evaluate.md); intervals are from a bootstrap over the '
        f'targets.\n\n{facts_text(environment())}.\n\n## As they are\n\n{markdown(rows)}\n\n'
        f'{ALONE} has no covariance; its score is taken as the confidence, and it never reports '
        'the target as lost. *cpu ms* is processor time, *ms p99* wall-clock time; both depend on '
        f'the other load of the machine (times: {plain.timings}).\n\n'
        f'## Under stress\n\nAUC over {stressed_length}, seeds: {arguments.stress_seeds}, '
        f'mean over the severities of each kind.\n\n{markdown(under)}\n\n'
        f'## AUC by target, as they are\n\n{markdown(by_target)}\n')


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--sequences', type=Path, default=SEQUENCES)
    parser.add_argument('--frames', type=int, default=150, help='0: all')
    parser.add_argument('--stressed', type=int, default=100, metavar='FRAMES', help='0: all')
    parser.add_argument('--kinds', default='all', metavar='A,B,...')
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument('--stress-seeds', type=int, default=5, metavar='K')
    parser.add_argument('--jobs', type=int)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results')
    return parser.parse_args(argv)


if __name__ == '__main__':
    sys.exit(main())
