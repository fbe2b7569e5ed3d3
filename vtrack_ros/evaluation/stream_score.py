"""The figures of merit of a tracked stream of stamped images, by a replay or by a node."""

from collections.abc import Mapping

import numpy as np

from vtrack_ros.bags.replay import Step
from vtrack_ros.evaluation import metrics
from vtrack_ros.frame import Array
from vtrack_ros.geometry import Box

#: Key -> value; None if undefined (such as without truth).
Figures = dict[str, float | None]

_NO_TRUTH = ('mean_iou', 'centre_error_px', 'wrong_tracking')
_ONLY_IF_ANY = ('frames_malformed', 'frames_late')
_TITLES = {
    'frames': ('frames', 'd'), 'frames_sent': ('frames sent', 'd'),
    'frames_received': ('frames received', 'd'), 'frames_malformed': ('malformed', 'd'),
    'frames_late': ('late', 'd'),
    'frames_tracked': ('frames tracked', 'd'), 'frames_dropped': ('frames dropped', 'd'),
    'mean_iou': ('mean IoU', '.3f'), 'centre_error_px': ('mean centre error', '.2f| px'),
    'wrong_tracking': ('wrongly tracking', '.3f'), 'ms_per_frame': ('ms per frame', '.3f'),
    'fps': ('frames per second', '.0f'), 'latency_ms_p50': ('latency p50', '.2f| ms'),
    'latency_ms_p99': ('latency p99', '.2f| ms')}


class StreamScore:
    """
    Accumulates a tracker's outputs, frame by frame.

    `truth` is stamp in nanoseconds -> true box, None where the target is absent; empty if there is
    no truth.
    """

    def __init__(self, truth: Mapping[int, Box | None]) -> None:
        self._truth = truth
        self._stamps: list[int] = []
        self._found: list[Box | None] = []
        self._given: list[bool] = []
        self._times: list[float] = []

    def add(self, stamp: int, found: Box | None, *, given: bool = False,
            milliseconds: float | None = None) -> None:
        """
        Add the frame with a stamp in nanoseconds, and the box `found` in it, None if unmeasured.

        `given` is whether the box was not measured, but given to start on. `milliseconds` is the
        computing time; None if it isn't representative of the tracker's speed.
        """
        self._stamps.append(stamp)
        self._found.append(found)
        self._given.append(given)
        if milliseconds is not None:
            self._times.append(milliseconds)

    def add_step(self, step: Step) -> None:
        """Add a step of a replay; steps before the first estimate are skipped."""
        estimate = step.estimate
        if estimate is None and not self._stamps:
            return
        found = estimate.box if estimate is not None and estimate.measured else None
        # Without a target the tracker does nothing, and a start isn't an update: neither time
        # is representative of its speed.
        timed = estimate is not None and not step.started
        self.add(step.image.stamp, found, given=step.started,
                 milliseconds=step.milliseconds if timed else None)

    def figures(self) -> Figures:
        """
        Return the figures; None where there is no truth, or no time.

        `frames` and `frames_tracked` count the frames, and those with a box. `mean_iou` and
        `centre_error_px` are means over the frames with the target in view: a frame without a box
        counts as IoU 0, and isn't in the centre error. `wrong_tracking` is over the frames whose
        truth is known, except those whose box was given: the share with a box off the target
        (IoU < 0.1) or with the target absent. `ms_per_frame` is the mean time.
        """
        found = np.array([box is not None for box in self._found], dtype=bool)
        known = np.array([stamp in self._truth for stamp in self._stamps], dtype=bool)
        boxes = metrics.truth_rows(self._found)
        truth = metrics.truth_rows(self._truth.get(stamp) for stamp in self._stamps)
        visible = metrics.present(truth)
        overlap = np.where(found | ~visible, metrics.overlaps(boxes, truth), 0.0)
        judged = known & ~np.array(self._given, dtype=bool)
        return {
            'frames': len(found), 'frames_tracked': int(found.sum()),
            'mean_iou': _mean(overlap[visible]),
            'centre_error_px': _mean(metrics.center_errors(boxes, truth)[visible & found]),
            'wrong_tracking': _mean((found & metrics.off_target(overlap))[judged]),
            'ms_per_frame': _mean(np.array(self._times))}


def figures_table(figures: Figures) -> str:
    """Return figures as text for a terminal, one per line."""
    lines = []
    for key, value in figures.items():
        title, layout = _TITLES[key]
        number, _, unit = layout.partition('|')
        if value is None:
            text = 'no truth' if key in _NO_TRUTH else '-'
        else:
            text = format(value, number) + unit
        if key not in _ONLY_IF_ANY or value:
            lines.append(f'{title:<18}{text:>10}')
    return '\n'.join(lines)


def _mean(values: Array | metrics.BoolArray) -> float | None:
    return float(values.mean()) if len(values) else None
