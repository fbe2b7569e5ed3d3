"""The interval between a camera's frames, estimated from the stamps of those that came."""

from __future__ import annotations

from collections import deque
from statistics import median


class FrameIntervalEstimator:
    """
    Tells how many frame intervals passed between two stamps.

    The interval is the median of the latest ones, so that neither jitter nor a dropped frame
    moves it.

    Parameters
    ----------
    memory : int
        How many intervals the median is taken over.

    """

    def __init__(self, memory: int = 15) -> None:
        self._intervals: deque[int] = deque(maxlen=memory)

    def step(self, interval: int) -> float:
        """Return the number of frame intervals in `interval` nanoseconds: a whole number >= 1."""
        self._intervals.append(interval)
        return float(max(1, round(interval / max(1, median(self._intervals)))))
