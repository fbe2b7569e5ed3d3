"""
Accuracy of every tracker under stress, beside `dcf`, on the shared sequences.

`python benchmarks/stress.py [--seeds K]` writes docs/results/stress.md and .json, those targets on
which constants were tuned apart from the others; with `--chart`, instead, the chart of a scene in
docs/images/stress.svg.
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

ROOT = Path(__file__).resolve().parents[1]
#: What the chart shows.
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
    results = {half: evaluate_stress(
        parse_trackers(arguments.trackers), sequences, stress_kinds(arguments.kinds),
        arguments.seeds, arguments.jobs, ProgressBar('runs'), RunCache(default_folder()))
        for half, sequences in halves.items() if sequences}
    problems = [f'{name}: {text}' for name, text in broken.items()]
    problems += [str(one) for stress in results.values() for one in stress.plain.problems]
    for problem in problems:
        print(f'failed: {problem}', file=sys.stderr)
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_json(arguments.out / 'stress.json', {
        'environment': environment(), 'seeds': arguments.seeds, 'problems': problems,
        **{half: _shown(stress) for half, stress in results.items()}})
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


def gaps(stress: StressResults, tracker: str, kinds: tuple[str, ...]) -> dict[str, float]:
    """
    Return the AUC under stress above that of `dcf`, of each target that both ran on everywhere.

    Parameters
    ----------
    stress : StressResults
        Where both are in.
    tracker : str
        Its label.
    kinds : tuple of str
        The mean over these kinds, of the mean over a kind's severities; without any, no stress.

    """
    result = {}
    for place, target in enumerate(stress.plain.sequences):
        differences = []
        for kind in kinds or (None,):
            levels = [stress.plain] if kind is None else stress.of_kind(kind).values()
            rows = [list(level.by_sequence.values())[place] for level in levels]
            differences.append(np.mean([
                row.get(tracker, {}).get('auc', math.nan)
                - row.get(REFERENCE, {}).get('auc', math.nan) for row in rows]))
        if np.isfinite(differences).all():
            result[target] = float(np.mean(differences))
    return result


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


def _shown(stress: StressResults) -> dict[str, object]:
    """Return what the page shows, and each target's stress mean above `dcf`."""
    whole = stress_json(stress)
    return {
        'plain': {tracker: row['auc'] for tracker, row in stress.plain.summary.items()},
        'mean_auc': whole['mean_auc'],
        'kinds': {kind: {key: row[key] for key in ('severities', 'auc', 'changed')}
                  for kind, row in whole['kinds'].items()},
        'stress_mean_above_dcf': {
            tracker: gaps(stress, tracker, stress.kinds) for tracker in stress.plain.trackers
            if tracker != REFERENCE}}


def _page(results: dict[str, StressResults], arguments: argparse.Namespace) -> str:
    parts = [
        '# Under stress: every tracker beside dcf\n\n'
        f'Made by `python benchmarks/stress.py`, seeds: {arguments.seeds}'
        + (f', first {arguments.frames} frames' if arguments.frames else '')
        + '. What the kinds are stands in [evaluate.md](../evaluate.md#under-stress). Each cell '
        'is the mean AUC over targets and severities, for dcf itself, and for the others how much '
        'it is above that of dcf, with the 95 % interval of a paired bootstrap over targets.\n\n'
        + facts_text(environment()) + '.\n']
    titles = {'tuned': 'The targets on which constants were tuned', 'others': 'The other targets'}
    for half, stress in results.items():
        parts.append(f'## {titles[half]} ({len(stress.plain.sequences)})\n\n'
                     f'{markdown(_rows(stress))}\n\n'
                     f'Share of frames with the centre elsewhere than that of dcf, and the median '
                     f'overlap gained there:\n\n{markdown(influence_rows(stress))}\n\n'
                     f'AUC by severity:\n\n{markdown(_severities(stress))}\n')
    return '\n'.join(parts)


def _rows(stress: StressResults) -> list[list[str]]:
    others = [tracker for tracker in stress.plain.summary if tracker != REFERENCE]
    rows = [['', REFERENCE, *(f'{tracker} above it' for tracker in others)]]
    every = {'plain': (), **{kind: (kind,) for kind in stress.kinds}, '**mean**': stress.kinds}
    for name, kinds in every.items():
        level = np.mean([np.mean(stress.auc(kind, REFERENCE)[1:]) for kind in kinds]
                        or [stress.plain.summary[REFERENCE]['auc']])
        cells = []
        for tracker in others:
            values = np.array(list(gaps(stress, tracker, kinds).values()))
            cells.append(interval_text(interval(values)) if len(values) else '-')
        rows.append([name, number_text(float(level), 'auc'), *cells])
    return rows


def _severities(stress: StressResults) -> list[list[str]]:
    trackers = list(stress.plain.summary)
    rows = [['', *trackers]]
    for kind in stress.kinds:
        for place, severity in enumerate(stress.of_kind(kind), start=1):
            rows.append([f'{kind} {severity:g} ({STRESS_KINDS[kind].unit})', *(
                number_text(stress.auc(kind, tracker)[place], 'auc') for tracker in trackers)])
    return rows


if __name__ == '__main__':
    sys.exit(main())
