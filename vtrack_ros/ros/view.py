"""The picture of what the tracker does, for those who look at it."""

from __future__ import annotations

from collections import deque

from vtrack_ros.drawing import AnnotatedFrame, STATES, TRUTH
from vtrack_ros.trackers import Estimate, Frame


class DebugView:
    """Remembers the trail, and draws when asked."""

    def __init__(self, length: int = 60) -> None:
        self._trail: deque[tuple[float, float]] = deque(maxlen=length)
        self._target = ('', '')

    def note(self, estimate: Estimate | None, target: tuple[str, str]) -> None:
        """Remember where the target was measured; another target leaves another trail."""
        if estimate is None or target != self._target:
            self._trail.clear()
        self._target = target
        if estimate is not None and estimate.measured:
            self._trail.append(estimate.box.center)

    def draw(self, frame: Frame, estimate: Estimate | None, word: str) -> Frame:
        """Return a copy of the frame with box, ellipse, particles, trail and state on it."""
        picture = AnnotatedFrame(frame, enlarge=False)
        picture.trail(self._trail)
        if estimate is None:
            picture.text(word)
        else:
            picture.estimate(estimate)
            picture.text(f'{word} {estimate.confidence:.2f}', STATES.get(estimate.state, TRUTH))
        return picture.picture
