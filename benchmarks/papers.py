"""
The experiments of the four papers, on rendered scenes and on the real David.

Runs the replicas, which have the papers' own cues, and the trackers of this package beside them,
and writes `docs/results/papers.json` and the tables between the marks in
`docs/results/papers.md`; `--only printed` has what the replicas give as printed. Runs are kept,
and only what has changed is run again; `--no-cache` also measures all times anew.
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

from result_files import write_json
from vtrack_ros.evaluation import evaluate
from vtrack_ros.evaluation.cache import default_folder, RunCache
from vtrack_ros.evaluation.results import Results
from vtrack_ros.evaluation.results_json import as_json, environment
from vtrack_ros.evaluation.sequences import read_folder, scene_sequence, Sequence
from vtrack_ros.evaluation.table import markdown

ROOT = Path(__file__).resolve().parents[1]
#: A run has finished when it's on the target, on average, in this many last frames.
LAST_FRAMES, LAST_OVERLAP = 10, 0.3
#: A run has followed when it has finished, and was this much on the target in so many frames.
FOLLOWED_OVERLAP, FOLLOWED_SHARE = 0.3, 0.75
#: What all of the second paper's filters have.
PAPER2 = 'particles=100,kernel=epanechnikov'
_POSE = ('appf_paper', 'appf_paper:as_printed=true', 'affine_pf_paper')
#: Scenes -> what all have, and the specifications to compare on them: mended, and as printed.
PRINTED = {
    'face_fast': ('particles=40', (
        'pf_paper', 'gmpf_paper', 'gmpf_paper:as_printed=true',
        'gmpf_paper:as_printed=true,floor=0', 'gmpf_paper:as_printed=true,window=4',
        'gmpf_paper:as_printed=true,window=6', 'gmpf_paper:as_printed=true,window=8',
        'gmpf_paper:as_printed=true,window=10', 'kpf_paper', 'kpf_paper:as_printed=true',
        'upf_paper:as_printed=true')),
    'pose_change and similar_occlusion': (PAPER2, (
        'pf_paper', 'pf_paper:cues=colour+motion_edge',
        'pf_paper:cues=colour+motion_edge,fusion=normalised', 'pqkpf_paper',
        'pqkpf_paper:fusion=normalised', 'pqkpf_paper:weighting=full',
        'pqkpf_paper:as_printed=true', 'qkpf_paper:as_printed=true')),
    'scale_change and full_occlusion': ('', (
        'abmspf_paper', 'abmspf_paper:background=false', 'abmspf_paper:as_printed=true',
        'abms_paper', 'abms_paper:as_printed=true')),
    'car_approach and helicopter': ('particles=400', _POSE),
    'David': ('particles=200', _POSE),
}
Row = dict[str, float]
#: Specifications as `vtrack evaluate` takes them, by the name in the table.
Trackers = dict[str, str]


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


Measure = Callable[[Iterable[Sequence], Trackers], dict[str, dict[str, Row]]]


def paper1(measure: Measure, _: Path) -> Experiment:
    """GMPF: a fast face, tables 2 and 3, and football."""
    result = Experiment()
    face, football = scene_sequence('face_fast'), scene_sequence('football')
    replicas = {name.upper(): f'{name}_paper' for name in ('pf', 'kpf', 'upf', 'gmpf')}
    product = {'PF': 'pf', 'GMPF': 'gmpf'}
    for form, names in (('mended', replicas), ('product', product)):
        table = measure([face], _with(names, 'particles=40'))['face_fast']
        result.tables[f'face_fast, N = 40, m = 5, {form}'] = table
        best = min(table, key=lambda label: table[label]['cei'])
        result.claim(f'face_fast ({form}): CEI of GMPF is the best',
                     f'best is {best}; ' + _listed(table, 'cei', 3), best == 'GMPF')
        ratio = table['GMPF']['rmse_mean'] / table['PF']['rmse_mean']
        result.claim(f'face_fast ({form}): RMSE mean of GMPF at most a third of that of PF',
                     f'{ratio:.2f} of it; ' + _listed(table, 'rmse_mean', 2), ratio <= 1 / 3)
    counts = measure([face], {
        f'N = {count}': f'gmpf_paper:particles={count},window=4'
        for count in (50, 100, 150, 200)})['face_fast']
    result.tables['Table 2: GMPF by number of particles, m = 4, mended'] = counts
    best = min(counts, key=lambda label: counts[label]['cei'])
    result.claim('Table 2: N = 150 has the best CEI of 50, 100, 150, 200',
                 f'best is {best}; ' + _listed(counts, 'cei', 3), best == 'N = 150')
    lengths = {f'm = {window}': f'gmpf_paper:particles=100,window={window}'
               for window in (4, 6, 8, 10)}
    result.tables['Table 3: GMPF by length of the series, N = 100, mended'] = measure(
        [face], lengths)['face_fast']
    windows = measure([face], _with(lengths, 'prior_share=0'))['face_fast']
    result.tables['Table 3 without particles of the prior'] = windows
    errors = {label: row['rmse_mean'] for label, row in windows.items()}
    result.claim('Table 3, without particles of the prior: m = 4 and m = 6 are good, m = 8 is '
                 'worse, m = 10 loses the target',
                 _listed(windows, 'rmse_mean', 2) + '; finished: '
                 + _listed(windows, 'finished', 1),
                 max(errors['m = 4'], errors['m = 6']) < errors['m = 8'] < errors['m = 10']
                 and windows['m = 4']['finished'] >= 0.6 and windows['m = 10']['finished'] < 0.5)
    for form, names in (('mended', replicas), ('product', product)):
        table = measure([football], _with(names, 'particles=150'))['football']
        result.tables[f'football, N = 150, m = 5, {form}'] = table
        others = {label: row['finished'] for label, row in table.items() if label != 'GMPF'}
        result.claim(f'football ({form}): GMPF finishes, {", ".join(others)} lost',
                     'finished: ' + _listed(table, 'finished', 1),
                     table['GMPF']['finished'] >= 0.6 and max(others.values()) < 0.5)
    return result


def paper2(measure: Measure, _: Path) -> Experiment:
    """P-QKPF: occlusion by somebody alike, and a change of pose."""
    result = Experiment()
    scenes = [scene_sequence('similar_occlusion'), scene_sequence('pose_change')]
    # the paper's kernel, for the baselines too
    trackers = _with({
        'P-QKPF, Dempster-Shafer': 'pqkpf_paper:fusion=dempster_shafer',
        'P-QKPF, product': 'pqkpf_paper:fusion=product',
        'P-QKPF, sum': 'pqkpf_paper:fusion=sum',
        'P-QKPF, colour alone': 'pqkpf_paper:cues=colour',
        'PF, colour': 'pf_paper:cues=colour',
        'PF, both cues': 'pf_paper:cues=colour+motion_edge'}, PAPER2)
    colour = {}
    for scene, table in measure(scenes, trackers).items():
        result.tables[f'{scene}, N = 100, mended'] = table
        ours = table['P-QKPF, Dempster-Shafer']['rmse_mean']
        base = colour[scene] = table['PF, colour']['rmse_mean']
        result.claim(f'{scene} (mended): position error of P-QKPF at least 32 % below colour PF',
                     f'{100 * (ours / base - 1):+.0f} %: {ours:.1f} px against {base:.1f} px',
                     ours <= 0.68 * base)
    product = _with({'P-QKPF': 'pqkpf', 'PF': 'pf'}, 'particles=100')
    for scene, table in measure(scenes, product).items():
        result.tables[f'{scene}, N = 100, product'] = table
        ours, base = (table[label]['rmse_mean'] for label in product)
        result.claim(
            f'{scene} (product): position error of P-QKPF at least 32 % below colour PF (mended)',
            f'{100 * (ours / colour[scene] - 1):+.0f} %: {ours:.1f} px against '
            f"{colour[scene]:.1f} px; the product's own PF {base:.1f} px",
            ours <= 0.68 * colour[scene])
    return result


def paper3(measure: Measure, _: Path) -> Experiment:
    """ABMSPF: changes of light and size, and full occlusion."""
    result = Experiment()
    scenes = [scene_sequence(name) for name in ('light_change', 'scale_change', 'full_occlusion')]
    replicas = {'ABMSPF 20': 'abmspf_paper:particles=20', 'ABMSPF 10': 'abmspf_paper:particles=10',
                'ABMS': 'abms_paper', 'PF 200': 'pf_paper:particles=200'}
    product = {'ABMSPF 20': 'abmspf:particles=20', 'ABMSPF 10': 'abmspf:particles=10',
               'PF 200': 'pf:particles=200'}
    for form, names in (('mended', replicas), ('product', product)):
        for scene, table in measure(scenes, names).items():
            result.tables[f'{scene}, {form}'] = table
            followed = 'followed: ' + _listed(table, 'followed', 1)
            ours, others = ([row['followed'] for label, row in table.items()
                             if label.startswith('ABMSPF') is chosen] for chosen in (True, False))
            result.claim(f'{scene} ({form}): ABMSPF follows with 20 and with 10 particles',
                         followed, min(ours) >= 0.8)
            result.claim(f'{scene} ({form}): {" and ".join(list(table)[2:])} fail',
                         followed, max(others) < 0.5)
            times = [table[label]['cpu_ms_median'] for label in ('ABMSPF 20', 'PF 200')]
            result.claim(f'{scene} ({form}): ABMSPF 20 takes less time than PF 200',
                         f'{times[0]:.2f} ms against {times[1]:.2f} ms', times[0] < times[1])
    return result


def paper4(measure: Measure, sequences: Path) -> Experiment:
    """APPF: a car that comes near, a helicopter, and the real David."""
    result = Experiment()
    replicas = {'APPF': 'appf_paper', 'affine PF': 'affine_pf_paper', 'PPCA': 'ppca_paper',
                'colour PF': 'pf_paper'}
    videos: list[tuple[Sequence, int]] = [
        (scene_sequence('car_approach'), 400), (scene_sequence('helicopter'), 400)]
    videos += [(video, 200) for video in _david(sequences)]
    for form, names in (('mended', replicas), ('product', {'APPF': 'appf', 'PF': 'pf'})):
        for video, count in videos:
            table = measure([video], _with(names, f'particles={count}'))[video.name]
            result.tables[f'{video.name}, N = {count}, {form}'] = table
            others = {label: row['rmse_mean'] for label, row in table.items() if label != 'APPF'}
            result.claim(
                f'{video.name} ({form}): error of APPF below {", ".join(others)}',
                _listed(table, 'rmse_mean', 1) + ' px',
                table['APPF']['rmse_mean'] < min(others.values()))
    return result


def printed(measure: Measure, sequences: Path) -> Experiment:
    """Run all four methods to the letter, beside the mended ones; labels are specifications."""
    result = Experiment()
    videos: dict[str, list[Sequence]] = {
        name: [scene_sequence(scene) for scene in name.split(' and ')]
        for name in PRINTED if name != 'David'}
    videos['David'] = _david(sequences)
    for name, (parameters, specifications) in PRINTED.items():
        labels = _with(dict(zip(specifications, specifications)), parameters).values()
        for video, table in measure(videos[name], dict(zip(labels, labels))).items():
            result.tables[video] = table
    return result


PAPERS = {'paper1': paper1, 'paper2': paper2, 'paper3': paper3, 'paper4': paper4,
          'printed': printed}


def _with(trackers: Trackers, parameters: str) -> Trackers:
    """Return the specifications with more parameters."""
    return {label: text + (',' if ':' in text else ':') + parameters if parameters else text
            for label, text in trackers.items()}


def _david(sequences: Path) -> list[Sequence]:
    """Return David, if it's there."""
    return read_folder(sequences / 'David') if (sequences / 'David').is_dir() else []


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
        write_json(path, results)
        print(_claims(results[name]), '\n')
    page: Path = arguments.page
    if page.is_file():
        page.write_text(_filled(page.read_text(encoding='utf-8'), results), encoding='utf-8')
    return 0


def _measured(sequences: Iterable[Sequence], trackers: Trackers, *, seeds: int, jobs: int,
              cache: RunCache | None) -> dict[str, dict[str, Row]]:
    """Return sequence -> name in the table -> figures; the CEI is among these trackers."""
    results = evaluate(trackers.values(), sequences, seeds, jobs, cache=cache)
    if results.problems:
        raise RuntimeError('\n'.join(str(problem) for problem in results.problems))
    scores = as_json(results)['sequences']
    keys = ('rmse_mean', 'rmse_var', 'auc', 'cpu_ms_median', 'cei')
    return {sequence: {label: {
        **{key: scores[sequence][text][key] for key in keys},
        'rmse_mean_std': scores[sequence][text]['rmse_mean_std'],
        **_endings(results, sequence, text)} for label, text in trackers.items()}
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

    return re.sub(r'<!-- (paper\d|printed) (claims|tables) -->.*?<!-- end -->', table, page,
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
