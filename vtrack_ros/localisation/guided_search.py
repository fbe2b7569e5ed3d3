"""Where to search for the target, and the choice among maxima by motion and appearance."""

from dataclasses import replace
from functools import partial
import math

import numpy as np

from vtrack_ros.appearance.image_motion import SparsePicture, TargetFlow, TargetMotion
from vtrack_ros.estimation.forecast_mixture import ForecastMixture, STAYING
from vtrack_ros.frame import Frame, Point
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.distractors import AT, Distractors, HIDING
from vtrack_ros.localisation.hypotheses import Hypotheses
from vtrack_ros.localisation.motion_evidence import MotionEvidence
from vtrack_ros.localisation.response_map import (
    distinct, Found, Maximum, ResponseMap, share_of, strong)
from vtrack_ros.localisation.running_means import mean_velocity
from vtrack_ros.localisation.search_window import Grid, inside

#: More windows are searched below this share of the usual response, or where the last frame was
#: longer ago than this, [frames]; after such a gap distractors aren't considered either.
_LOW_RESPONSE, _LONG_GAP = 0.75, 4
#: Windows must be further apart than that, [sides of the target], to be searched.
_WINDOWS_APART = 0.4
#: The eight neighbouring windows, by steps of half a window (right, down).
_AROUND = [(right, down) for right in (-1, 0, 1) for down in (-1, 0, 1) if right or down]
#: Least share of the highest response that makes a maximum a candidate: of the highest one in its
#: window, or, if distractors are near, of all.
_CANDIDATE = 0.6
#: Maxima nearer to a higher one than that, [sides], are of the same object.
_DISTINCT = 0.5
#: Largest number of maxima that are considered: a flat response has thousands.
_MAXIMA = 200
#: Least share of the highest response that makes a maximum a possible distractor; distance from a
#: higher one or the target, [sides], within which it's of the same object.
_DISTRACTING, _DISTRACTORS_APART = 0.45, 0.3
#: Distance from the expected place, [sides], within which a distractor may be taken for the
#: target; and within which it hides the target if only one maximum is left of both.
_NEAR, _MEETING = 0.75, 0.35
#: Interval [frames] at which growth and rotation are measured by optical flow, halfway between the
#: scale regression's frames; and number of frames in a row in which they are, after one with
#: growth or with a turn above the second value, [rad].
_MEASURED_EVERY, _TURNING = 4, 0.03
#: Distance from the expected place, [sides], above which the place found is checked by the motion
#: of the target's points; and distance from where they went above which it's replaced by that.
_FAR_FROM_EXPECTED = 0.4
#: Increase of the response, as a share of the usual one, that multiplies the likelihood by e.
_TEMPERATURE = 0.07
#: Gap [frames] above which, and number of first frames in which, maxima are also compared with the
#: initial template; number of maxima compared, the most probable ones.
_COMPARING_GAP, _COMPARING_FRAMES, _MOST_COMPARED = 8, 10, 6
#: Lower bound of the likeness, also used for the maxima that aren't compared; its exponent in the
#: likelihood.
_LIKENESS_FLOOR, _LIKENESS_POWER = 0.05, 3.0
#: Weight of the latest step in a velocity; factor of its decay per frame out of sight.
_VELOCITY_RATE, _FADING = 0.4, 0.9


class GuidedSearch:
    """
    Searches the target where it's expected.

    Several forecasts say where: that it stays, goes on with its velocity, moves with the camera,
    with the camera and a velocity of its own, and that of a tracker's own filter. The window is
    put at the one with the least mean error. Where the response is too low there, or after a gap,
    windows at the others and all around are searched too; where it's low, the camera may have been
    jerked, so its motion is measured again, over a longer range and beside the target. Of the
    maxima in all windows the one with the highest joint likelihood of response and place is
    chosen: a distractor may respond as well, but isn't where the target should be. After a gap,
    and in the first frames, place says little, so similarity to the initial template counts too.
    Distractors are followed, and maxima where one is expected aren't the target; while one passes
    in front, the target goes on as forecast. The optical flow of the target's own points is used
    as well: before the search the target is scaled and turned as they were, and if the place found
    is far from the expected one, but they went elsewhere together, the target is there.
    """

    _found: Found

    def __init__(self, frame: Frame, target: Hypotheses) -> None:
        self._target = target
        self._picture = SparsePicture.of(frame)
        #: Optical flow of the target's points from the last frame, if it was seen there; their
        #: motion since then, once it has been measured.
        self._flow: TargetFlow | None = self._seen_flow()
        self._motion: TargetMotion | None = None
        #: Number of frames so far; number of further ones in each of which points are measured.
        self._frames = self._changing = 0
        self._mixture = ForecastMixture()
        self._start = target.center
        self._forecasts: dict[str, Point] = {}
        self._shift: Point | None = None
        self._velocity: Point = (0.0, 0.0)
        #: The velocity relative to the camera's motion, [px/frame].
        self._own_velocity: Point = (0.0, 0.0)
        self._distractors = Distractors()
        self._evidence = MotionEvidence(self._picture, target.box)
        #: Time, [frames], for which the target has been hidden since a distractor came near.
        self._hidden = 0.0

    def search(self, frame: Frame, dt: float, own: Point | None = None) -> Found:
        """Return where the target is; `own` is the tracker's own forecast, in pixels."""
        target = self._target
        self._start, self._motion = target.center, None
        self._frames += 1
        if target.network is not None:
            # it follows none, so those that filters followed before would stay where they were
            self._distractors = Distractors()
        before, self._picture = self._picture, SparsePicture.of(frame)
        self._shift = before.camera_step(self._picture)
        self._transform(frame, dt)
        self._forecasts = self._forecast(dt, own)
        expected = inside(self._forecasts[self._mixture.best(self._forecasts)], frame)
        maps = [target.localise(frame, expected)]
        low = maps[0].peak < _LOW_RESPONSE * target.response_unit
        if low:
            box = Box.from_center(*self._start, *target.size)
            self._forecasts |= self._along(
                'ground', before.ground_step(self._picture, box, far=True), dt)
        if low or dt > _LONG_GAP:
            maps += self._wider(frame, expected)
        every = sorted(((place, response, value) for response in maps
                        for place, value in response.maxima(_DISTRACTING)),
                       key=lambda each: -each[2])[:_MAXIMA]
        found = self._identified(frame, maps[0], every, expected, dt)
        self._found = self._confirmed(frame, found, expected)
        if target.network is None:
            self._follow_distractors(frame, every, dt)
            box = Box.from_center(*self._found.place, *target.size)
            motion = self._evidence.update(self._picture, box, dt)
            self._found = replace(self._found, motion=motion)
        return self._found

    def follow(self, dt: float, elsewhere: bool) -> None:
        """Learn from where the target is now, unless that is `elsewhere`, or it isn't seen."""
        target = self._target
        if elsewhere:
            # what was followed there was the target itself
            self._distractors.forget(target.center, AT * self._side, 0.0)
        self._flow = None if elsewhere else self._seen_flow()
        if elsewhere or self._found.hidden or target.network is not None:
            self._evidence.restart()
        if elsewhere or not target.is_followed:
            (x, y), fading = self._velocity, _FADING**dt
            self._velocity, self._own_velocity = (fading * x, fading * y), (0.0, 0.0)
            return
        if self._found.hidden:
            return
        self._mixture.update(target.center, self._forecasts, self._side)
        center, start = target.center, self._start
        self._velocity = mean_velocity(self._velocity, start, center, dt, _VELOCITY_RATE)
        if self._shift is not None:
            step = center[0] - start[0], center[1] - start[1]
            self._own_velocity = mean_velocity(
                self._own_velocity, self._shift, step, dt, _VELOCITY_RATE)

    def _transform(self, frame: Frame, dt: float) -> None:
        """Scale and turn the target as its own points tell, if no distractor is near."""
        if not (self._changing or self._frames % _MEASURED_EVERY == _MEASURED_EVERY // 2):
            return
        if self._distractors.near(self._start, _NEAR * self._side, dt):
            return
        points = self._points(frame)
        self._changing = max(self._changing - 1, 0)
        if points is None:
            return
        growth, turn = points.growth or 1.0, points.turn or 0.0
        self._target.transform(growth, turn)
        if growth != 1 or abs(turn) > _TURNING:
            self._changing = _MEASURED_EVERY

    def _seen_flow(self) -> TargetFlow | None:
        """Return the optical flow of the target's points from here, if it's seen here."""
        target = self._target
        return None if target.network is not None or target.unseen_frames else target.flow

    def _points(self, frame: Frame) -> TargetMotion | None:
        """Return the motion of the target's points since the last frame, if it was seen."""
        if self._motion is None and self._flow is not None:
            self._motion = self._flow.motion(frame)
        return self._motion

    def _confirmed(self, frame: Frame, found: Found, expected: Point) -> Found:
        """Return where the target is: where it was found, or where its points went instead."""
        target, far = self._target, _FAR_FROM_EXPECTED * self._side
        if found.hidden or target.uncertain or math.dist(found.place, expected) <= far:
            return found
        points = self._points(frame)
        if points is None or points.step is None:
            return found
        went = inside(_moved(self._start, points.step), frame)
        if math.dist(found.place, went) <= far:
            return found
        response = target.localise(frame, went)
        place = response.local_maximum(went)
        return replace(found, response=response,
                       place=place if math.dist(place, went) <= far else went)

    @property
    def _side(self) -> float:
        return math.sqrt(math.prod(self._target.size))

    def _forecast(self, dt: float, own: Point | None) -> dict[str, Point]:
        """Return where the target is expected, by name of the forecast, in pixels."""
        forecasts = {STAYING: self._start, 'moving': _moved(self._start, self._velocity, dt)}
        forecasts |= self._along('camera', self._shift, dt)
        if own is not None:
            forecasts['own'] = own
        return forecasts

    def _along(self, name: str, step: Point | None, dt: float) -> dict[str, Point]:
        """Return forecasts by a step, [px], alone, and by the target's own velocity as well."""
        if step is None:
            return {}
        there = _moved(self._start, step)
        return {f'with {name}': there, f'beside {name}': _moved(there, self._own_velocity, dt)}

    def _wider(self, frame: Frame, expected: Point) -> list[ResponseMap]:
        """Return the responses in more windows: at the other forecasts, and eight around."""
        target, least = self._target, _WINDOWS_APART * self._side
        width, height = (size * reach / 2 for size, reach in zip(target.size, target.reach))
        halves, places = Grid(expected, (width, height), target.angle), [expected]

        def apart(place: Point) -> bool:
            return min(math.dist(place, other) for other in places) > least

        for place in self._forecasts.values():
            place = inside(place, frame)
            if apart(place):
                places.append(place)
        maps = [target.localise(frame, place) for place in places[1:target.more_windows + 1]]
        steps = [step for step in _AROUND if apart(inside(halves.at(step), frame))]
        steps = steps[:target.more_windows - len(maps)]
        return maps + target.localise_beside(frame, expected, steps)

    def _identified(self, frame: Frame, response: ResponseMap, every: list[Maximum],
                    expected: Point, dt: float) -> Found:
        """Return the target among maxima, or where it's expected while a distractor hides it."""
        side = self._side
        theirs = [] if dt > _LONG_GAP else self._distractors.near(expected, _NEAR * side, dt)
        if not theirs:
            self._hidden = 0.0
            return self._chosen(frame, [
                each for each in every if each[2] >= share_of(each[1].peak, _CANDIDATE)], dt)
        ours: list[Maximum] = []
        others: list[Maximum] = []
        for each in strong(every, _DISTRACTING):
            nearest = min(math.dist(each[0], place) for place in theirs)
            if math.dist(each[0], expected) <= nearest:
                ours.append(each)
            elif nearest < AT * side:
                others.append(each)
        meeting = min(math.dist(place, expected) for place in theirs) < _MEETING * side
        if not ours or (meeting and not others):
            self._hidden += dt
            if self._hidden <= HIDING:
                return Found(response, expected, tuple(theirs), hidden=True)
            self._distractors.forget(expected, _NEAR * side, dt)
        return replace(self._chosen(frame, strong(ours or every, _CANDIDATE), dt),
                       distractors=tuple(theirs))

    def _chosen(self, frame: Frame, every: list[Maximum], dt: float) -> Found:
        """Return the most probable of maxima, the highest of which is the first."""
        side = self._side
        found = distinct(every, _DISTINCT * side)
        if len(found) == 1:
            return Found(found[0][1], found[0][0])
        values = np.array([value for _, _, value in found])
        places = np.array([place for place, _, _ in found])
        scores = (values - values.max()) / (_TEMPERATURE * self._target.response_unit)
        scores += self._mixture.log_density(places, self._forecasts, side, dt)
        comparing = dt > _COMPARING_GAP or self._frames <= _COMPARING_FRAMES
        if comparing and self._target.network is None:
            likeness = np.full(len(found), _LIKENESS_FLOOR)
            for index in np.argsort(-scores)[:_MOST_COMPARED]:
                likeness[index] = max(_LIKENESS_FLOOR, self._target.likeness(frame, places[index]))
            scores += _LIKENESS_POWER * np.log(likeness)
        chosen = int(scores.argmax())
        place, response, _ = found[chosen]
        return Found(response, place, rival=found[0 if chosen else 1][0])

    def _follow_distractors(self, frame: Frame, every: list[Maximum], dt: float) -> None:
        """Follow the other maxima, which may be distractors, and compare one when due."""
        apart, target, place = _DISTRACTORS_APART * self._side, self._target, self._found.place
        others = [each[0] for each in distinct(strong(every, _DISTRACTING), apart)
                  if self._found.hidden or math.dist(each[0], place) > apart]
        self._distractors.update(others, place, self._side, dt, merged=self._found.hidden)
        if not target.unseen_frames:
            self._distractors.compare(place, self._side, partial(target.likeness, frame))


def _moved(place: Point, velocity: Point, dt: float = 1.0) -> Point:
    return place[0] + dt * velocity[0], place[1] + dt * velocity[1]
