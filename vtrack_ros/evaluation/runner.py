"""Running one tracker over one sequence, once and on one thread, and recording its output."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from itertools import repeat
import time

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box
from vtrack_ros.tracker import Estimate, Tracker

try:
    from threadpoolctl import threadpool_limits
except ImportError:
    # Worker processes are started with one thread; only runs in this process may then use more.
    threadpool_limits = nullcontext


@dataclass(frozen=True)
class Run:
    """
    A tracker's output in one pass over n frames, and its computing times.

    `boxes`, shape (n, 4) in px, are measured or predicted, the first one is the given one;
    `covariances`, shape (n, 2, 2) in px^2, are those of the centre; `measured` is whether the
    state was TRACKING. `wall_ms` and `cpu_ms`, shape (n - 1,), are the elapsed time of each update
    and the process's processor time, all threads together. A `cached` run was made earlier, so
    that its times may be another machine's.
    """

    boxes: Array
    covariances: Array
    confidences: Array
    measured: NDArray[np.bool_]
    wall_ms: Array
    cpu_ms: Array
    cached: bool = False


def run_tracker(tracker: Tracker, frames: Iterable[Frame], first_box: Box,
                steps: Iterable[float] | None = None) -> Run:
    """
    Start a tracker on the first frame and update it with every other one.

    Only `update` is timed: neither reading a frame nor starting. `steps` is for each frame the
    time since the previous one, in frame intervals, by default 1. ValueError without any frame.
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


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit OpenCV and the linear algebra to one thread within the context."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        cv2.setNumThreads(threads)
