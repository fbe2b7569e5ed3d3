"""The results of an evaluation: runs by sequence, tracker and seed, and their figures."""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass
from functools import cached_property

from vtrack_ros.evaluation.runner import Run
from vtrack_ros.evaluation.scoring import (
    confidences, over_seeds, over_sequences, score, with_index)
from vtrack_ros.evaluation.sequences import Sequence
from vtrack_ros.evaluation.tracker_specification import TrackerSpecification
from vtrack_ros.file_names import printable

#: Figures by key, with `KEY_std` for each.
Scores = dict[str, float]


@dataclass(frozen=True)
class Problem:
    """An error of a run, or of a sequence itself; `tracker` is empty then."""

    sequence: str
    tracker: str
    text: str

    def __post_init__(self) -> None:
        """Make names that aren't UTF-8 printable."""
        for name, text in tuple(self.__dict__.items()):
            object.__setattr__(self, name, printable(text))

    def __str__(self) -> str:
        """Return it as one line."""
        return ': '.join(filter(None, (self.sequence, self.tracker, self.text)))


class Results:
    """The runs of an evaluation and what was computed from them."""

    def __init__(self, sequences: Ordered[Sequence], trackers: Ordered[TrackerSpecification],
                 seeds: tuple[int, ...]) -> None:
        self.sequences = {sequence.name: sequence for sequence in sequences}
        self.trackers = {tracker.label: tracker for tracker in trackers}
        self.seeds = seeds
        self.problems: list[Problem] = []
        self._runs: dict[tuple[str, str], dict[int, Run]] = {}

    def add(self, sequence: str, tracker: str, seed: int, run: Run) -> None:
        """Add a run."""
        self._runs.setdefault((sequence, tracker), {})[seed] = run

    def sort(self) -> None:
        """Sort runs and problems, so that their order doesn't depend on the processes' speed."""
        self.problems.sort(key=lambda problem: (problem.sequence, problem.tracker))
        self._runs = {(sequence, tracker): self._runs[sequence, tracker]
                      for sequence in self.sequences for tracker in self.trackers
                      if (sequence, tracker) in self._runs}

    def runs(self, sequence: str, tracker: str) -> dict[int, Run]:
        """Return the runs of a tracker on a sequence by seed; empty where they failed."""
        return self._runs.get((sequence, tracker), {})

    @property
    def timings(self) -> str:
        """Return `measured` if all times are of this evaluation, `cached` if none, or `mixed`."""
        cached = {run.cached for runs in self._runs.values() for run in runs.values()}
        return 'mixed' if len(cached) > 1 else 'cached' if cached == {True} else 'measured'

    @cached_property
    def scores(self) -> dict[str, dict[str, dict[int, Scores]]]:
        """Return sequence -> tracker -> seed -> figures of that run."""
        result: dict[str, dict[str, dict[int, Scores]]] = {name: {} for name in self.sequences}
        for (sequence, tracker), runs in self._runs.items():
            truth = self.sequences[sequence].truth
            result[sequence][tracker] = {seed: score(run, truth) for seed, run in runs.items()}
        return {name: _compared(by_tracker) for name, by_tracker in result.items()}

    @cached_property
    def by_sequence(self) -> dict[str, dict[str, Scores]]:
        """Return sequence -> tracker -> figures, mean and standard deviation over seeds."""
        return {sequence: {tracker: over_seeds(by_seed.values())
                           for tracker, by_seed in by_tracker.items()}
                for sequence, by_tracker in self.scores.items()}

    @cached_property
    def summary(self) -> dict[str, Scores]:
        """
        Tracker -> means over its sequences, mean and standard deviation over seeds.

        Only seeds that ran on all of the tracker's sequences count; a tracker without such a seed
        is left out.
        """
        result = {}
        for tracker in self.trackers:
            ran = [name for name in self.sequences if self.runs(name, tracker)]
            seeds = [seed for seed in self.seeds
                     if all(seed in self.runs(name, tracker) for name in ran)]
            if not ran or not seeds:
                continue
            result[tracker] = {
                seed: over_sequences(
                    (self.scores[name][tracker][seed] for name in ran),
                    (confidences(self.runs(name, tracker)[seed], self.sequences[name].truth)
                     for name in ran))
                for seed in seeds}
        return {tracker: over_seeds(by_seed.values())
                for tracker, by_seed in _compared(result).items()}


def _compared(by_tracker: dict[str, dict[int, Scores]]) -> dict[str, dict[int, Scores]]:
    """Add the composite index per seed; a tracker without that seed is compared by its first."""
    result: dict[str, dict[int, Scores]] = {tracker: {} for tracker in by_tracker}
    for seed in sorted({seed for by_seed in by_tracker.values() for seed in by_seed}):
        rows = {tracker: by_seed.get(seed, next(iter(by_seed.values())))
                for tracker, by_seed in by_tracker.items()}
        for tracker, row in with_index(rows).items():
            if seed in by_tracker[tracker]:
                result[tracker][seed] = row
    return result
