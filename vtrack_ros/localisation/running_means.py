"""Running means over frames, of a value and of a velocity, and the time of examples in them."""

import math

from vtrack_ros.frame import Point


def latest_weight(rate: float, dt: float, time: float = math.inf) -> float:
    """
    Return the weight of the last `dt` frames in a running mean over a `time`, [frames].

    That of a plain mean at first; later on, and by default, that of a moving average, `rate` a
    frame.
    """
    return min(max(rate * dt, dt / time), 1.0)


def mean_velocity(before: Point, start: Point, end: Point, dt: float, rate: float) -> Point:
    """
    Return the mean of a velocity, [px/frame], after one more step from start to end, in pixels.

    The step took `dt` frames; its weight is `rate`.
    """
    x, y = ((1 - rate) * velocity + rate * (now - then) / dt
            for velocity, then, now in zip(before, start, end))
    return x, y


class ExampleTime:
    """
    The time, in frames, that the examples of a target stand for, and what is due by it.

    At a low frame rate an example stands for several frames. After a gap it stands for as many as
    the one before: it doesn't show what the target was like meanwhile.
    """

    def __init__(self) -> None:
        self.step = 1.0
        """The time that the latest example stands for."""
        self._now, self._interval = 0.0, 1.0

    def advance(self, dt: float, by_one: bool = False) -> None:
        """Take an example `dt` after the last one; `by_one`: it stands for one frame."""
        self.step = 1.0 if by_one else min(dt, self._interval)
        self._interval = dt
        self._now += self.step

    @property
    def is_first(self) -> bool:
        """Tell whether there was only one example."""
        return self._now == self.step

    def is_due(self, every: int, phase: int = 0) -> bool:
        """Tell whether the time has come for what is done at that interval."""
        now = self._now - phase
        return now // every > (now - self.step) // every

    def count(self, every: int) -> float:
        """Return how many of those intervals an example taken at each stands for."""
        return max(self.step / every, 1.0)
