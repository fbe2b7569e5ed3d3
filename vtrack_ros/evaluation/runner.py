"""Running one tracker over one sequence, once, and keeping all that it said."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import repeat
import time

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.tracker import Estimate, Tracker


@dataclass(frozen=True)
class Run:
    """
    What a tracker said in one pass over n frames, and how long it took.

    Parameters
    ----------
    boxes : ndarray, shape (n, 4), [px]
        Measured or predicted; the first is the box that was given.
    covariances : ndarray, shape (n, 2, 2), [px^2]
        Of the centre.
    confidences : ndarray, shape (n,)
    measured : ndarray of bool, shape (n,)
        Whether the state was TRACKING.
    wall_ms, cpu_ms : ndarray, shape (n - 1,), [ms]
        The time of each update, by the clock and of the process on all its threads.
    cached : bool
        Whether it was run at another time, so that its times may be another machine's.

    """

    boxes: NDArray[np.float64]
    covariances: NDArray[np.float64]
    confidences: NDArray[np.float64]
    measured: NDArray[np.bool_]
    wall_ms: NDArray[np.float64]
    cpu_ms: NDArray[np.float64]
    cached: bool = False


def run_tracker(tracker: Tracker, frames: Iterable[Frame], first_box: Box,
                steps: Iterable[float] | None = None) -> Run:
    """
    Start a tracker on the first frame and update it with every other one.

    Only `update` is timed: neither reading a frame nor starting. `steps` is for each frame the
    time since the one before, in frame intervals, by default 1.

    Raises
    ------
    ValueError
        If there is no frame; and whatever the tracker raises.

    """
    estimates: list[Estimate] = []
    times: list[tuple[float, float]] = []
    for frame, step in zip(frames, repeat(1.0) if steps is None else steps):
        if not estimates:
            estimates.append(tracker.start(frame, first_box))
            continue
        cpu_began, began = time.process_time(), time.perf_counter()
        estimate = tracker.update(frame, step)
        ended, cpu_ended = time.perf_counter(), time.process_time()
        estimates.append(estimate)
        times.append((1e3 * (ended - began), 1e3 * (cpu_ended - cpu_began)))
    if not estimates:
        raise ValueError('the sequence has no frames')
    boxes = np.array([estimate.box.as_array() for estimate in estimates])
    boxes[0] = first_box.as_array()
    wall, cpu = np.array(times).reshape(-1, 2).T
    return Run(
        boxes=boxes,
        covariances=np.array([estimate.covariance[:2, :2] for estimate in estimates]),
        confidences=np.array([estimate.confidence for estimate in estimates], dtype=np.float64),
        measured=np.array([estimate.measured for estimate in estimates]),
        wall_ms=wall, cpu_ms=cpu)
