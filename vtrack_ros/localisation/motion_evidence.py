"""What a target's motion over the ground says of its presence."""

from __future__ import annotations

import math

from vtrack_ros.appearance.image_motion import SparsePicture
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.running_means import latest_weight

#: The motion is measured over so many frames, from the first on: not where size and flow are.
_EVERY = 2
#: A speed is told from rest from this on, [sides a frame], and no faster than that; the weights of
#: a frame in the running means, recent and usual, and after how many frames those are known.
_LEAST_SPEED, _LARGEST_SPEED = 0.004, 0.5
_RECENT_RATE, _USUAL_RATE, _FIRST_FRAMES = 1 / 8, 1 / 40, 5
#: What the usual speed adds to the evidence; what a logarithm less, and one more, takes off, each
#: for so much at most.
_AS_USUAL, _REST_WEIGHT, _HASTE_WEIGHT, _LARGEST_CHANGE = 0.4, 3.0, 0.75, 0.7


class MotionEvidence:
    """
    Compares how fast a target moves over the ground with how fast it did.

    A tracker that has lost its target often stays where that was, and moves with the ground as the
    target didn't: look and sharpness don't tell, for what's there it has learned. Or it strays
    over what resembles the target, faster than that ever was. Speeds are compared by their
    logarithms. A target that has rested for long rests as usual.
    """

    def __init__(self, picture: SparsePicture, target: Box) -> None:
        #: The ground as it was seen last, where the target was then, and how many frames since.
        self._picture = picture
        self._before: Box | None = target
        self._since = 0.0
        self._waiting = _EVERY - 1
        #: Frames with a known motion, and the means of the logarithm of their speed.
        self._frames = self._recent = self._usual = 0.0

    def update(self, picture: SparsePicture, target: Box, dt: float) -> float:
        """
        Return what is added to the logarithm of the odds for the target's presence.

        It's in that box of this frame, `dt` after the last one.
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
        """Begin again with a target that is found elsewhere: it moves as usual."""
        self._before, self._recent = None, self._usual

    def _learn(self, speed: float, dt: float) -> None:
        """Take in a speed over the ground, [sides a frame]."""
        value = math.log(_LEAST_SPEED + min(speed, _LARGEST_SPEED))
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
