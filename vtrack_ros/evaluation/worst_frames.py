"""The frames in which trackers are at their worst."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, zip_longest

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.evaluation import metrics
from vtrack_ros.evaluation.runner import Run


@dataclass(frozen=True)
class WorstFrame:
    """A frame by its index, whose worst one it is, and that one's overlap; NaN without target."""

    index: int
    tracker: str
    overlap: float


def worst_frames(
        runs: Mapping[str, Run], truth: NDArray[np.float64], limit: int = 3,
        apart: int = 8) -> list[WorstFrame]:
    """
    Return the worst frames of a sequence's runs, at most `limit`, in the order of time.

    Those of a tracker are where its stretches off the target begin, the longest first, and then
    the frames of its least overlap. Every tracker has its turn, the worst one first; frames that
    are closer to one another than `apart` count as one.
    """
    overlaps = {label: metrics.overlaps(run.boxes, truth) for label, run in runs.items()}
    worst_first = sorted(overlaps, key=lambda label: float(np.nanmean(overlaps[label])))
    turns = zip_longest(*(
        [(label, index) for index in _candidates(overlaps[label])] for label in worst_first))
    chosen: list[WorstFrame] = []
    for candidate in chain.from_iterable(turns):
        if candidate is None or len(chosen) == limit:
            continue
        label, index = candidate
        if all(abs(index - other.index) >= apart for other in chosen):
            chosen.append(WorstFrame(index, label, float(overlaps[label][index])))
    return sorted(chosen, key=lambda frame: frame.index)


def _candidates(overlap: NDArray[np.float64]) -> list[int]:
    known = np.nan_to_num(overlap, nan=1.0)
    losses = sorted(metrics.stretches(known < metrics.OFF_TARGET),
                    key=lambda stretch: stretch[0] - stretch[1])
    least = np.argsort(known, kind='stable')
    return [begin for begin, _ in losses] + [int(index) for index in least]
