"""`vtrack evaluate`: figures of merit of trackers on sequences."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
import sys
from typing import Any

from vtrack_ros.bags import SequenceError
from vtrack_ros.bags.errors import check_output, writing
from vtrack_ros.cli.arguments import positive_integer, seed
from vtrack_ros.cli.command_line import warn
from vtrack_ros.cli.progress import ProgressBar
from vtrack_ros.evaluation.cache import default_folder, RunCache
from vtrack_ros.evaluation.evaluator import evaluate
from vtrack_ros.evaluation.results import Problem, Results
from vtrack_ros.evaluation.results_json import write_json
from vtrack_ros.evaluation.sequences import (
    find_sequences, read_bag, scene_sequence, Sequence, uniquely_named)
from vtrack_ros.evaluation.stress_kinds import STRESS_KINDS, stress_kinds
from vtrack_ros.evaluation.stress_results import evaluate_stress
from vtrack_ros.evaluation.stress_table import (
    fewer_under_stress, influence_table, stress_json, stress_table)
from vtrack_ros.evaluation.table import fewer_targets, sequence_table, summary_table
from vtrack_ros.evaluation.tracker_specification import parse_trackers
from vtrack_ros.scenes import scene_names

EXAMPLES = """examples:
  vtrack evaluate --bags bags/face_fast my_bag --trackers all
  vtrack evaluate --sequences DIR --trackers pf,gmpf --seeds 5 --html report.html
  vtrack evaluate --sequences DIR --trackers gmpf,gmpf:particles=400,gmpf_paper --json out.json
  vtrack evaluate --bags my_bag --stress --html report.html
  vtrack evaluate --sequences DIR --stress rate,gaps,hidden --trackers gmpf
  vtrack evaluate --sequences DIR --seeds 20 --backend dask --scheduler tcp://host:8786

The exit code is 1 if a sequence or a run was skipped because of an error."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--trackers', default='all', metavar='A,B,...',
        help='trackers to compare, with parameters other than the defaults after a colon '
        '(pf,gmpf:particles=40); all: those of this package and of other packages; papers: the '
        "papers' methods; peers: OpenCV's own, as far as they are installed (default: all)")
    parser.add_argument('--bags', nargs='+', type=Path, default=[], metavar='BAG',
                        help='bags with ground truth')
    parser.add_argument('--topic', help='image topic of the bags; needed if a bag has several')
    parser.add_argument('--sequences', type=Path, metavar='DIR',
                        help='a folder of sequences, each with img/ and groundtruth_rect.txt')
    parser.add_argument('--scenes', metavar='A,B,...',
                        help='synthetic scenes (see vtrack synth --list), or all')
    parser.add_argument('--seeds', type=positive_integer, default=1, metavar='K',
                        help='number of seeds: 0 to K - 1 (default: %(default)s)')
    parser.add_argument('--stress', nargs='?', const='all', metavar='A,B,...',
                        help='also evaluate harder versions, in three severities of each kind: '
                        + ', '.join(STRESS_KINDS) + ' (default: all of them)')
    parser.add_argument('--stress-seed', type=seed, default=0, metavar='N',
                        help='seed of the random changes of --stress (default: %(default)s)')
    parser.add_argument('--jobs', type=positive_integer, metavar='J',
                        help='number of processes (default: one per processor)')
    parser.add_argument('--backend', choices=('processes', 'dask'), default='processes',
                        help='run in processes on this machine, or on the workers of a dask '
                        'cluster, which need one thread each and the same files '
                        '(default: %(default)s)')
    parser.add_argument('--scheduler', metavar='ADDRESS',
                        help='address of the dask scheduler (default: $DASK_SCHEDULER_ADDRESS, or '
                        'else a cluster of J workers on this machine)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all results as JSON')
    parser.add_argument('--html', type=Path, metavar='FILE',
                        help='write a self-contained page with plots and pictures')
    parser.add_argument('--cache', type=Path, default=default_folder(), metavar='DIR',
                        help='folder for the results of finished runs (default: %(default)s)')
    parser.add_argument('--no-cache', action='store_true',
                        help='repeat all runs, so that all times are measured now')


def run(arguments: argparse.Namespace) -> int:
    """Evaluate and print; return 1 where something is wrong with a sequence or a run, else 0."""
    for path in filter(None, (arguments.json, arguments.html)):
        check_output(path)
    trackers = parse_trackers(arguments.trackers)
    kinds = None if arguments.stress is None else stress_kinds(arguments.stress)
    if arguments.html:
        # Imported before the evaluation: it would be in vain if a library were missing.
        from vtrack_ros.evaluation.report import html_page
    sequences, problems = _sequences(arguments)
    for problem in problems:
        print(f'skipped: {problem}', file=sys.stderr)
    with _workers(arguments):
        cache = None if arguments.no_cache else RunCache(arguments.cache)
        stress = None
        if kinds is None:
            results = evaluate(trackers, sequences, arguments.seeds, arguments.jobs,
                               ProgressBar('runs'), cache)
        else:
            stress = evaluate_stress(trackers, sequences, kinds, arguments.seeds, arguments.jobs,
                                     ProgressBar('runs'), cache, arguments.stress_seed)
            results = stress.plain
    for problem in results.problems:
        print(f'failed: {problem}', file=sys.stderr)
    results.problems = [*problems, *results.problems]
    if results.summary:
        _print(results)
        if stress is not None:
            print('\n'.join(['', stress_table(stress), *fewer_under_stress(stress), '',
                             influence_table(stress)]))
    if arguments.json:
        with writing(arguments.json):
            write_json(results, arguments.json,
                       {} if stress is None else {'stress': stress_json(stress)})
    if arguments.html:
        page = html_page(results, stress)
        with writing(arguments.html):
            arguments.html.write_text(page, encoding='utf-8')
        print(f'see {arguments.html}')
    return 1 if results.problems else 0


@contextmanager
def _workers(arguments: argparse.Namespace) -> Iterator[None]:
    """Select the processes or dask workers of the arguments for what runs in the context."""
    if arguments.backend == 'processes':
        if arguments.scheduler is not None:
            raise ValueError('--scheduler needs --backend dask')
        yield
        return
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        raise ModuleNotFoundError(
            f'--backend dask needs distributed: pip install distributed ({error})') from None
    from joblib import parallel_config
    address = arguments.scheduler or dask.config.get('scheduler-address', None)
    here = {'n_workers': arguments.jobs, 'threads_per_worker': 1, 'dashboard_address': None}
    connect: Any = Client
    with connect(address, **({} if address else here)) as client, parallel_config(backend='dask'):
        workers = client.nthreads()
        if not workers:
            raise ValueError('the dask cluster has no worker')
        if address and len(workers) == 1:
            warn('vtrack evaluate', 'the dask cluster has a single worker; joblib then runs '
                 'everything in this process instead')
        busy = [worker for worker, threads in workers.items() if threads > 1]
        if busy:
            raise ValueError(f'{busy[0]} has several threads, which would slow each other down: '
                             'start it with dask worker --nthreads 1')
        yield


def _sequences(arguments: argparse.Namespace) -> tuple[list[Sequence], list[Problem]]:
    names = filter(None, (name.strip() for name in (arguments.scenes or '').split(',')))
    scenes = dict.fromkeys(chain.from_iterable(
        scene_names() if name == 'all' else (name,) for name in names))
    if arguments.sequences is None and not arguments.bags and not scenes:
        raise ValueError('no sequences given: use --sequences DIR, --bags PATH or --scenes NAME')
    found: list[Sequence] = []
    broken: dict[str, str] = {}
    if arguments.sequences is not None:
        # Workers of a dask cluster may have another working folder.
        found, broken = find_sequences(arguments.sequences.absolute())
    for path in arguments.bags:
        if not path.exists():
            raise ValueError(f'{path}: no such bag')
        try:
            bag = read_bag(path.absolute(), arguments.topic)
            warn('vtrack evaluate', bag.notice)
            found.append(bag)
        except SequenceError as error:
            broken[str(path)] = str(error)
    found.extend(map(scene_sequence, scenes))
    return uniquely_named(found), [Problem(name, '', text) for name, text in broken.items()]


def _print(results: Results) -> None:
    print(sequence_table(results))
    print()
    print('\n'.join([summary_table(results), *fewer_targets(results)]))
    targets, seeds = len(results.sequences), len(results.seeds)
    print(f'\n{targets} target{"s" * (targets != 1)}, {seeds} seed{"s" * (seeds != 1)}, '
          f'times {results.timings}')
