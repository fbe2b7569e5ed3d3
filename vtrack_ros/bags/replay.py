"""Running a tracker over a bag: as fast as it goes, the same every time, without a node."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
import time

import numpy as np

from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.reader import StampedFrame
from vtrack_ros.evaluation.metrics import wrongly_measured
from vtrack_ros.geometry import Box
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import Estimate

#: The state of a frame without a target, as the node calls it.
WAITING = 'waiting'


@dataclass(frozen=True)
class Step:
    """
    What came of one frame.

    Parameters
    ----------
    image : StampedFrame
        The frame.
    estimate : Estimate or None
        What the tracker knew after it; None while there is no target.
    milliseconds : float
        How long the tracker took.
    started : bool
        Whether the tracker was started on this frame.

    """

    image: StampedFrame
    estimate: Estimate | None
    milliseconds: float
    started: bool = False


def replay(images: Iterable[StampedFrame], session: TrackingSession,
           truth: Mapping[int, Box | None], box: Box | None = None) -> Iterator[Step]:
    """
    Follow a target through images, as the node would that drops none of them.

    Parameters
    ----------
    images : iterable of StampedFrame
        In the order in which they came.
    session : TrackingSession
        What follows the target; it has none yet.
    truth : mapping
        Stamp in nanoseconds -> true box, None where the target is absent.
    box : Box, optional
        Where the target is in the first image, and again where the stamps go backwards because a
        stream begins anew; by default the first true box says where it is, and when.

    Raises
    ------
    BagError
        If neither a box nor the truth says where the target is, or nothing of it is in the image.

    """
    last: int | None = None
    waiting = True
    for image in images:
        if last is not None and image.stamp < last:
            session.forget()
            waiting = True
        last = image.stamp
        first = (box or truth.get(image.stamp)) if waiting else None
        began = time.perf_counter()
        if first is not None:
            try:
                estimate: Estimate | None = session.start(image.frame, image.stamp, first)
            except ValueError as error:
                raise BagError(f'the tracker cannot start at stamp {image.stamp}: {error}'
                               ) from None
        else:
            estimate = session.update(image.frame, image.stamp)
        taken = (time.perf_counter() - began) * 1e3
        yield Step(image, estimate, taken, started=first is not None)
        waiting = waiting and first is None
    if waiting and last is not None:
        raise BagError('nothing says where the target is: the bag has no true box for any image; '
                       'give --init X,Y,WIDTH,HEIGHT')


@dataclass(frozen=True)
class Figures:
    """
    What a replay came to.

    Parameters
    ----------
    frames, frames_tracked, frames_malformed : int
        Images that were followed; those with a measured box; those that could not be read.
    mean_iou, centre_error_px : float or None
        Over the images whose truth is known and present, from the start on: the overlap with 0
        where no box was measured, the error where one was. None without truth.
    ms_per_frame : float or None, [ms]
        The tracker's own time, mean over the frames with a target, without the starting ones.
    wrong_tracking : float or None
        Over the images whose truth is known, after the start: the share of those with a measured
        box that is off the target (IoU < 0.1), or with the target absent. None without truth.

    """

    frames: int
    frames_tracked: int
    frames_malformed: int
    mean_iou: float | None
    centre_error_px: float | None
    ms_per_frame: float | None
    wrong_tracking: float | None

    @property
    def frames_per_second(self) -> float | None:
        """Return how many frames the tracker does in a second."""
        return 1e3 / self.ms_per_frame if self.ms_per_frame else None

    def as_json(self) -> dict[str, float | int | None]:
        """Return key -> value."""
        return {'frames': self.frames, 'frames_tracked': self.frames_tracked,
                'frames_malformed': self.frames_malformed, 'mean_iou': self.mean_iou,
                'centre_error_px': self.centre_error_px, 'wrong_tracking': self.wrong_tracking,
                'ms_per_frame': self.ms_per_frame, 'fps': self.frames_per_second}

    def table(self) -> str:
        """Return the figures for a person."""
        def shown(value: float | None, digits: int, unit: str, missing: str) -> str:
            return missing if value is None else f'{value:.{digits}f}{unit}'
        rows = [
            ('frames', str(self.frames)), ('tracked', str(self.frames_tracked)),
            ('mean IoU', shown(self.mean_iou, 3, '', 'no truth')),
            ('mean centre error', shown(self.centre_error_px, 2, ' px', 'no truth')),
            ('wrongly tracking', shown(self.wrong_tracking, 3, '', 'no truth')),
            ('ms per frame', shown(self.ms_per_frame, 3, '', '-')),
            ('frames per second', shown(self.frames_per_second, 0, '', '-'))]
        if self.frames_malformed:
            rows.insert(1, ('malformed', str(self.frames_malformed)))
        return '\n'.join(f'{name:<18}{value:>10}' for name, value in rows)


class Scoring:
    """
    Gathers the figures of a replay, step by step.

    Parameters
    ----------
    truth : mapping
        Stamp in nanoseconds -> true box, None where the target is absent.

    """

    def __init__(self, truth: Mapping[int, Box | None]) -> None:
        self._truth = truth
        self._frames = self._tracked = 0
        self._times: list[float] = []
        self._overlaps: list[float] = []
        self._errors: list[float] = []
        self._wrong: list[float] = []

    def add(self, step: Step) -> None:
        """Count a step in."""
        estimate, stamp = step.estimate, step.image.stamp
        if estimate is None and self._frames == 0:
            return
        self._frames += 1
        if estimate is not None and not step.started:
            self._times.append(step.milliseconds)
        found = estimate.box if estimate is not None and estimate.measured else None
        self._tracked += found is not None
        box = self._truth.get(stamp)
        if stamp in self._truth and not step.started:
            self._wrong.append(wrongly_measured(found, box))
        if box is not None:
            self._overlaps.append(0.0 if found is None else found.iou(box))
            if found is not None:
                self._errors.append(found.center_distance(box))

    def figures(self, malformed: int = 0) -> Figures:
        """Return the figures, given how many images could not be read."""
        return Figures(self._frames, self._tracked, malformed, _mean(self._overlaps),
                       _mean(self._errors), _mean(self._times), _mean(self._wrong))


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
