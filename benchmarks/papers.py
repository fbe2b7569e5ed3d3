"""
The claims of the four papers, put to the test on rendered scenes and a few real videos.

Runs the replicas, which have the papers' own cues, and writes `docs/results/papers.json`, the
tables between the marks in `docs/results/papers.md`, and the charts beside it. Films and runs are
cached, and only what has changed is run again. So times may be from several machines: the page
says whether they're measured, cached or mixed; `--no-cache` runs, and times, everything again.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from paper_experiments import page, qi, xiang, yin, zhu
from paper_experiments.films import Laboratory
from result_files import write_json
from shared_sequences import FOLDER

from vtrack_ros.evaluation.cache import default_folder, RunCache
from vtrack_ros.evaluation.results_json import environment

ROOT = Path(__file__).resolve().parents[1]
#: Name -> (experiments, default number of runs).
PAPERS = {'paper1': (zhu.run, 20), 'paper2': (qi.run, 30), 'paper3': (yin.run, 10),
          'paper4': (xiang.run, 10)}


def main(argv: list[str] | None = None) -> int:
    """Run the experiments and write the results."""
    arguments = _arguments(argv)
    folder = None if arguments.no_cache else arguments.cache
    path: Path = arguments.json
    results: dict[str, Any] = {}
    if path.is_file():
        results = json.loads(path.read_text(encoding='utf-8'))
    for name in arguments.only or PAPERS:
        experiment, usual = PAPERS[name]
        seeds = arguments.seeds or usual
        laboratory = Laboratory(
            seeds, arguments.sequences, folder, None if folder is None else RunCache(folder))
        found = experiment(laboratory)
        results[name] = {'environment': environment(), 'timings': laboratory.timings,
                         'seeds': seeds, 'tables': found.tables, 'claims': found.claims,
                         'curves': found.curves}
        results = {key: results[key] for key in PAPERS if key in results}
        write_json(path, results)
        print(page.claims(results[name]), '\n')
    text: Path = arguments.page
    if text.is_file():
        kept = json.loads(path.read_text(encoding='utf-8'))
        text.write_text(page.filled(text.read_text(encoding='utf-8'), kept), encoding='utf-8')
        page.draw(kept, text.parent)
    return 0


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    folder = ROOT / 'docs' / 'results'
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', nargs='+', choices=tuple(PAPERS), metavar='PAPER',
                        help='of ' + ', '.join(PAPERS) + ' (default: all)')
    parser.add_argument('--seeds', type=_count, metavar='K', help='runs of each tracker '
                        '(default: ' + ', '.join(
                            f'{name} {usual}' for name, (_, usual) in PAPERS.items()) + ')')
    parser.add_argument('--sequences', type=Path, metavar='DIR',
                        default=FOLDER,
                        help='where David, Crossing and Subway are')
    parser.add_argument('--json', type=Path, default=folder / 'papers.json', metavar='FILE',
                        help='(default: docs/results/papers.json)')
    parser.add_argument('--page', type=Path, default=folder / 'papers.md', metavar='FILE',
                        help='(default: docs/results/papers.md)')
    parser.add_argument('--cache', type=Path, default=default_folder(), metavar='DIR')
    parser.add_argument('--no-cache', action='store_true')
    return parser.parse_args(argv)


def _count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'must be at least 1, not {text}')
    return int(text)


if __name__ == '__main__':
    raise SystemExit(main())
