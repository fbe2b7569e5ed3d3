"""Trackers over original sequences and under stress, and a filter's influence on the boxes."""

from collections.abc import Iterable, Mapping, Sequence as Ordered
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
import math

import numpy as np

from vtrack_ros.evaluation import metrics
from vtrack_ros.evaluation.cache import RunCache
from vtrack_ros.evaluation.evaluator import evaluate, Progress
from vtrack_ros.evaluation.results import Results
from vtrack_ros.evaluation.scoring import mean
from vtrack_ros.evaluation.sequences import Sequence, uniquely_named
from vtrack_ros.evaluation.stress import stressed_sequences
from vtrack_ros.evaluation.stress_kinds import STRESS_KINDS, stress_kinds
from vtrack_ros.evaluation.tracker_specification import specifications, TrackerSpecification

#: The tracker without a filter, with which the others are compared.
REFERENCE = 'dcf'
#: Centre distance above which a box counts as elsewhere, in mean sides of the reference's box.
APART = 0.05


@dataclass(frozen=True)
class FilterInfluence:
    """
    How a tracker's boxes differ from those of `dcf` on the same frames and seed.

    `share` is the share of frames whose centres are further apart than `APART`. Over those frames,
    `distance` is the median distance in mean sides of the box of `dcf`, and `gain` the median of
    the overlap with the truth minus that of `dcf`; NaN if there are no such frames.
    """

    share: float
    distance: float
    gain: float


@dataclass
class StressResults:
    """
    The runs on the original sequences (`plain`), and under stress.

    `levels` has the results of the same trackers by kind and severity, mildest first.
    """

    plain: Results
    levels: dict[tuple[str, float], Results]
    seed: int

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kinds of stress."""
        return tuple(dict.fromkeys(kind for kind, _ in self.levels))

    def of_kind(self, kind: str) -> dict[float, Results]:
        """Return the results of a kind by severity."""
        return {severity: results for (name, severity), results in self.levels.items()
                if name == kind}

    def auc(self, kind: str, tracker: str) -> list[float]:
        """Return a tracker's AUC without stress, and then for each severity of a kind."""
        return [results.summary.get(tracker, {}).get('auc', math.nan)
                for results in (self.plain, *self.of_kind(kind).values())]

    @cached_property
    def means(self) -> dict[str, float]:
        """Return tracker -> AUC, averaged over severities and kinds of stress."""
        return {tracker: float(np.mean([self.auc(kind, tracker)[1:] for kind in self.kinds]))
                for tracker in self.plain.trackers}

    def influence(self, kind: str | None, tracker: str) -> FilterInfluence:
        """Return a filter's influence under a kind of stress; without stress if it's None."""
        levels = [self.plain] if kind is None else list(self.of_kind(kind).values())
        distances, gains = [], []
        for results, name in ((results, name) for results in levels for name in results.sequences):
            reference = results.runs(name, REFERENCE)
            truth = results.sequences[name].truth
            for seed, run in results.runs(name, tracker).items():
                other = reference.get(seed) or next(iter(reference.values()), None)
                if other is not None:
                    sides = other.boxes[1:, 2:].mean(axis=1)
                    distances.append(metrics.center_errors(run.boxes, other.boxes)[1:] / sides)
                    gains.append((metrics.overlaps(run.boxes, truth)
                                  - metrics.overlaps(other.boxes, truth))[1:])
        apart = np.concatenate(distances) if distances else np.empty(0)
        gained = np.concatenate(gains) if gains else np.empty(0)
        there = apart > APART
        known = gained[there & np.isfinite(gained)]
        return FilterInfluence(
            mean(there), float(np.median(apart[there])) if there.any() else math.nan,
            float(np.median(known)) if len(known) else math.nan)


def evaluate_stress(trackers: Iterable[str | TrackerSpecification], sequences: Iterable[Sequence],
                    kinds: Iterable[str] = tuple(STRESS_KINDS), seeds: int | Iterable[int] = 1,
                    jobs: int | None = None, progress: Progress | None = None,
                    cache: RunCache | None = None, stress_seed: int = 0) -> StressResults:
    """
    Run every tracker, and `dcf`, over every sequence as it is and at every severity of each kind.

    The stress depends on `stress_seed`, not on the trackers' seeds; `kinds` are of `STRESS_KINDS`.
    The other arguments and errors are those of `evaluate`. `plain.problems` lists all problems.
    """
    chosen = specifications(trackers)
    if REFERENCE not in (tracker.label for tracker in chosen):
        chosen.extend(specifications([REFERENCE]))
    found, names = uniquely_named(sequences), stress_kinds(','.join(kinds))
    numbers = seeds if isinstance(seeds, int) else tuple(seeds)
    made = stressed_sequences(found, names, stress_seed, with_content=cache is not None)
    run = evaluate(chosen, [*found, *made], numbers, jobs, progress, cache)
    sources = {tracker: (run, tracker.label) for tracker in chosen}
    plain = _of(found, sources)
    plain.problems = run.problems
    levels = {(kind, severity): _of([one for one in made if (
        one.kind, one.severity) == (kind, severity)], sources)
        for kind in names for severity in STRESS_KINDS[kind].severities}
    if 'particles' in names:
        few = {(tracker, count): _with_particles(tracker, int(count))
               for count in STRESS_KINDS['particles'].severities for tracker in chosen
               if count < int(tracker.values.get('particles', 0))}
        run = evaluate(few.values(), found, numbers, jobs, progress, cache)
        plain.problems = [*plain.problems, *run.problems]
        for count in STRESS_KINDS['particles'].severities:
            levels['particles', count] = _of(found, {**sources, **{
                tracker: (run, fewer.label) for (tracker, one), fewer in few.items()
                if one == count}})
    return StressResults(plain, levels, stress_seed)


def _of(sequences: Ordered[Sequence],
        sources: Mapping[TrackerSpecification, tuple[Results, str]]) -> Results:
    """Return the results on some sequences; `sources` is tracker -> (its results, label there)."""
    result = Results(sequences, list(sources), next(iter(sources.values()))[0].seeds)
    for sequence, (tracker, (results, label)) in product(sequences, sources.items()):
        for seed, run in results.runs(sequence.name, label).items():
            result.add(sequence.name, tracker.label, seed, run)
    return result


def _with_particles(tracker: TrackerSpecification, count: int) -> TrackerSpecification:
    parameters = {**dict(tracker.parameters), 'particles': count}
    return replace(tracker, label=f'{tracker.label} [{count} particles]',
                   parameters=tuple(sorted(parameters.items())))
