"""The demo's figures: every frame accounted for, and the boxes held against the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
import math
from typing import Any

import numpy as np

from vtrack_ros.evaluation.metrics import wrongly_measured
from vtrack_ros.geometry import Box

#: Less than this share of tracked frames isn't tracking.
LEAST_TRACKED = 0.5
#: Less than this mean overlap with the truth isn't either.
LEAST_IOU = 0.3


@dataclass(frozen=True)
class Summary:
    """
    What a run came to.

    Parameters
    ----------
    frames_sent, frames_received, frames_tracked, frames_dropped : int
        Published by the player; answered by the node; answered with a measured box; sent but
        never answered.
    centre_error_px, mean_iou : float or None
        Over the answered frames that have a truth: the error where there was a box, the overlap
        with 0 where there was none. None without truth.
    wrong_tracking : float or None
        Over the frames that were answered after the first and whose truth is known: the share of
        those with a box off the target (IoU < 0.1), or with the target absent. None without truth.
    ms_per_frame : float, [ms]
        The tracker's own time, mean.
    latency_ms_p50, latency_ms_p99 : float, [ms]
        From publishing an image to hearing its detections.

    """

    frames_sent: int
    frames_received: int
    frames_tracked: int
    frames_dropped: int
    centre_error_px: float | None
    mean_iou: float | None
    wrong_tracking: float | None
    ms_per_frame: float | None
    latency_ms_p50: float | None
    latency_ms_p99: float | None

    @property
    def tracked(self) -> bool:
        """Return whether the target was tracked."""
        enough = self.frames_tracked >= LEAST_TRACKED * max(1, self.frames_sent)
        return enough and (self.mean_iou is None or self.mean_iou >= LEAST_IOU)

    def as_json(self) -> dict[str, Any]:
        """Return key -> value."""
        return asdict(self)

    def table(self) -> str:
        """Return the figures for a person."""
        def shown(value: float | None, unit: str) -> str:
            return 'no truth' if value is None else f'{value:.2f}{unit}'
        rows = [
            ('frames sent', str(self.frames_sent)),
            ('frames received', str(self.frames_received)),
            ('frames tracked', str(self.frames_tracked)),
            ('frames dropped', str(self.frames_dropped)),
            ('mean centre error', shown(self.centre_error_px, ' px')),
            ('mean IoU', shown(self.mean_iou, '')),
            ('wrongly tracking', shown(self.wrong_tracking, '')),
            ('ms per frame', '-' if self.ms_per_frame is None else f'{self.ms_per_frame:.2f}'),
            ('latency p50', '-' if self.latency_ms_p50 is None
             else f'{self.latency_ms_p50:.2f} ms'),
            ('latency p99', '-' if self.latency_ms_p99 is None
             else f'{self.latency_ms_p99:.2f} ms'),
        ]
        return '\n'.join(f'{name:<18}{value:>10}' for name, value in rows)


def summarise(frames: Mapping[int, Mapping[str, Any]], truth: Mapping[int, Box | None],
              sent: int) -> Summary:
    """
    Return the figures of a run.

    Parameters
    ----------
    frames : mapping
        The record: stamp -> what was heard, as `Record.frames`.
    truth : mapping
        Stamp -> true box, None where the target is absent; empty without truth.
    sent : int
        How many frames the player published.

    """
    answered = {stamp: row for stamp, row in frames.items() if 'received_ns' in row}
    boxes = {stamp: Box(*row['box']) for stamp, row in answered.items() if 'box' in row}
    visible = {stamp: box for stamp in answered if (box := truth.get(stamp)) is not None}
    overlaps = [boxes[stamp].iou(box) if stamp in boxes else 0.0
                for stamp, box in visible.items()]
    errors = [boxes[stamp].center_distance(box)
              for stamp, box in visible.items() if stamp in boxes]
    # The first frame's box was given.
    wrong = [float(wrongly_measured(boxes.get(stamp), truth[stamp]))
             for stamp in sorted(answered)[1:] if stamp in truth]
    times = [row['ms_per_frame'] for row in answered.values() if 'ms_per_frame' in row]
    latency = [row['latency_ms'] for row in answered.values() if 'latency_ms' in row]
    return Summary(
        sent, len(answered), len(boxes), sent - len(answered), _mean(errors), _mean(overlaps),
        _mean(wrong), _mean(times), _percentile(latency, 50), _percentile(latency, 99))


def _mean(values: list[float]) -> float | None:
    return math.fsum(values) / len(values) if values else None


def _percentile(values: list[float], share: float) -> float | None:
    return float(np.percentile(values, share)) if values else None
