"""Other things that look like the target, followed so that none of them is taken for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
import math

from vtrack_ros.frame import Point
from vtrack_ros.localisation.running_means import mean_velocity

#: A maximum of the response begins a distractor further than that from the target, in sides.
_AWAY = 0.4
#: What is found nearer than that to where one is expected, in sides, is the distractor.
AT = 0.3
#: For so many frames at most one hides a target that isn't seen beside it.
HIDING = 12
#: Weight of the latest step in a velocity.
_VELOCITY_RATE = 0.5
#: A distractor is compared with the target when it has been found in so many frames, and again
#: after as many; it looks like it from this share of the target's usual similarity on.
_KNOWN, _ALIKE = 2, 0.6
#: It's forgotten when it hasn't been found for so many frames in which it wasn't at the target's
#: own place; before it's known, after one.
_FORGOTTEN = 12
#: As many are followed at most.
_MOST = 20


def is_distractor(place: Point, distractors: Sequence[Point], side: float) -> bool:
    """Tell whether what was found at a place, [px], is one of those, by a target of that side."""
    return any(math.dist(place, one) < AT * side for one in distractors)


@dataclass(frozen=True)
class Distractor:
    """
    Something that the model answers to beside the target.

    Its place is in pixels, its velocity in pixels a frame. It was found in so many `frames`, and
    wasn't for a time of `unseen`, where it would be; `likeness` is the most that it was like the
    target when compared.
    """

    place: Point
    velocity: Point = (0.0, 0.0)
    frames: int = 1
    unseen: float = 0.0
    likeness: float = 0.0
    compared: int = 0

    def expected(self, dt: float) -> Point:
        """Return where it's expected after `dt`, in pixels."""
        return self.place[0] + dt * self.velocity[0], self.place[1] + dt * self.velocity[1]

    def found(self, place: Point, dt: float) -> Distractor:
        """Return it at the place, in pixels, where it was found after `dt`."""
        rate = _VELOCITY_RATE if self.frames > 1 else 1.0
        velocity = mean_velocity(self.velocity, self.place, place, dt, rate)
        return replace(self, place=place, velocity=velocity, frames=self.frames + 1, unseen=0.0)


class Distractors:
    """
    What the model answers to beside the target, followed from frame to frame.

    Something seen at the same time as the target, elsewhere, isn't it, and still isn't when the
    two have met: no look tells a target from its double then, but where each one was going does.
    Most maxima are of things that the target isn't mistaken for, and come and go, so only what's
    about as similar to the initial template as the target itself counts.
    """

    def __init__(self) -> None:
        self._known: list[Distractor] = []

    def near(self, place: Point, reach: float, dt: float) -> list[Point]:
        """Return where those that look like the target are after `dt`, within reach, [px]."""
        expected = [one.expected(dt) for one in self._known if one.likeness >= _ALIKE]
        return [one for one in expected if math.dist(one, place) < reach]

    def forget(self, place: Point, reach: float, dt: float) -> None:
        """Forget those that are within reach of a place, [px], after `dt`."""
        self._known = [one for one in self._known if math.dist(one.expected(dt), place) >= reach]

    def update(self, maxima: Iterable[Point], target: Point, side: float, dt: float) -> None:
        """Go on by `dt` to the response's maxima, in pixels, beside a target of that side."""
        left, known = list(maxima), []
        for one in self._known:
            expected = one.expected(dt)
            nearest = min(left, key=lambda place: math.dist(place, expected), default=None)
            if nearest is not None and math.dist(nearest, expected) < AT * side:
                left.remove(nearest)
                known.append(one.found(nearest, dt))
            elif one.frames >= _KNOWN and math.dist(expected, target) < _AWAY * side:
                # one maximum is left of the two
                known.append(replace(one, place=expected))
            elif one.unseen + dt <= (_FORGOTTEN if one.frames >= _KNOWN else 1):
                known.append(replace(one, place=expected, unseen=one.unseen + dt))
        known += [Distractor(place) for place in left if math.dist(place, target) > _AWAY * side]
        self._known = known[:_MOST]

    def compare(self, target: Point, side: float,
                likeness: Callable[[Point], float]) -> None:
        """
        Compare one of them with the target: the next one to it, in pixels, of those it's time for.

        `likeness` tells how similar a place is to the initial template, as a share of the target's
        usual similarity. Too near to it, it's the target that would be seen.
        """
        due = [one for one in self._known
               if not one.unseen and one.frames >= max(_KNOWN, one.compared + _KNOWN)
               and math.dist(one.place, target) > _AWAY * side]
        if due:
            one = min(due, key=lambda each: math.dist(each.place, target))
            self._known[self._known.index(one)] = replace(
                one, likeness=max(one.likeness, likeness(one.place)), compared=one.frames)
