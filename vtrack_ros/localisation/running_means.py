"""Running means over frames: of a value, and of a velocity."""

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
