"""Running many trackers over many sequences, in processes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence as Ordered
from concurrent.futures import as_completed, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
import multiprocessing
import os
from pathlib import Path
import sys

import cv2

from vtrack_ros.evaluation.cache import run_key, RunCache
from vtrack_ros.evaluation.results import Problem, Results
from vtrack_ros.evaluation.running import Run, run_tracker
from vtrack_ros.evaluation.sequences import (
    find_sequences, Sequence, SequenceError, uniquely_named)
from vtrack_ros.evaluation.threads import (
    environment_variables, ONE_THREAD, opencv_on_one_thread)
from vtrack_ros.evaluation.variants import TrackerVariant, variants
from vtrack_ros.frame import Frame

#: Called with the number of runs that are done, and of all.
Progress = Callable[[int, int], None]

#: Decoded frames of up to this many bytes are kept for the next tracker on the same video.
_KEPT_BYTES = 1 << 30
_DIED = 'a process that ran trackers died; this run was under way or waiting'


@dataclass(frozen=True)
class Task:
    """A tracker's runs over one sequence, one for each seed."""

    sequence: Sequence
    variant: TrackerVariant
    seeds: tuple[int, ...]


def evaluate(
        trackers: Iterable[str | TrackerVariant], sequences: Iterable[Sequence] | Path | str,
        seeds: int | Iterable[int] = 1, jobs: int | None = None,
        progress: Progress | None = None, cache: RunCache | None = None) -> Results:
    """
    Run every tracker over every sequence with every seed.

    Each run has one thread: OpenCV's and the linear algebra's pools are set to one.

    Parameters
    ----------
    trackers : iterable of str or TrackerVariant
        Such as ``'pf'`` or ``'gmpf:particles=40,preset=paper'``.
    sequences : iterable of Sequence, or a folder
        A folder as `find_sequences` takes it.
    seeds : int or iterable of int
        How many (then 0, 1, ...), or which. A tracker that ignores its seed runs with the first
        one alone.
    jobs : int, optional
        How many processes, by default one for each processor; 0 runs in this one. As always with
        processes in Python, a script that calls this does so below ``if __name__ == '__main__'``.
    progress : callable, optional
        Called with the number of runs done and of all.
    cache : RunCache, optional
        Where runs are taken from that were made before, and where new ones are kept.

    Returns
    -------
    results : Results
        A run that failed is among its `problems`, and so are broken sequence folders.

    Raises
    ------
    ValueError, TypeError
        If a tracker, the seeds or jobs is wrong; SequenceError if the folder is.

    """
    chosen = variants(trackers)
    numbers = checked_seeds(seeds)
    if jobs is None:
        jobs = os.cpu_count() or 1
    if jobs < 0:
        raise ValueError(f'jobs must be 0 or more, not {jobs}')
    broken: dict[str, str] = {}
    if isinstance(sequences, (str, Path)):
        found, broken = find_sequences(Path(sequences))
    else:
        found = uniquely_named(sequences)
    results = Results(found, chosen, numbers)
    results.problems.extend(Problem(name, '', text) for name, text in broken.items())
    wanted = [Task(sequence, variant, numbers[:1] if variant.deterministic else numbers)
              for sequence in found for variant in chosen]
    total = sum(len(task.seeds) for task in wanted)
    store = _Store(cache, found)
    tasks = [store.remaining(task, results) for task in wanted]
    done = total - sum(len(task.seeds) for task in tasks)
    if progress is not None:
        progress(done, total)
    for task, outcome in _outcomes([task for task in tasks if task.seeds], jobs):
        if isinstance(outcome, str):
            results.problems.append(Problem(task.sequence.name, task.variant.label, outcome))
        else:
            for seed, run in zip(task.seeds, outcome):
                results.add(task.sequence.name, task.variant.label, seed, run)
                store.keep(task, seed, run)
        done += len(task.seeds)
        if progress is not None:
            progress(done, total)
    results.sort()
    return results


class _Store:
    """The cache as one evaluation sees it, or nothing."""

    def __init__(self, cache: RunCache | None, sequences: Iterable[Sequence]) -> None:
        self._cache = cache
        self._fingerprints = {} if cache is None else {
            sequence.name: sequence.fingerprint() for sequence in sequences}
        self._keys: dict[tuple[str, str, int], str] = {}

    def remaining(self, task: Task, results: Results) -> Task:
        """Add the runs that were made before to the results; return those still to be made."""
        if self._cache is None:
            return task
        seeds = []
        for seed in task.seeds:
            key = self._key(task, seed)
            self._keys[task.sequence.name, task.variant.label, seed] = key
            run = self._cache.get(key)
            if run is None:
                seeds.append(seed)
            else:
                results.add(task.sequence.name, task.variant.label, seed, run)
        return replace(task, seeds=tuple(seeds))

    def keep(self, task: Task, seed: int, run: Run) -> None:
        """Keep a run, unless the source was changed while it ran."""
        key = self._keys.get((task.sequence.name, task.variant.label, seed))
        if self._cache is not None and key is not None and key == self._key(task, seed):
            self._cache.put(key, run)

    def _key(self, task: Task, seed: int) -> str:
        return run_key(task.variant, self._fingerprints[task.sequence.name], seed)


def checked_seeds(seeds: int | Iterable[int]) -> tuple[int, ...]:
    """Return the seeds as a tuple: 0, 1, ... for a number; ValueError where there is none."""
    numbers = tuple(range(seeds)) if isinstance(seeds, int) else tuple(dict.fromkeys(seeds))
    if not numbers or min(numbers) < 0:
        raise ValueError(f'seeds must be one or more numbers >= 0, not {seeds!r}')
    return numbers


def _outcomes(tasks: Ordered[Task], jobs: int) -> Iterator[tuple[Task, list[Run] | str]]:
    if jobs == 0:
        _forget_frames()
        try:
            with opencv_on_one_thread():
                for task in tasks:
                    yield task, run_task(task)
        finally:
            _forget_frames()
        return
    # Long ones first, so that no process is left with one at the end; those of one video together,
    # so that it's decoded once.
    ordered = sorted(tasks, key=lambda task: (-len(task.sequence), task.sequence.video))
    spawn = multiprocessing.get_context('spawn')
    with environment_variables(ONE_THREAD), _importable_main(), ProcessPoolExecutor(
            min(jobs, max(1, len(tasks))), mp_context=spawn, initializer=_one_thread) as pool:
        futures: dict[Future[list[Run] | str], Task] = {}
        try:
            for task in ordered:
                try:
                    futures[pool.submit(run_task, task)] = task
                except BrokenProcessPool:
                    yield task, _DIED
            for future in as_completed(futures):
                try:
                    yield futures[future], future.result()
                except BrokenProcessPool:
                    yield futures[future], _DIED
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def run_task(task: Task) -> list[Run] | str:
    """Return a task's runs, in the order of its seeds, or what went wrong."""
    try:
        return [_run(task, seed) for seed in task.seeds]
    except Exception as error:  # noqa: B902 - one that fails must not end the others
        return f'{type(error).__name__}: {error}'


def _run(task: Task, seed: int) -> Run:
    sequence = task.sequence
    run = run_tracker(
        task.variant.create(seed), _frames(sequence), sequence.first_box, sequence.steps)
    if len(run.boxes) != len(sequence):
        raise SequenceError(
            f'only {len(run.boxes)} of {len(sequence)} frames could be read')
    return run


_kept: tuple[str, list[Frame]] | None = None


def _frames(sequence: Sequence) -> Iterable[Frame]:
    """Return the frames, decoded once for all runs on a video that isn't too large."""
    global _kept
    if _kept is not None and _kept[0] == sequence.video:
        return _kept[1]
    _kept = None
    stream = iter(sequence.frames())
    first = next(stream)
    if first.nbytes * len(sequence) > _KEPT_BYTES:
        return sequence.frames()
    frames = [first, *stream]
    _kept = (sequence.video, frames)
    return frames


def _forget_frames() -> None:
    """Let go of the kept frames: the next evaluation in this process may be of other files."""
    global _kept
    _kept = None


def _one_thread() -> None:
    cv2.setNumThreads(1)


@contextmanager
def _importable_main() -> Iterator[None]:
    """Hide a script that came through standard input: new processes look in vain for its file."""
    main = sys.modules['__main__']
    path = getattr(main, '__file__', None)
    if path is None or Path(path).is_file():
        yield
        return
    del main.__file__
    try:
        yield
    finally:
        main.__file__ = path
