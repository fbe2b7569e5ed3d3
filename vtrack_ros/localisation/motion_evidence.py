"""What a target's motion over the ground says of its presence."""

import math

from vtrack_ros.appearance.image_motion import SparsePicture
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.running_means import latest_weight

#: Interval [frames] over which motion is measured, from the first frame on: not in the frames that
#: measure size or flow.
_EVERY = 2
#: Offset of the speed before its logarithm, [sides a frame]: speeds well below it count as rest;
#: upper clamp of the speed.
_SPEED_OFFSET, _LARGEST_SPEED = 0.004, 0.5
#: Weights per frame in the moving averages of log(speed), recent and usual; number of frames of
#: motion after which those are known.
_RECENT_RATE, _USUAL_RATE, _FIRST_FRAMES = 1 / 8, 1 / 40, 5
#: Log-odds: added at the usual speed; subtracted per unit of log(speed) below it (rest), and above
#: it (haste). Upper clamp of that difference of log(speed).
_AS_USUAL, _REST_WEIGHT, _HASTE_WEIGHT, _LARGEST_CHANGE = 0.4, 3.0, 0.75, 0.7


class MotionEvidence:
    """
    Compares a target's recent speed over the ground with its usual one.

    A tracker that has lost its target often stays where that was, and moves with the ground, which
    the target didn't: similarity and sharpness don't tell, for it has learned what's there. Or it
    strays over what resembles the target, faster than that ever was. Speeds are compared by their
    logarithms. For a target that has rested for long, rest is usual.
    """

    def __init__(self, picture: SparsePicture, target: Box) -> None:
        #: The picture of the last measurement, the target's box in it, and the time since then.
        self._picture = picture
        self._before: Box | None = target
        self._since = 0.0
        self._waiting = _EVERY - 1
        #: Time, [frames], with a measured motion; the moving averages of log(speed).
        self._frames = self._recent = self._usual = 0.0

    def update(self, picture: SparsePicture, target: Box, dt: float) -> float:
        """
        Return what is added to the log-odds of the target's presence.

        `target` is its box in this frame, `dt` after the last one.
        """
        self._since += dt
        self._waiting += 1
        if self._waiting == _EVERY:
            before, since = self._before, self._since
            step = None if before is None else self._picture.ground_step(picture, before)
            if before is not None and step is not None:
                own = (target.center[0] - before.center[0] - step[0],
                       target.center[1] - before.center[1] - step[1])
                self._learn(math.hypot(*own) / math.sqrt(target.area) / since, since)
            self._picture, self._before = picture, target
            self._since, self._waiting = 0.0, 0
        return self._value

    def restart(self) -> None:
        """Restart with a target that is found elsewhere: its recent speed is the usual one."""
        self._before, self._recent = None, self._usual

    def _learn(self, speed: float, dt: float) -> None:
        """Update the averages with a speed over the ground, [sides a frame]."""
        value = math.log(_SPEED_OFFSET + min(speed, _LARGEST_SPEED))
        self._frames += dt
        self._recent += latest_weight(_RECENT_RATE, dt, self._frames) * (value - self._recent)
        self._usual += latest_weight(_USUAL_RATE, dt, self._frames) * (value - self._usual)

    @property
    def _value(self) -> float:
        if self._frames <= _FIRST_FRAMES:
            return 0.0
        change = self._recent - self._usual
        weight = _HASTE_WEIGHT if change > 0 else _REST_WEIGHT
        return _AS_USUAL - weight * min(abs(change), _LARGEST_CHANGE)
