"""Figures of runs, intervals of the difference of two trackers, and verdicts on claims."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np
from paper_experiments.films import Outcome

from vtrack_ros.evaluation import metrics
from vtrack_ros.evaluation.scoring import composite_index
from vtrack_ros.frame import Array

#: Figures of one tracker by name, each with a value for each run.
Figures = dict[str, Array]
#: A run has finished if its mean overlap in the last frames exceeds a threshold.
LAST_FRAMES, LAST_OVERLAP = 10, 0.3
#: Fewer runs than this allow no verdict.
FEWEST = 5
_RESAMPLES = 4000
HOLDS, FAILS, OPEN = 'holds', 'does not hold', 'open'


@dataclass(frozen=True)
class Interval:
    """A value and its 95 % interval, by bootstrap over paired runs."""

    value: float
    low: float
    high: float
    count: int

    def __str__(self) -> str:
        """Return value and interval in three digits."""
        return f'{_short(self.value)} ({_short(self.low)} to {_short(self.high)})'

    def below(self, limit: float) -> str:
        """Return the verdict on the claim that the value is below a limit."""
        if self.count < FEWEST or not all(map(math.isfinite, (self.low, self.high))):
            return OPEN
        return HOLDS if self.high < limit else FAILS if self.low >= limit else OPEN

    def above(self, limit: float) -> str:
        """Return the verdict on the claim that the value is above a limit."""
        return Interval(-self.value, -self.high, -self.low, self.count).below(-limit)


@dataclass
class Experiment:
    """
    The results of a paper's experiments.

    `tables` is title -> name in the table -> figure -> value; a claim is [what the paper says,
    what was measured, verdict]; `curves` is chart -> its data.
    """

    tables: dict[str, dict[str, dict[str, float | None]]] = field(default_factory=dict)
    claims: list[list[str]] = field(default_factory=list)
    curves: dict[str, Any] = field(default_factory=dict)

    def claim(self, says: str, measured: str, verdict: str) -> None:
        """Note a claim beside what was measured, and the verdict."""
        self.claims.append([says, measured, verdict])

    def table(self, title: str, rows: Mapping[str, Figures]) -> None:
        """Add a table of means over runs, with standard errors of the errors."""
        self.tables[title] = summary(rows)


def figures(outcomes: Sequence[Outcome]) -> Figures:
    """Return the figures of a tracker's runs."""
    return collected([_figures(outcome) for outcome in outcomes])


def collected(rows: Sequence[Mapping[str, float]]) -> Figures:
    """Return name -> values of all runs."""
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def errors(outcome: Outcome, frames: slice | Array = np.s_[:], hidden: bool = False) -> Array:
    """Return the centre errors in some frames; where it's hidden NaN, unless `hidden` is set."""
    truth = outcome.film.outline if hidden else outcome.film.truth
    result: Array = metrics.center_errors(outcome.run.boxes, truth)[frames]
    return result


def on_target(outcome: Outcome, frames: slice) -> float:
    """Return 1 if the mean overlap in some frames exceeds `LAST_OVERLAP`, else 0."""
    overlap = metrics.overlaps(outcome.run.boxes, outcome.film.truth)[frames]
    return float(np.nanmean(overlap) > LAST_OVERLAP)


def ratio(first: Array, second: Array) -> Interval:
    """Return the ratio of two means over paired runs."""
    return _bootstrap(lambda picked: first[picked].mean(-1) / second[picked].mean(-1), len(first))


def difference(first: Array, second: Array) -> Interval:
    """Return the difference of two means over paired runs."""
    return _bootstrap(lambda picked: first[picked].mean(-1) - second[picked].mean(-1), len(first))


def share(values: Array) -> Interval:
    """Return a share of runs with Wilson's interval, which shares of 0 and 1 have too."""
    count, mean, z2 = len(values), float(values.mean()), 1.96**2
    middle = (mean + z2 / (2 * count)) / (1 + z2 / count)
    half = 1.96 / (1 + z2 / count) * math.sqrt(
        mean * (1 - mean) / count + z2 / (4 * count**2))
    return Interval(mean, max(0.0, middle - half), min(1.0, middle + half), count)


def composite(rows: Mapping[str, Figures], picked: Any = None) -> Array:
    """Return the composite index [Zhu2012, eq. 21] of each tracker, over some of the runs."""
    which = slice(None) if picked is None else picked
    return composite_index([[float(row[name][which].mean()) for name in (
        'ms', 'error', 'variance')] for row in rows.values()])


def resampled(statistic: Callable[[Any], float], count: int) -> list[float]:
    """Return a statistic of the runs picked, for many bootstrap samples."""
    picked = np.random.default_rng(0).integers(count, size=(400, count))
    return [statistic(one) for one in picked]


def both(*verdicts: str) -> str:
    """Return the verdict on a claim that consists of several claims."""
    return FAILS if FAILS in verdicts else OPEN if OPEN in verdicts else HOLDS


def listed(rows: Mapping[str, Figures], name: str, digits: int = 1) -> str:
    """Return the means of a figure with their standard errors, by tracker."""
    parts = []
    for label, row in rows.items():
        error = _standard_error(row[name])
        tail = '' if error is None else f' ± {error:.{digits}f}'
        parts.append(f'{label} {row[name].mean():.{digits}f}{tail}')
    return ', '.join(parts)


def summary(rows: Mapping[str, Figures]) -> dict[str, dict[str, float | None]]:
    """Return the means over runs by tracker, the error's standard error, and the CEI."""
    result: dict[str, dict[str, float | None]] = {}
    for label, row in rows.items():
        result[label] = {name: float(values.mean()) for name, values in row.items()}
        if 'error' in row:
            result[label]['error_se'] = _standard_error(row['error'])
    complete = all('variance' in row for row in rows.values())
    if complete and all(np.isfinite(row['error']).all() for row in rows.values()):
        for label, index in zip(rows, composite(rows).tolist()):
            result[label]['cei'] = index
    return result


def mean_by_frame(rows: Sequence[Array]) -> list[list[float | None]]:
    """Return the mean over runs of arrays by frame, None where no run has one, in rows of 60."""
    stacked = np.stack(rows)
    counts = np.isfinite(stacked).sum(0)
    sums = np.nansum(stacked, axis=0)
    means = [round(float(total / count), 2) if count else None
             for total, count in zip(sums, counts)]
    return [means[start:start + 60] for start in range(0, len(means), 60)]


def _figures(outcome: Outcome) -> dict[str, float]:
    run, film = outcome.run, outcome.film
    truth, boxes = film.truth, run.boxes
    error, overlap = errors(outcome), metrics.overlaps(boxes, truth)
    areas = boxes[:, 2:].prod(axis=1), truth[:, 2:].prod(axis=1)
    there = np.isfinite(overlap)
    return {
        'error': float(np.nanmean(error)), 'variance': float(np.nanvar(error)),
        'auc': metrics.success_auc(overlap),
        'size_error': float(np.nanmean(np.abs(np.sqrt(areas[0] / areas[1]) - 1))),
        'followed': float((overlap[there] > LAST_OVERLAP).mean() >= 0.75),
        'finished': float(overlap[there][-LAST_FRAMES:].mean() > LAST_OVERLAP),
        'ms': float(np.median(run.cpu_ms))}


def _short(value: float) -> str:
    return f'{value:.2f}' if abs(value) < 10 else f'{value:.0f}'


def _standard_error(values: Array) -> float | None:
    return float(values.std(ddof=1) / math.sqrt(len(values))) if len(values) > 1 else None


def _bootstrap(statistic: Callable[[Any], Any], count: int) -> Interval:
    picked = np.random.default_rng(0).integers(count, size=(_RESAMPLES, count))
    low, high = np.percentile(statistic(picked), [2.5, 97.5])
    return Interval(float(statistic(np.arange(count))), float(low), float(high), count)
