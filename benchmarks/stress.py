"""
Accuracy of every tracker under stress, beside `dcf`, on the shared sequences.

`python benchmarks/stress.py [--seeds K] [--frames N]` writes docs/results/stress.md and .json,
with the targets on which constants were tuned separate from the others. Each seed has random
changes of its own. With `--chart` it writes the chart of a scene, docs/images/stress.svg, instead.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
import sys

import numpy as np
from result_files import facts_text, interval_text, write_json
from sequences import interval
from shared_sequences import FOLDER, folder_sequences, is_tuned

from vtrack_ros.cli.progress import ProgressBar
from vtrack_ros.evaluation import parse_trackers
from vtrack_ros.evaluation.cache import default_folder, RunCache
from vtrack_ros.evaluation.charts import colour
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.sequences import scene_sequence
from vtrack_ros.evaluation.stress_kinds import STRESS_KINDS, stress_kinds
from vtrack_ros.evaluation.stress_report import stress_chart
from vtrack_ros.evaluation.stress_results import evaluate_stress, REFERENCE, StressResults
from vtrack_ros.evaluation.stress_table import influence_rows, stress_json
from vtrack_ros.evaluation.table import markdown, number_text
from vtrack_ros.frame import Array

ROOT = Path(__file__).resolve().parents[1]
#: Scene and kind of stress of the chart.
SCENE, KIND = 'scale_change', 'jumps'


def main(argv: list[str] | None = None) -> int:
    """Evaluate each half and write the results."""
    arguments = _arguments(argv)
    if arguments.chart:
        _write_chart(ROOT / 'docs' / 'images' / 'stress.svg', arguments)
        return 0
    found, broken = folder_sequences(arguments.sequences, arguments.frames)
    if arguments.only:
        wanted = arguments.only.split(',')
        if unknown := set(wanted) - {one.name for one in found}:
            print(f'no such targets: {", ".join(sorted(unknown))}', file=sys.stderr)
            return 2
        found = [one for one in found if one.name in wanted]
    halves = {'tuned': [one for one in found if is_tuned(one.name)],
              'others': [one for one in found if not is_tuned(one.name)]}
    results = {half: [evaluate_stress(
        parse_trackers(arguments.trackers), sequences, stress_kinds(arguments.kinds), [seed],
        arguments.jobs, ProgressBar(f'{half} {seed}'), RunCache(default_folder()), seed)
        for seed in range(arguments.seeds)] for half, sequences in halves.items() if sequences}
    problems = [f'{name}: {text}' for name, text in broken.items()]
    problems += [str(one) for each in results.values() for stress in each
                 for one in stress.plain.problems]
    for problem in problems:
        print(f'failed: {problem}', file=sys.stderr)
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_json(arguments.out / 'stress.json', {
        'environment': environment(), 'seeds': arguments.seeds, 'problems': problems,
        **{half: _shown(each) for half, each in results.items()}})
    page = _page(results, arguments)
    (arguments.out / 'stress.md').write_text(page, encoding='utf-8')
    print(page)
    return 1 if problems else 0


def _write_chart(path: Path, arguments: argparse.Namespace) -> None:
    """Write the chart of one kind of stress on one scene."""
    stress = evaluate_stress(parse_trackers(arguments.trackers), [scene_sequence(SCENE)], [KIND],
                             arguments.seeds, arguments.jobs, ProgressBar('runs'))
    colors = {tracker: colour(index) for index, tracker in enumerate(stress.plain.trackers)}
    chart = stress_chart(stress, KIND, colors, width=480, height=280, legend=True)
    path.write_text(chart + '\n', encoding='utf-8')


def figures(each: list[StressResults], kind: str | None, tracker: str,
            key: str = 'auc') -> Array:
    """
    Return a figure of a tracker, shape (targets, severities), the mean of several seeds' results.

    The kind None is no stress; it has one severity. `key` is a key of `Scores`, by default of AUC.
    """
    levels = [[one.plain] if kind is None else list(one.of_kind(kind).values()) for one in each]
    return np.mean([[[row.get(tracker, {}).get(key, math.nan)
                      for row in level.by_sequence.values()] for level in of_seed]
                    for of_seed in levels], axis=0).T


def coverage(each: list[StressResults], kind: str | None, tracker: str) -> float:
    """Return the share of true centres in a tracker's 90 % ellipse, the mean under one kind."""
    return float(np.nanmean(figures(each, kind, tracker, 'coverage90')))


def gain(each: list[StressResults], tracker: str,
         kinds: tuple[str | None, ...]) -> dict[str, float]:
    """
    Return target -> AUC of a tracker minus that of `dcf`; targets with a failed run are left out.

    It's the mean over these kinds of the mean over a kind's severities.
    """
    gains = np.mean([(figures(each, kind, tracker) - figures(each, kind, REFERENCE)).mean(axis=1)
                     for kind in kinds], axis=0)
    return {target: float(value) for target, value in zip(each[0].plain.sequences, gains)
            if np.isfinite(value)}


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--sequences', type=Path, default=FOLDER)
    parser.add_argument('--chart', action='store_true',
                        help=f'write the chart of {SCENE} alone')
    parser.add_argument('--only', metavar='A,B,...', help='only these targets')
    parser.add_argument('--frames', type=int, metavar='N', help='only the first frames of each')
    parser.add_argument('--trackers', default='all')
    parser.add_argument('--kinds', default='all', metavar='A,B,...')
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument('--jobs', type=int)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results')
    return parser.parse_args(argv)


def _shown(each: list[StressResults]) -> dict[str, object]:
    """Return what the page shows, and each target's mean under stress minus that of `dcf`."""
    first = each[0]
    trackers = list(first.plain.summary)
    changed = stress_json(first)['kinds']
    return {
        'kinds': {kind or 'plain': {
            'severities': list(first.of_kind(kind)) if kind else [],
            'auc': {tracker: np.nanmean(figures(each, kind, tracker), axis=0).tolist()
                    for tracker in trackers},
            'coverage90': {tracker: coverage(each, kind, tracker) for tracker in trackers},
            **({'changed': changed[kind]['changed']} if kind else {})}
            for kind in (None, *first.kinds)},
        'stress_mean_above_dcf': {
            tracker: gain(each, tracker, first.kinds)
            for tracker in trackers if tracker != REFERENCE}}


def _page(results: dict[str, list[StressResults]], arguments: argparse.Namespace) -> str:
    parts = [
        '# Under stress: every tracker and dcf\n\n'
        f'Made by `python benchmarks/stress.py --seeds {arguments.seeds}'
        + (f' --frames {arguments.frames}`, the first {arguments.frames} frames'
           if arguments.frames else '`')
        + ', each seed with random changes of its own. The kinds are described in '
        '[evaluate.md](../evaluate.md#under-stress). In the first table of each half, the column '
        'dcf is its mean AUC over targets and severities; the others are that of a tracker minus '
        'that of dcf, with the 95 % interval of a paired bootstrap over targets.\n\n'
        + facts_text(environment()) + '.\n']
    titles = {'tuned': 'The targets on which constants were tuned', 'others': 'The other targets'}
    for half, each in results.items():
        parts.append(f'## {titles[half]} ({len(each[0].plain.sequences)})\n\n'
                     f'{markdown(_rows(each))}\n\n'
                     f'Share of frames with the centre elsewhere than that of dcf, and median '
                     f'overlap gained in these frames (first seed):\n\n'
                     f'{markdown(influence_rows(each[0]))}\n\n'
                     f'Share of true centres inside the 90 % covariance ellipse, frames in which '
                     f'the target is hidden included:\n\n{markdown(_coverages(each))}\n\n'
                     f'AUC by severity:\n\n{markdown(_severities(each))}\n')
    return '\n'.join(parts)


def _rows(each: list[StressResults]) -> list[list[str]]:
    first = each[0]
    others = [tracker for tracker in first.plain.summary if tracker != REFERENCE]
    rows = [['', REFERENCE, *(f'{tracker} minus dcf' for tracker in others)]]
    every = {'plain': (None,), **{kind: (kind,) for kind in first.kinds}, '**mean**': first.kinds}
    for name, kinds in every.items():
        level = np.mean([np.nanmean(figures(each, kind, REFERENCE)) for kind in kinds])
        gains = [np.array(list(gain(each, tracker, kinds).values())) for tracker in others]
        rows.append([name, number_text(float(level), 'auc'), *(
            interval_text(interval(values)) if len(values) else '-' for values in gains)])
    return rows


def _coverages(each: list[StressResults]) -> list[list[str]]:
    trackers = list(each[0].plain.summary)
    return [['in the 90 % ellipse', *trackers], *(
        [kind or 'plain', *(number_text(coverage(each, kind, tracker), 'coverage90')
                            for tracker in trackers)]
        for kind in (None, *each[0].kinds))]


def _severities(each: list[StressResults]) -> list[list[str]]:
    first = each[0]
    rows = [['', *first.plain.summary]]
    for kind in first.kinds:
        means = np.array([np.nanmean(figures(each, kind, tracker), axis=0)
                          for tracker in first.plain.summary]).T
        rows += [[f'{kind} {severity:g} ({STRESS_KINDS[kind].unit})',
                  *(number_text(float(value), 'auc') for value in row)]
                 for severity, row in zip(first.of_kind(kind), means)]
    return rows


if __name__ == '__main__':
    sys.exit(main())
