"""Selecting the target: boxes out of messages, and the frames that they were drawn on."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import math
from typing import Any

from vtrack_ros.geometry import Box
from vtrack_ros.ros.images import stamp_nanoseconds
from vtrack_ros.trackers import Frame

#: How far a selection's stamp may be from the frame it's taken for, in nanoseconds.
TOLERANCE = 500_000_000


@dataclass(frozen=True)
class Selection:
    """
    A target that somebody pointed out.

    Parameters
    ----------
    box : Box
    source : str
        Who pointed it out, for messages: a topic or a parameter.
    stamp : int or None, [ns]
        The stamp of the frame it was drawn on; None: the newest frame.
    clamp : bool
        Whether only the part inside the image is meant.
    class_id, target_id : str
        What the target is called, where that's known.

    """

    box: Box
    source: str
    stamp: int | None = None
    clamp: bool = False
    class_id: str = ''
    target_id: str = ''

    def box_on(self, frame: Frame) -> Box:
        """
        Return the box to start on.

        Raises
        ------
        ValueError
            If it has no part inside the frame.

        """
        height, width = frame.shape[:2]
        inside = self.box.clipped(width, height)
        if inside is None:
            raise ValueError(
                f'box ({self.box.x:g}, {self.box.y:g}, {self.box.width:g}, {self.box.height:g}) '
                f'has no pixel inside the image of {width} x {height}')
        return inside if self.clamp else self.box


def from_detection(message: Any, source: str) -> Selection:
    """
    Return the selection that a vision_msgs/msg/Detection2D makes.

    A rotated box stands for its axis-aligned bound.

    Raises
    ------
    ValueError
        If the box isn't finite, or its size isn't positive.

    """
    bounds = message.bbox
    center, theta = bounds.center.position, float(bounds.center.theta)
    width, height = float(bounds.size_x), float(bounds.size_y)
    given = {'center x': float(center.x), 'center y': float(center.y), 'theta': theta,
             'size_x': width, 'size_y': height}
    for name, value in given.items():
        if not math.isfinite(value):
            raise ValueError(f'box {name} must be finite, not {value}')
    if theta and width > 0 and height > 0:
        cosine, sine = abs(math.cos(theta)), abs(math.sin(theta))
        width, height = width * cosine + height * sine, width * sine + height * cosine
    box = Box.from_center(float(center.x), float(center.y), width, height)
    stamp = stamp_nanoseconds(message.header.stamp)
    best = best_hypothesis(message)
    return Selection(box, source, stamp or None, class_id=best[0], target_id=str(message.id))


def from_roi(message: Any, source: str) -> Selection:
    """
    Return the selection that a sensor_msgs/msg/RegionOfInterest makes.

    Raises
    ------
    ValueError
        If its size is zero.

    """
    box = Box(message.x_offset, message.y_offset, message.width, message.height)
    return Selection(box, source, clamp=True)


def best_hypothesis(detection: Any) -> tuple[str, float]:
    """Return class and score of a detection's best hypothesis; '' and 0 where it has none."""
    scored = [(float(result.hypothesis.score), str(result.hypothesis.class_id))
              for result in detection.results]
    if not scored:
        return '', 0.0
    score, class_id = max(scored)
    return class_id, score


def best_detection(message: Any, class_id: str, score: float, source: str) -> Selection | None:
    """
    Return the best detection of a class as a selection.

    Parameters
    ----------
    message : vision_msgs/msg/Detection2DArray
        What a detector found.
    class_id : str
        The class; empty: any.
    score : float
        The least score.
    source : str
        For messages.

    Returns
    -------
    Selection or None
        None where none is good enough.

    """
    found: list[tuple[float, Selection]] = []
    for detection in message.detections:
        scores = [float(result.hypothesis.score) for result in detection.results
                  if class_id in ('', result.hypothesis.class_id)]
        if not scores or not max(scores) >= score:
            continue
        try:
            selection = from_detection(detection, source)
        except ValueError:
            continue
        stamp = selection.stamp or stamp_nanoseconds(message.header.stamp) or None
        name = class_id or selection.class_id
        found.append((max(scores), Selection(
            selection.box, source, stamp, True, name, selection.target_id)))
    return max(found, key=lambda pair: pair[0])[1] if found else None


class FrameHistory:
    """
    The latest frames, bounded both in time and in memory.

    Parameters
    ----------
    seconds : float
        How old a frame may be.
    megabytes : float
        How much memory the frames may take; the newest frame is kept whatever it takes.

    """

    def __init__(self, seconds: float, megabytes: float) -> None:
        self.seconds = seconds
        self.megabytes = megabytes
        self._frames: deque[tuple[int, Frame]] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._frames)

    @property
    def nbytes(self) -> int:
        """Return the memory that the frames take, in bytes."""
        return self._bytes

    @property
    def newest(self) -> int | None:
        """Return the newest frame's stamp in nanoseconds; None where there is no frame."""
        return self._frames[-1][0] if self._frames else None

    @property
    def oldest(self) -> int | None:
        """Return the oldest frame's stamp in nanoseconds; None where there is no frame."""
        return self._frames[0][0] if self._frames else None

    def append(self, stamp: int, frame: Frame) -> None:
        """Add a frame; a stamp that goes backwards clears what came before."""
        if self._frames and stamp < self._frames[-1][0]:
            self.clear()
        self._frames.append((stamp, frame))
        self._bytes += frame.nbytes
        while len(self._frames) > 1 and (
                self._bytes > self.megabytes * 1e6
                or stamp - self._frames[0][0] > self.seconds * 1e9):
            self._bytes -= self._frames.popleft()[1].nbytes

    def clear(self) -> None:
        """Forget all frames."""
        self._frames.clear()
        self._bytes = 0

    def since(self, stamp: int | None) -> list[tuple[int, Frame]]:
        """Return the frame nearest to `stamp` and all later ones; None: the newest frame alone."""
        frames = list(self._frames)
        if stamp is None:
            return frames[-1:]
        nearest = min(range(len(frames)), key=lambda i: abs(frames[i][0] - stamp), default=0)
        return frames[nearest:]


class Selector:
    """
    Holds a selection until the frame that it was drawn on is there.

    Parameters
    ----------
    history : FrameHistory

    """

    def __init__(self, history: FrameHistory) -> None:
        self._history = history
        self._pending: Selection | None = None

    @property
    def pending(self) -> Selection | None:
        """Return the selection that waits for its frame."""
        return self._pending

    def clear(self) -> None:
        """Forget the selection that waits."""
        self._pending = None

    def select(self, selection: Selection) -> None:
        """
        Take a selection; the latest one counts.

        Raises
        ------
        ValueError
            If its frame is no longer there, or is too far ahead to be ever seen.

        """
        stamp, oldest, newest = selection.stamp, self._history.oldest, self._history.newest
        if stamp is not None and oldest is not None and newest is not None:
            kept = (f'frames are kept from {_seconds(oldest)} to {_seconds(newest)} s; a stamp '
                    'of 0 takes the newest frame')
            if stamp < oldest - TOLERANCE:
                raise ValueError(f'its stamp {_seconds(stamp)} s is too old: {kept}')
            ahead = max(self._history.seconds * 1e9, TOLERANCE)
            if stamp > newest + ahead:
                raise ValueError(f'its stamp {_seconds(stamp)} s is in the future: {kept}')
        self._pending = selection

    def ready(self) -> tuple[Selection, list[tuple[int, Frame]]] | None:
        """
        Return the selection and the frames to start and go on with, once its frame is there.

        Raises
        ------
        ValueError
            If its frame never came.

        """
        selection, newest = self._pending, self._history.newest
        if selection is None or newest is None:
            return None
        if selection.stamp is not None and newest < selection.stamp:
            return None
        self._pending = None
        frames = self._history.since(selection.stamp)
        if selection.stamp is not None and abs(frames[0][0] - selection.stamp) > TOLERANCE:
            raise ValueError(
                f'the frame of its stamp {_seconds(selection.stamp)} s was never received; the '
                f'nearest one is of {_seconds(frames[0][0])} s')
        return selection, frames


def _seconds(stamp: int) -> str:
    return f'{stamp // 10**9}.{stamp % 10**9:09d}'
