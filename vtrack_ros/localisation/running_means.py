"""Running means of what is seen in each frame: of a value, and of a velocity."""

from vtrack_ros.frame import Point


def latest_weight(rate: float, dt: float, time: float) -> float:
    """
    Return the weight of what came in the last `dt` in a running mean over a `time`.

    It's that of a plain mean at first, and `rate` in a frame later on.
    """
    return min(max(rate * dt, dt / time), 1.0)


def mean_velocity(before: Point, start: Point, end: Point, dt: float, rate: float) -> Point:
    """
    Return the mean of a velocity, [px/frame], after one more step from start to end, in pixels.

    The step took `dt` frames, and has that weight.
    """
    x, y = ((1 - rate) * velocity + rate * (now - then) / dt
            for velocity, then, now in zip(before, start, end))
    return x, y
