"""Distractors: look-alikes of the target, followed so that none of them is taken for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import math

from vtrack_ros.frame import Point
from vtrack_ros.localisation.running_means import mean_velocity

#: Distance from the target, [sides], above which a maximum of the response begins a distractor.
_AWAY = 0.4
#: Gate of association: distance from a distractor's expected place, [sides], within which a
#: maximum is taken for it; and from that of a new one, whose velocity isn't known.
AT, _AT_FIRST = 0.3, 0.45
#: Longest time, [frames], for which a target not seen beside a distractor counts as hidden by it.
HIDING = 12
#: Weight of the latest step in a velocity.
_VELOCITY_RATE = 0.5
#: Number of frames in which a distractor has to be found before it's compared with the target, and
#: before it's compared again; share of the target's usual similarity from which it's a look-alike.
_KNOWN, _LEAST_LIKENESS = 2, 0.65
#: Longest time, [frames], for which a distractor is kept without being found; it doesn't count
#: where it's expected at the target's own place. One frame until it was found `_KNOWN` times.
_FORGOTTEN = 12
#: Largest number of distractors that are followed.
_MOST = 20


def is_distractor(place: Point, distractors: Sequence[Point], side: float) -> bool:
    """Tell whether a place, [px], is at a distractor: within `AT` times the target's side."""
    return any(math.dist(place, one) < AT * side for one in distractors)


@dataclass(frozen=True)
class Distractor:
    """
    Something that the model responds to besides the target.

    Its place is in pixels, its velocity in pixels a frame. `frames` is the number of frames in
    which it was found, `compared` that number at its last comparison; `unseen` the time, [frames],
    for which it hasn't been found where it would be seen; `likeness` the highest likeness to the
    target in any comparison.
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

    def found(self, place: Point, dt: float, merged: bool = False) -> Distractor:
        """Return it at the place, [px], where it was found after `dt`, `merged` with another."""
        if merged:
            return replace(self, place=place, unseen=0.0)
        rate = _VELOCITY_RATE if self.frames > 1 else 1.0
        velocity = mean_velocity(self.velocity, self.place, place, dt, rate)
        return replace(self, place=place, velocity=velocity, frames=self.frames + 1, unseen=0.0)


class Distractors:
    """
    What the model responds to besides the target, followed from frame to frame.

    Something seen elsewhere at the same time as the target isn't the target, and still isn't when
    the two have met: then appearance can't tell a target from its double, but their motion can.
    Most maxima are of things that the target isn't mistaken for, and come and go, so only what's
    about as similar to the initial template as the target itself counts.
    """

    def __init__(self) -> None:
        self._known: list[Distractor] = []

    def near(self, place: Point, reach: float, dt: float) -> list[Point]:
        """Return where look-alikes are expected after `dt`, within reach of a place, [px]."""
        expected = [one.expected(dt) for one in self._known if one.likeness >= _LEAST_LIKENESS]
        return [one for one in expected if math.dist(one, place) < reach]

    def forget(self, place: Point, reach: float, dt: float) -> None:
        """Forget those that are expected within reach of a place, [px], after `dt`."""
        self._known = [one for one in self._known if math.dist(one.expected(dt), place) >= reach]

    def update(self, maxima: Sequence[Point], target: Point, side: float, dt: float,
               merged: bool = False) -> None:
        """
        Associate all with the maxima found after `dt`, [px]; begin new ones at the rest.

        While one hides the target, a maximum may be of both (`merged`), and tells no velocity.
        """
        expected = [one.expected(dt) for one in self._known]
        found = _associated(expected, maxima, [
            side * (AT if one.frames > 1 else _AT_FIRST) for one in self._known])
        known = []
        for index, (one, place) in enumerate(zip(self._known, expected)):
            if index in found:
                known.append(one.found(maxima[found[index]], dt, merged))
            elif one.frames >= _KNOWN and math.dist(place, target) < _AWAY * side:
                # one maximum is left of the two
                known.append(replace(one, place=place))
            elif one.unseen + dt <= (_FORGOTTEN if one.frames >= _KNOWN else 1):
                known.append(replace(one, place=place, unseen=one.unseen + dt))
        taken = set(found.values())
        known += [Distractor(place) for index, place in enumerate(maxima)
                  if index not in taken and math.dist(place, target) > _AWAY * side]
        self._known = known[:_MOST]

    def compare(self, target: Point, side: float, likeness: Callable[[Point], float]) -> None:
        """
        Compare one of them with the target: of those that are due the nearest to it, in pixels.

        `likeness` tells how similar a place is to the initial template, as a share of the target's
        usual similarity. Those within `_AWAY` aren't compared: the target itself would be seen.
        """
        due = [one for one in self._known
               if not one.unseen and one.frames >= one.compared + _KNOWN
               and math.dist(one.place, target) > _AWAY * side]
        if due:
            one = min(due, key=lambda each: math.dist(each.place, target))
            self._known[self._known.index(one)] = replace(
                one, likeness=max(one.likeness, likeness(one.place)), compared=one.frames)


def _associated(places: Sequence[Point], maxima: Sequence[Point],
                gates: Sequence[float]) -> dict[int, int]:
    """Return the numbers of places and of the maxima within their gates, nearest pairs first."""
    near = sorted((distance, index, number) for index, place in enumerate(places)
                  for number, maximum in enumerate(maxima)
                  if (distance := math.dist(place, maximum)) < gates[index])
    found: dict[int, int] = {}
    taken: set[int] = set()
    for _, index, number in near:
        if index not in found and number not in taken:
            found[index] = number
            taken.add(number)
    return found
