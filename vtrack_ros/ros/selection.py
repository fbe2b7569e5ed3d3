"""Selecting the target: boxes out of messages, started on the frames they were drawn on."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from vtrack_ros.geometry import Box
from vtrack_ros.ros.history import FrameHistory, seconds
from vtrack_ros.ros.images import stamp_nanoseconds
from vtrack_ros.trackers import Frame

#: How far ahead of the frames a selection may be however few are kept, in nanoseconds.
LEAST_AHEAD = 500_000_000
#: The shortest side of a box that can be followed, in pixels.
LEAST_SIDE = 2.0


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
        The stamp of the frame it was drawn on; None: the next frame.
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
            If it has no part inside the frame, its centre lies outside, or a side is too short.

        """
        height, width = frame.shape[:2]
        inside = self.box.clipped(width, height)
        box = inside if inside is not None and self.clamp else self.box
        name = f'box ({box.x:g}, {box.y:g}, {box.width:g}, {box.height:g})'
        if inside is None:
            raise ValueError(f'{name} has no pixel inside the image of {width} x {height}')
        x, y = box.center
        if not (0 <= x <= width and 0 <= y <= height):
            raise ValueError(f'{name} has its centre ({x:g}, {y:g}) outside the image of '
                             f'{width} x {height}; the centre must be inside')
        if min(box.width, box.height) < LEAST_SIDE:
            raise ValueError(f'{name} is too small; width and height must be at least '
                             f'{LEAST_SIDE:g} px')
        return box


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
            If its frame is no longer there.

        """
        stamp, oldest = selection.stamp, self._history.oldest
        if stamp is not None and oldest is not None and stamp < oldest - self._history.tolerance:
            raise ValueError(
                f'its stamp {seconds(stamp)} s is too old: {self._history.instead(stamp)}')
        self._pending = selection

    def ready(self) -> tuple[Selection, list[tuple[int, Frame]]] | None:
        """
        Return the selection and the frames to start and go on with, once its frame is there.

        To be asked when a frame has come: only then is it known what time it is for the camera,
        which may have been paused, or may not have begun, when the selection was made.

        Raises
        ------
        ValueError
            If its frame isn't there, or too far ahead to be ever seen; it's forgotten then.

        """
        selection, newest = self._pending, self._history.newest
        if selection is None or newest is None:
            return None
        stamp = selection.stamp
        if stamp is not None and newest < stamp:
            if stamp <= newest + max(self._history.seconds * 1e9, LEAST_AHEAD):
                return None
            self._pending = None
            raise ValueError(
                f'its stamp {seconds(stamp)} s is in the future: {self._history.instead(stamp)}')
        self._pending = None
        frames = self._history.since(stamp)
        if stamp is not None and abs(frames[0][0] - stamp) > self._history.tolerance:
            raise ValueError(
                f'the frame of its stamp {seconds(stamp)} s is not there; the nearest one is of '
                f'{seconds(frames[0][0])} s: {self._history.instead(stamp)}')
        return selection, frames
