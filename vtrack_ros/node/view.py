"""The picture of what the tracker does, for those who look at it."""

from __future__ import annotations

from collections import deque

from vtrack_ros.trackers import Estimate, Frame


class DebugView:
    """Remembers the trail, and draws when asked."""

    def __init__(self, length: int = 60) -> None:
        self._trail: deque[tuple[float, float]] = deque(maxlen=length)

    def note(self, estimate: Estimate | None) -> None:
        """Remember where the target was measured."""
        if estimate is None:
            self._trail.clear()
        elif estimate.measured:
            self._trail.append(estimate.box.center)

    def clear(self) -> None:
        """Forget the trail."""
        self._trail.clear()

    def draw(self, frame: Frame, estimate: Estimate | None, word: str) -> Frame:
        """Return a copy of the frame with box, ellipse, particles, trail and state on it."""
        from vtrack_ros import drawing
        return drawing.annotated(frame, estimate, trail=list(self._trail), text=word)
