"""Selecting the target by a box or a click, in the frame that it was drawn on."""

from dataclasses import dataclass

from vtrack_ros.appearance.extent import find_extent
from vtrack_ros.geometry import Box
from vtrack_ros.session.history import FrameHistory, seconds
from vtrack_ros.tracker import checked_box
from vtrack_ros.trackers import Frame

#: How far ahead of the newest frame a selection may be stamped, in nanoseconds; further if the
#: history is longer.
LEAST_AHEAD = 500_000_000
#: The shortest side of a box that can be followed, in pixels.
LEAST_SIDE = 2.0


@dataclass(frozen=True)
class Click:
    """A point of the target, and the side of a square about it; 0: find the target's extent."""

    x: float
    y: float
    size: float = 0.0

    def box_on(self, frame: Frame) -> Box:
        """Return the box about the point; ValueError if the point is outside the frame."""
        height, width = frame.shape[:2]
        if not (0 <= self.x <= width and 0 <= self.y <= height):
            raise ValueError(
                f'the point ({self.x:g}, {self.y:g}) is outside the image of {width} x {height}')
        if self.size:
            return Box.from_center(self.x, self.y, self.size, self.size)
        return find_extent(frame, self.x, self.y)


@dataclass(frozen=True)
class Selection:
    """
    A target that `source`, a topic or a parameter, selected by a box or a click.

    It was drawn on the frame of `stamp` [ns]; None: it's for the next frame. With `clamp` the box
    is clipped to the image; an `automatic` one is a detector's, which may come with every frame.
    """

    box: Box | Click
    source: str
    stamp: int | None = None
    clamp: bool = False
    class_id: str = ''
    target_id: str = ''
    automatic: bool = False

    def box_on(self, frame: Frame) -> Box:
        """
        Return the box to start on.

        ValueError if the box or its centre is outside the frame, or a side is too short or long.
        """
        height, width = frame.shape[:2]
        box = self.box.box_on(frame) if isinstance(self.box, Click) else self.box
        if self.clamp:
            box = box.clipped(width, height) or box
        checked_box(box, frame)
        name = f'box ({box.x:g}, {box.y:g}, {box.width:g}, {box.height:g})'
        x, y = box.center
        if not (0 <= x <= width and 0 <= y <= height):
            raise ValueError(f'{name} has its centre ({x:g}, {y:g}) outside the image of '
                             f'{width} x {height}; the centre must be inside')
        if min(box.width, box.height) < LEAST_SIDE:
            raise ValueError(f'{name} is too small; width and height must be at least '
                             f'{LEAST_SIDE:g} px')
        return box


class Selector:
    """Holds a selection, the `pending` one, until the frame that it was drawn on has come."""

    def __init__(self, history: FrameHistory) -> None:
        self._history = history
        self.pending: Selection | None = None

    def select(self, selection: Selection) -> None:
        """Take a selection in place of any pending one. ValueError if its frame is gone."""
        stamp, oldest = selection.stamp, self._history.oldest
        if stamp is not None and oldest is not None and stamp < oldest - self._history.tolerance:
            raise ValueError(
                f'its stamp {seconds(stamp)} s is too old: {self._history.instead(stamp)}')
        self.pending = selection

    def ready(self) -> tuple[Selection, list[tuple[int, Frame]]] | None:
        """
        Return the selection, and its frame and all later ones, once its frame has come; else None.

        Call it when a frame has come: only then is the camera's time known, which may have been
        paused, or may not have begun, when the selection was made. ValueError if there is no frame
        of its stamp, or the stamp is too far ahead; the selection is dropped then.
        """
        selection, newest = self.pending, self._history.newest
        if selection is None or newest is None:
            return None
        stamp = selection.stamp
        if stamp is not None and newest < stamp:
            if stamp <= newest + max(self._history.seconds * 1e9, LEAST_AHEAD):
                return None
            self.pending = None
            raise ValueError(
                f'its stamp {seconds(stamp)} s is in the future: {self._history.instead(stamp)}')
        self.pending = None
        frames = self._history.since(stamp)
        if stamp is not None and abs(frames[0][0] - stamp) > self._history.tolerance:
            raise ValueError(
                f'there is no frame of its stamp {seconds(stamp)} s; the nearest one has '
                f'{seconds(frames[0][0])} s: {self._history.instead(stamp)}')
        return selection, frames
