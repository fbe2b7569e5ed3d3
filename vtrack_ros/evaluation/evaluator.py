"""Running many trackers over many sequences, in several processes."""

from collections.abc import Callable, Iterable, Iterator, Sequence as Ordered
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path
from typing import Any
from uuid import uuid4

from vtrack_ros.bags.errors import SequenceError
from vtrack_ros.evaluation.cache import run_key, RunCache, tracker_source
from vtrack_ros.evaluation.results import Problem, Results
from vtrack_ros.evaluation.runner import one_thread, Run, run_tracker
from vtrack_ros.evaluation.sequences import find_sequences, Sequence, uniquely_named
from vtrack_ros.evaluation.stress import of_one_size, StressedSequence
from vtrack_ros.evaluation.tracker_specification import specifications, TrackerSpecification
from vtrack_ros.frame import Frame

#: Called with the number of runs that are done, and the total number.
Progress = Callable[[int, int], None]

#: Limit [bytes] of the decoded frames that a process buffers for the next tracker on a video.
_KEPT_BYTES = 1 << 30


@dataclass(frozen=True)
class Task:
    """A tracker's runs over one sequence, one for each seed."""

    sequence: Sequence
    tracker: TrackerSpecification
    seeds: tuple[int, ...]


def evaluate(trackers: Iterable[str | TrackerSpecification],
             sequences: Iterable[Sequence] | Path | str, seeds: int | Iterable[int] = 1,
             jobs: int | None = None, progress: Progress | None = None,
             cache: RunCache | None = None) -> Results:
    """
    Run every tracker over every sequence with every seed.

    Each run has one thread: OpenCV's and the linear algebra's pools are set to one. The processes
    are joblib's: within ``joblib.parallel_config(backend='dask')`` those of a dask cluster.

    Trackers are given such as ``'pf'`` or ``'gmpf:particles=40'``; sequences may be a folder (see
    `find_sequences`), whose unusable sequences are listed in the results' `problems`. `seeds` is
    the number of seeds (then 0, 1, ...) or the seeds themselves; a tracker that ignores its seed
    runs with the first one only. `jobs` is the number of processes, by default one per processor;
    0 and 1 run in this process. `progress` is called with the number of runs done and the total.
    Runs found in the `cache` are taken from there, and new ones are stored in it.

    ValueError or TypeError if a tracker, the seeds or jobs is wrong; SequenceError if the folder
    is.
    """
    chosen = specifications(trackers)
    numbers = tuple(range(seeds)) if isinstance(seeds, int) else tuple(dict.fromkeys(seeds))
    if not numbers or min(numbers) < 0:
        raise ValueError(f'seeds must be one or more numbers >= 0, not {seeds!r}')
    if jobs is not None and jobs < 0:
        raise ValueError(f'jobs must be 0 or more, not {jobs}')
    broken: dict[str, str] = {}
    if isinstance(sequences, (str, Path)):
        sequences, broken = find_sequences(Path(sequences))
    found = uniquely_named(sequences)
    results = Results(found, chosen, numbers)
    results.problems.extend(Problem(name, '', text) for name, text in broken.items())
    fingerprints: dict[str, str] = {}
    for sequence in found if cache is not None else ():
        try:
            fingerprints[sequence.name] = sequence.fingerprint()
        except (OSError, SequenceError) as error:
            results.problems.append(Problem(sequence.name, '', str(error)))
    sources = {} if cache is None else {one.label: tracker_source(one) for one in chosen}
    keys: dict[tuple[str, str, int], str] = {}
    tasks, done = [], 0
    usable = [one for one in found if cache is None or one.name in fingerprints]
    for sequence, tracker in product(usable, chosen):
        left = []
        for seed in numbers[:1] if tracker.deterministic else numbers:
            run = None
            if cache is not None:
                key = run_key(tracker, sources[tracker.label], fingerprints[sequence.name], seed)
                keys[sequence.name, tracker.label, seed] = key
                run = cache.get(key)
            if run is None:
                left.append(seed)
            else:
                results.add(sequence.name, tracker.label, seed, run)
                done += 1
        if left:
            tasks.append(Task(sequence, tracker, tuple(left)))
    total = done + sum(len(task.seeds) for task in tasks)
    if progress is not None:
        progress(done, total)
    for task, outcome in _outcomes(tasks, jobs):
        name, label = task.sequence.name, task.tracker.label
        if isinstance(outcome, str):
            results.problems.append(Problem(name, label, outcome))
        else:
            # Runs aren't stored if the tracker's source was changed meanwhile.
            keep = cache is not None and tracker_source(task.tracker) == sources[label]
            for seed, run in zip(task.seeds, outcome):
                results.add(name, label, seed, run)
                if cache is not None and keep:
                    cache.put(keys[name, label, seed], run)
        done += len(task.seeds)
        if progress is not None:
            progress(done, total)
    results.sort()
    return results


def _outcomes(tasks: Ordered[Task], jobs: int | None) -> Iterator[tuple[Task, list[Run] | str]]:
    from joblib import delayed, Parallel

    # Long sequences first, so that none is left to a single process at the end; those of one video
    # consecutively, so that it's decoded once.
    ordered = sorted(tasks, key=lambda task: (-len(task.sequence), task.sequence.video))
    options = {'n_jobs': -1 if jobs is None else max(1, jobs), 'batch_size': 1,
               'pre_dispatch': 'all'}
    try:
        parallel = Parallel(**options, return_as='generator')
    except ValueError:
        # joblib before 1.4 returns the results of a dask cluster all at once, at the end.
        parallel = Parallel(**options)
    evaluation, done = uuid4().hex, 0
    outcomes: Any = []
    try:
        outcomes = parallel(delayed(run_task)(task, evaluation) for task in ordered)
        for outcome in outcomes:
            yield ordered[done], outcome
            done += 1
    except Exception as error:  # noqa: B902 - what a task raises is its outcome: this is a process
        died = f'a worker process died ({type(error).__name__}) during or before this run'
        yield from ((task, died) for task in ordered[done:])
    finally:
        if not isinstance(outcomes, list):
            outcomes.close()
        _kept.clear()


def run_task(task: Task, evaluation: str) -> list[Run] | str:
    """Return a task's runs in the order of its seeds, or an error message."""
    sequence = task.sequence
    try:
        with one_thread():
            runs = [run_tracker(task.tracker.create(seed), _frames(sequence, evaluation),
                                sequence.first_box, sequence.steps) for seed in task.seeds]
        for run in runs:
            if len(run.boxes) != len(sequence):
                raise SequenceError(
                    f'only {len(run.boxes)} of {len(sequence)} frames could be read')
        return runs
    except Exception as error:  # noqa: B902 - one that fails must not end the others
        return f'{type(error).__name__}: {error}'


#: Buffer of each process: the frames of its latest video and the stressed frames made from them,
#: by (evaluation, video): files may change between evaluations.
_kept: dict[tuple[str, str], list[Frame]] = {}


def _frames(sequence: Sequence, evaluation: str) -> Iterable[Frame]:
    """Return the frames, made once for all runs on a video if they fit into the buffer."""
    original = sequence.original if isinstance(sequence, StressedSequence) else sequence
    for key in _kept.keys() - {(evaluation, one.video) for one in (original, sequence)}:
        del _kept[key]
    if not isinstance(sequence, StressedSequence):
        return _made(sequence, evaluation,
                     lambda: of_one_size(sequence.name, sequence.frames()))
    stressed = sequence.made_of
    return _made(sequence, evaluation, lambda: stressed(
        _made(original, evaluation, original.frames)))


def _made(sequence: Sequence, evaluation: str,
          make: Callable[[], Iterable[Frame]]) -> Iterable[Frame]:
    """Return the buffered frames, or make them, and buffer them if there is room."""
    key = evaluation, sequence.video
    if key not in _kept:
        stream = iter(make())
        first = next(stream)
        room = _KEPT_BYTES - sum(frame.nbytes for frames in _kept.values() for frame in frames)
        if first.nbytes * len(sequence) > room:
            return chain([first], stream)
        _kept[key] = [first, *stream]
    return _kept[key]
