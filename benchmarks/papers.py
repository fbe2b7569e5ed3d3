"""
The experiments of the four papers, on rendered scenes and on the real David.

Runs the trackers with the papers' own cues (preset `paper`) and with the defaults, and writes
`docs/results/papers.json` and the tables between the marks in `docs/results/papers.md`. Runs are
kept, and only what has changed is run again; `--no-cache` also measures all times anew.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
import json
import math
from pathlib import Path
import re
from typing import Any

import numpy as np

from vtrack_ros.evaluation import evaluate
from vtrack_ros.evaluation.cache import default_folder, RunCache
from vtrack_ros.evaluation.environment import environment
from vtrack_ros.evaluation.results import Results
from vtrack_ros.evaluation.results_json import as_json
from vtrack_ros.evaluation.scene_sequence import scene_sequence
from vtrack_ros.evaluation.sequences import read_folder, Sequence
from vtrack_ros.evaluation.table import markdown

ROOT = Path(__file__).resolve().parents[1]
#: A run has finished when it's on the target, on average, in this many last frames.
LAST_FRAMES, LAST_OVERLAP = 10, 0.3
#: A run has followed when it has finished, and was this much on the target in so many frames.
FOLLOWED_OVERLAP, FOLLOWED_SHARE = 0.3, 0.75
PRESETS = ('paper', 'default')
Row = dict[str, float]
#: (tracker, parameters but for the preset) by the name in the tables.
Trackers = dict[str, tuple[str, str]]


@dataclass
class Experiment:
    """
    What a paper's experiments gave.

    Parameters
    ----------
    tables : dict
        Title -> name in the table -> figures.
    claims : list
        [claim, what came out, whether it held].

    """

    tables: dict[str, dict[str, Row]] = field(default_factory=dict)
    claims: list[tuple[str, str, bool]] = field(default_factory=list)

    def claim(self, text: str, outcome: str, held: bool) -> None:
        """Note a claim beside what came out."""
        self.claims.append((text, outcome, bool(held)))


Measure = Callable[[Iterable[Sequence], Trackers, str], dict[str, dict[str, Row]]]


def paper1(measure: Measure, _: Path) -> Experiment:
    """GMPF: a fast face, tables 2 and 3, and football."""
    result = Experiment()
    face, football = scene_sequence('face_fast'), scene_sequence('football')
    names = {'PF': 'pf', 'KPF': 'kpf', 'UPF': 'upf', 'GMPF': 'gmpf'}
    for preset in PRESETS:
        table = measure([face], {
            label: (name, 'particles=40') for label, name in names.items()}, preset)['face_fast']
        result.tables[f'face_fast, N = 40, m = 5, {preset}'] = table
        best = min(table, key=lambda label: table[label]['cei'])
        result.claim(f'face_fast ({preset}): CEI of GMPF is the best of the four',
                     f'best is {best}; ' + _listed(table, 'cei', 3), best == 'GMPF')
        ratio = table['GMPF']['rmse_mean'] / table['PF']['rmse_mean']
        result.claim(f'face_fast ({preset}): RMSE mean of GMPF at most a third of that of PF',
                     f'{ratio:.2f} of it; ' + _listed(table, 'rmse_mean', 2), ratio <= 1 / 3)
    counts = measure([face], {
        f'N = {count}': ('gmpf', f'particles={count},window=4') for count in (50, 100, 150, 200)},
        'paper')['face_fast']
    result.tables['Table 2: GMPF by number of particles, m = 4, paper'] = counts
    best = min(counts, key=lambda label: counts[label]['cei'])
    result.claim('Table 2: N = 150 has the best CEI of 50, 100, 150, 200',
                 f'best is {best}; ' + _listed(counts, 'cei', 3), best == 'N = 150')
    lengths = (4, 6, 8, 10)
    result.tables['Table 3: GMPF by length of the series, N = 100, paper'] = measure([face], {
        f'm = {window}': ('gmpf', f'particles=100,window={window}') for window in lengths},
        'paper')['face_fast']
    windows = measure([face], {
        f'm = {window}': ('gmpf', f'particles=100,window={window},prior_share=0')
        for window in lengths}, 'paper')['face_fast']
    result.tables['Table 3 without particles of the prior, as printed'] = windows
    errors = {label: row['rmse_mean'] for label, row in windows.items()}
    result.claim('Table 3, as printed: m = 4 and m = 6 are good, m = 8 is worse, m = 10 loses '
                 'the target',
                 _listed(windows, 'rmse_mean', 2) + '; finished: '
                 + _listed(windows, 'finished', 1),
                 max(errors['m = 4'], errors['m = 6']) < errors['m = 8'] < errors['m = 10']
                 and windows['m = 4']['finished'] >= 0.6 and windows['m = 10']['finished'] < 0.5)
    for preset in PRESETS:
        table = measure([football], {
            label: (name, 'particles=150') for label, name in names.items()}, preset)['football']
        result.tables[f'football, N = 150, m = 5, {preset}'] = table
        others = [row['finished'] for label, row in table.items() if label != 'GMPF']
        result.claim(f'football ({preset}): GMPF finishes, PF, KPF and UPF are lost',
                     'finished: ' + _listed(table, 'finished', 1),
                     table['GMPF']['finished'] >= 0.6 and max(others) < 0.5)
    return result


def paper2(measure: Measure, _: Path) -> Experiment:
    """P-QKPF: occlusion by somebody alike, and a change of pose."""
    result = Experiment()
    scenes = [scene_sequence('similar_occlusion'), scene_sequence('pose_change')]
    kernel = 'particles=100,kernel=epanechnikov'  # the paper's, for the baselines too
    both = f'{kernel},cues=colour+motion_edge'
    trackers = {
        'P-QKPF, Dempster-Shafer': ('pqkpf', f'{both},fusion=dempster_shafer'),
        'P-QKPF, product': ('pqkpf', f'{both},fusion=product'),
        'P-QKPF, sum': ('pqkpf', f'{both},fusion=sum'),
        'P-QKPF, colour alone': ('pqkpf', f'{kernel},cues=colour'),
        'PF, colour': ('pf', f'{kernel},cues=colour'),
        'PF, both cues': ('pf', both)}
    for scene, table in measure(scenes, trackers, 'paper').items():
        result.tables[f'{scene}, N = 100, paper'] = table
        ours, base = table['P-QKPF, Dempster-Shafer']['rmse_mean'], table['PF, colour'][
            'rmse_mean']
        result.claim(f'{scene} (paper): position error of P-QKPF at least 32 % below colour PF',
                     f'{100 * (ours / base - 1):+.0f} %: {ours:.1f} px against {base:.1f} px',
                     ours <= 0.68 * base)
    plain = {'P-QKPF': ('pqkpf', 'particles=100'), 'PF': ('pf', 'particles=100')}
    for scene, table in measure(scenes, plain, 'default').items():
        result.tables[f'{scene}, N = 100, default'] = table
        ours, base = (table[label]['rmse_mean'] for label in plain)
        colour = result.tables[f'{scene}, N = 100, paper']['PF, colour']['rmse_mean']
        result.claim(
            f'{scene} (default): position error of P-QKPF at least 32 % below colour PF (paper)',
            f'{100 * (ours / colour - 1):+.0f} %: {ours:.1f} px against {colour:.1f} px; '
            f'PF with the same default cues {base:.1f} px', ours <= 0.68 * colour)
    return result


def paper3(measure: Measure, _: Path) -> Experiment:
    """ABMSPF: changes of light and size, and full occlusion."""
    result = Experiment()
    scenes = [scene_sequence(name) for name in ('light_change', 'scale_change', 'full_occlusion')]
    trackers = {'ABMSPF 20': ('abmspf', 'particles=20'), 'ABMSPF 10': ('abmspf', 'particles=10'),
                'ABMS': ('abms', ''), 'PF 200': ('pf', 'particles=200')}
    for preset in PRESETS:
        for scene, table in measure(scenes, trackers, preset).items():
            result.tables[f'{scene}, {preset}'] = table
            ours = min(table['ABMSPF 20']['followed'], table['ABMSPF 10']['followed'])
            others = max(table['ABMS']['followed'], table['PF 200']['followed'])
            result.claim(f'{scene} ({preset}): ABMSPF follows with 20 and with 10 particles',
                         'followed: ' + _listed(table, 'followed', 1), ours >= 0.8)
            result.claim(f'{scene} ({preset}): ABMS and PF with 200 particles fail',
                         'followed: ' + _listed(table, 'followed', 1), others < 0.5)
            times = [table[label]['cpu_ms_median'] for label in ('ABMSPF 20', 'PF 200')]
            result.claim(f'{scene} ({preset}): ABMSPF 20 takes less time than PF 200',
                         f'{times[0]:.2f} ms against {times[1]:.2f} ms', times[0] < times[1])
    return result


def paper4(measure: Measure, sequences: Path) -> Experiment:
    """APPF: a car that comes near, a helicopter, and the real David."""
    result = Experiment()
    names = {'APPF': 'appf', 'affine PF': 'affine_pf', 'PPCA': 'ppca', 'colour PF': 'pf'}
    videos: list[tuple[Sequence, int]] = [
        (scene_sequence('car_approach'), 400), (scene_sequence('helicopter'), 400)]
    if (sequences / 'David').is_dir():
        videos.append((read_folder(sequences / 'David')[0], 200))
    for preset in PRESETS:
        for video, count in videos:
            table = measure([video], {label: (name, f'particles={count}')
                                      for label, name in names.items()}, preset)[video.name]
            result.tables[f'{video.name}, N = {count}, {preset}'] = table
            others = min(row['rmse_mean'] for label, row in table.items() if label != 'APPF')
            result.claim(
                f'{video.name} ({preset}): error of APPF below affine PF, PPCA and colour PF',
                _listed(table, 'rmse_mean', 1) + ' px', table['APPF']['rmse_mean'] < others)
    return result


PAPERS = {'paper1': paper1, 'paper2': paper2, 'paper3': paper3, 'paper4': paper4}


def main(argv: list[str] | None = None) -> int:
    """Run the experiments and write what came out."""
    arguments = _arguments(argv)
    cache = None if arguments.no_cache else RunCache(arguments.cache)
    measure = partial(_measured, seeds=arguments.seeds, jobs=arguments.jobs, cache=cache)
    path: Path = arguments.json
    results: dict[str, Any] = {}
    if path.is_file():
        results = json.loads(path.read_text(encoding='utf-8'))
    for name in arguments.only or PAPERS:
        experiment = PAPERS[name](measure, arguments.sequences)
        results[name] = {'environment': environment(), 'seeds': arguments.seeds,
                         'tables': experiment.tables, 'claims': experiment.claims}
        results = {key: results[key] for key in PAPERS if key in results}
        path.write_text(json.dumps(results, indent=1) + '\n', encoding='utf-8')
        print(_claims(results[name]), '\n')
    page: Path = arguments.page
    if page.is_file():
        page.write_text(_filled(page.read_text(encoding='utf-8'), results), encoding='utf-8')
    return 0


def _measured(sequences: Iterable[Sequence], trackers: Trackers, preset: str, *, seeds: int,
              jobs: int, cache: RunCache | None) -> dict[str, dict[str, Row]]:
    """Return sequence -> name in the table -> figures; the CEI is among these trackers."""
    specifications = {
        label: f'{name}:preset={preset}' + (f',{parameters}' if parameters else '')
        for label, (name, parameters) in trackers.items()}
    results = evaluate(specifications.values(), sequences, seeds, jobs, cache=cache)
    if results.problems:
        raise RuntimeError('\n'.join(str(problem) for problem in results.problems))
    scores = as_json(results)['sequences']
    keys = ('rmse_mean', 'rmse_var', 'auc', 'cpu_ms_median', 'cei')
    return {sequence: {label: {
        **{key: scores[sequence][text][key] for key in keys},
        'rmse_mean_std': scores[sequence][text]['rmse_mean_std'],
        **_endings(results, sequence, text)} for label, text in specifications.items()}
        for sequence in results.sequences}


def _endings(results: Results, sequence: str, tracker: str) -> Row:
    """Return the shares of seeds that finished and that followed, and the error of the size."""
    truth = results.sequences[sequence].truth
    finished, followed, errors = [], [], []
    for run in results.runs(sequence, tracker).values():
        there = np.isfinite(truth[:, 0])
        boxes, true = run.boxes[there], truth[there]
        low = np.maximum(boxes[:, :2], true[:, :2])
        high = np.minimum(boxes[:, :2] + boxes[:, 2:], true[:, :2] + true[:, 2:])
        common = np.maximum(high - low, 0).prod(axis=1)
        areas = boxes[:, 2:].prod(axis=1), true[:, 2:].prod(axis=1)
        overlap = common / (areas[0] + areas[1] - common)
        finished.append(overlap[-LAST_FRAMES:].mean() > LAST_OVERLAP)
        followed.append(
            finished[-1] and (overlap > FOLLOWED_OVERLAP).mean() >= FOLLOWED_SHARE)
        errors.append(np.abs(np.sqrt(areas[0] / areas[1]) - 1).mean())
    return {'finished': float(np.mean(finished)), 'followed': float(np.mean(followed)),
            'size_error': float(np.mean(errors))}


def _listed(table: dict[str, Row], key: str, digits: int) -> str:
    return ', '.join(f'{label} {row[key]:.{digits}f}' for label, row in table.items())


def _claims(result: dict[str, Any]) -> str:
    return markdown([['claim', 'what came out', 'held'], *(
        [text, outcome, 'yes' if held else '**no**']
        for text, outcome, held in result['claims'])])


def _tables(result: dict[str, Any]) -> str:
    parts = []
    for title, table in result['tables'].items():
        rows = [['', 'RMSE mean, px', 'variance, px²', 'mean AUC', 'size error', 'followed',
                 'finished', 'ms', 'CEI']]
        for label, row in table.items():
            spread = '' if math.isnan(row['rmse_mean_std']) else f" ± {row['rmse_mean_std']:.1f}"
            rows.append([
                label, f"{row['rmse_mean']:.2f}{spread}", f"{row['rmse_var']:.1f}",
                f"{row['auc']:.3f}", f"{row['size_error']:.0%}", f"{row['followed']:.0%}",
                f"{row['finished']:.0%}", f"{row['cpu_ms_median']:.2f}", f"{row['cei']:.3f}"])
        parts.append(f'**{title}**\n\n{markdown(rows)}\n')
    facts = ', '.join(f'{key} {value}' for key, value in result['environment'].items())
    return '\n'.join([*parts, f"{result['seeds']} seeds; {facts}.\n"])


def _filled(page: str, results: dict[str, Any]) -> str:
    """Put tables between the page's marks, such as <!-- paper1 claims --> ... <!-- end -->."""
    makers = {'claims': _claims, 'tables': _tables}

    def table(match: re.Match[str]) -> str:
        paper, kind = match[1], match[2]
        if paper not in results:
            return match[0]
        text = makers[kind](results[paper]).strip()
        return f'<!-- {paper} {kind} -->\n\n{text}\n\n<!-- end -->'

    return re.sub(r'<!-- (paper\d) (claims|tables) -->.*?<!-- end -->', table, page,
                  flags=re.DOTALL)


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    folder = ROOT / 'docs' / 'results'
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', nargs='+', choices=tuple(PAPERS), metavar='PAPER',
                        help='of ' + ', '.join(PAPERS) + ' (default: all)')
    parser.add_argument('--seeds', type=int, default=5, metavar='K', help='(default: 5)')
    parser.add_argument('--jobs', type=int, default=1, metavar='J', help='processes (default: 1)')
    parser.add_argument('--sequences', type=Path, metavar='DIR',
                        default=ROOT.parent / 'shared' / 'sequences', help='where David is')
    parser.add_argument('--json', type=Path, default=folder / 'papers.json', metavar='FILE',
                        help='(default: docs/results/papers.json)')
    parser.add_argument('--page', type=Path, default=folder / 'papers.md', metavar='FILE',
                        help='(default: docs/results/papers.md)')
    parser.add_argument('--cache', type=Path, default=default_folder(), metavar='DIR')
    parser.add_argument('--no-cache', action='store_true')
    return parser.parse_args(argv)


if __name__ == '__main__':
    raise SystemExit(main())
