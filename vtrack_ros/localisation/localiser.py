"""Localises one target frame by frame; each tracker of this package holds a localiser."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
import math
from typing import ClassVar

import numpy as np

from vtrack_ros.appearance.image_motion import TargetFlow
from vtrack_ros.estimation import at_least
from vtrack_ros.frame import Array, Frame, Point
from vtrack_ros.geometry import Box
from vtrack_ros.geometry.affine import transformation
from vtrack_ros.localisation.global_search import GlobalSearch
from vtrack_ros.localisation.presence import (
    ALWAYS_GOOD, has_failed, InitialTemplate, PresenceDetector, state_after)
from vtrack_ros.localisation.redetection import Redetection
from vtrack_ros.localisation.response_map import ResponseMap
from vtrack_ros.localisation.running_means import ExampleTime, mean_velocity
from vtrack_ros.localisation.search_window import COARSE, FINE, inside, SearchWindow, WindowLayout
from vtrack_ros.localisation.target_model import is_centred, TargetModel, TargetSnapshot
from vtrack_ros.tracker import Estimate

#: Interval [frames] at which the scale is measured and learned, for it changes slowly; change of
#: scale, |log(growth)|, above which the next frame is measured too; interval of the colours.
_SCALE_EVERY, _GROWING, _COLOURS_EVERY = 4, 0.04, 2
#: Interval [frames] of comparisons with the initial template, in between those of the scale; share
#: of the usual response below which it's done in any frame (or if `_verify` finds other doubts).
_VERIFIED_EVERY, _QUESTIONABLE_RESPONSE = 2, 0.85
#: Bounds of the size, as factors of the first size: a target that comes near may be tiny at first.
SMALLEST, LARGEST = 0.05, 20.0
#: Lower bounds of the usual values after the first update: response, as a share of the peak in the
#: first frame, and similarity. Where a target has jumped away by then, both are far less.
_FIRST_RESPONSE, _FIRST_SIMILARITY = 0.45, 0.2
#: Interval [frames] at which a rotated target is also compared at other angles; weight of the
#: latest step in the mean velocity; lower bound of the usual similarity where others are divided.
_TURNED_EVERY, _VELOCITY_RATE, _LEAST_USUAL = 4, 0.3, 0.1


class Localiser:
    """
    Localises a target in each frame, updates its model, and notices when tracking has failed.

    It's made on the first frame, with the target's centre and size in pixels. The generator draws
    the places that re-detection searches. If it's `confined`, its filter's support is the target's
    box, without the surroundings, in a finer window.
    """

    #: Largest number of windows searched in a frame besides the first one.
    MORE_WINDOWS: ClassVar[int] = 12
    #: Lower bounds of the standard deviations of centre and size, as shares of the mean side.
    LEAST_ERRORS: ClassVar[tuple[float, float]] = (0.06, 0.08)
    #: Class of the target model; a subclass may name one with cues of its own.
    MODEL: ClassVar[type[TargetModel]] = TargetModel

    def __init__(self, frame: Frame, center: Point, size: Point, rng: np.random.Generator,
                 confined: bool = False) -> None:
        layout = WindowLayout.around(*size, FINE if confined else COARSE)
        window = layout.window(frame, center, size)
        shift, growth = window.shift(center), math.sqrt(math.prod(size) / math.prod(window.size))
        model = self.MODEL.create(window, confined, shift, growth)
        self._template = InitialTemplate.of(model, window, shift)
        self._first_model, self._first_size, self._window = model, size, window
        own = ResponseMap(window, model.response(window)).peak
        self._least_usual = _FIRST_RESPONSE * own, _FIRST_SIMILARITY
        self._live = TargetSnapshot(model, center, size, 1.0, 1.0)
        self._rng, self._growing, self._similarity = rng, False, 1.0
        self._presence, self._time = PresenceDetector(), ExampleTime()
        self.resized = False
        """Whether the size was measured in the last update."""
        #: Moving average, [px/frame]; constant during a tracking failure.
        self._velocity: Point = (0.0, 0.0)
        self._failure: Redetection | None = None
        self._global = GlobalSearch(model, self._template, size, rng)
        self.restarted = False
        """Whether the last update restarted elsewhere, with the model of the first frame."""

    @property
    def center(self) -> Point:
        """Return the target's centre, in pixels."""
        return self._live.center

    @property
    def size(self) -> Point:
        """Return the target's (width, height), in pixels."""
        return self._live.size

    @property
    def angle(self) -> float:
        """Return the target's rotation since the first frame, in radians."""
        return self._live.angle

    @property
    def box(self) -> Box:
        """Return the target's bounding box."""
        return Box.around_ellipse(self.center, self.size, self.angle)

    @property
    def reach(self) -> Point:
        """Return the search window's (width, height) in units of the target's."""
        return self._live.model.layout.reach

    @property
    def response_unit(self) -> float:
        """Return the running mean of the highest response, with a positive lower bound."""
        return self._live.response_unit

    @property
    def uncertain(self) -> bool:
        """Tell whether tracking has failed, so that the target is searched elsewhere too."""
        return self._failure is not None

    @property
    def unseen_frames(self) -> float:
        """Return the time, [frames], since the target was last seen; 0: in the last frame."""
        return self._presence.unseen_frames

    @property
    def similarity(self) -> float:
        """Return the similarity to the initial template at the last comparison."""
        return self._similarity

    @property
    def snapshot(self) -> TargetSnapshot:
        """Return what is known of the target now."""
        return self._live

    @property
    def flow(self) -> TargetFlow:
        """Return the optical flow of the target's points, from the window of the last update."""
        return TargetFlow(self._window.grey, self._window.pixels, self.center, self.size)

    def localise(self, frame: Frame, center: Point, angle: float | None = None) -> ResponseMap:
        """Return the response about a place, [px], in a window turned as now or by `angle`."""
        return self._live.localise(frame, center, angle)

    def likeness(self, frame: Frame, place: Point) -> float:
        """Return a place's similarity to the initial template, as a share of the usual one."""
        similarity = self._template.similarity(self._live.window(frame, inside(place, frame)))
        return similarity / max(self._live.usual_similarity, _LEAST_USUAL)

    def update(self, frame: Frame, response: ResponseMap, center: Point, dt: float,
               leads: bool = True, support: float = 0.0,
               distractors: Sequence[Point] = (), rival: Point | None = None) -> bool:
        """
        Update the model at the place that a tracker has chosen, and judge presence there.

        If it `leads`, it learns by the time, and other places are searched after a failure: the
        `rival` among them, the `distractors` excluded, [px]. `support`, from motion or another
        model, is added to the log-odds of presence.

        Returns whether it was found again elsewhere. Else its centre is the given one, or, if that
        is off the middle of the window, the maximum near it in another window about it.
        """
        before = self._live
        self._time.advance(dt, by_one=not leads)
        self._live = self._updated(frame, response, inside(center, frame), dt)
        elsewhere, afresh, sharpness, lost = False, False, response.sharpness, None
        if self._failure is None:
            self._judge(before, response, dt)
        else:
            lost = self._failure.lost
            verdict = self._failure.update(
                frame, self._live, self._similarity, response.peak, dt, leads,
                self._presence.appearance_odds, distractors, rival)
            self._live, self._similarity = verdict.live, verdict.similarity
            if verdict.elsewhere:
                elsewhere, sharpness, afresh = True, verdict.sharpness, not verdict.tentative
            if verdict.over:
                self._failure = None
                self._global.restart(self._similarity, before.usual_similarity, lost)
        self.restarted = False
        if leads and (self.uncertain or not elsewhere):
            sighting = self._global.update(
                frame, self._live, self._similarity, self.uncertain, dt, distractors)
            if sighting is not None:
                self._restart(sighting.center, sighting.size, sighting.similarity)
                self._global.restart(sighting.similarity, before.usual_similarity, lost)
                self.restarted = elsewhere = afresh = True
                sharpness = sighting.sharpness
        first = None
        if self._presence.doubts and not afresh:
            window = self._live.window(frame, self.center) if elsewhere else self._window
            first = ResponseMap(window, self._first_model.response(window)).sharpness
        self._presence.judge(self._similarity, sharpness, dt, afresh, support, first)
        return elsewhere

    def require(self, confidence: float) -> None:
        """Set the least confidence at which the target is reported as present."""
        self._presence.threshold = confidence

    def transform(self, growth: float, turn: float) -> None:
        """Scale the target by a factor, and turn it by a further angle, in radians."""
        width, height = self._live.size
        self._live = replace(self._live, size=self._bounded((growth * width, growth * height)),
                             turn=math.remainder(self._live.turn + turn, math.tau))

    def resume(self, snapshot: TargetSnapshot, beside: 'Localiser') -> None:
        """Continue from a snapshot, at another one's place, and with its search and presence."""
        self._live = replace(snapshot, center=beside.center, size=self._bounded(beside.size),
                             turn=beside.angle)
        self._failure = beside._failure and beside._failure.continued(self._live, self._template)
        self._velocity = beside._velocity
        self._presence = copy(beside._presence)

    def restart_beside(self, leader: 'Localiser') -> None:
        """Restart with the model of the first frame, at the place of another localiser."""
        self._restart(leader.center, leader.size, leader.similarity)
        self._global.restart(leader.similarity)
        self.resume(self._live, leader)

    def estimate(self, covariance: Array, particles: Array | None = None,
                 size: Point | None = None) -> Estimate:
        """
        Return the estimate; the size is the target's own where none is given.

        In no direction is its variance below that of `PresenceDetector.least_covariance`.
        """
        center, angle, size = self.center, self.angle, size or self.size
        box = Box.around_ellipse(center, size, angle)
        least = self._presence.least_covariance(box.area, *self.LEAST_ERRORS)
        return Estimate(
            box=box, angle=angle, covariance=at_least(covariance, least.diagonal()),
            confidence=self._presence.confidence, state=state_after(self._presence.absent_frames),
            particles=particles, affine=transformation(center, size, angle) if angle else None)

    def _restart(self, center: Point, size: Point, similarity: float) -> None:
        """Restart with the first frame's model, at a place with that similarity to it."""
        self._live = replace(self._live, model=self._first_model, center=center, size=size,
                             usual_similarity=similarity, turn=0.0)
        self._similarity, self._failure, self._velocity = similarity, None, (0.0, 0.0)

    def _updated(self, frame: Frame, response: ResponseMap, center: Point,
                 dt: float) -> TargetSnapshot:
        """Return the target updated at a place; compare it with the template if that's due."""
        live, window = self._live, response.window
        model, size = live.model, live.size
        if not (isinstance(window, SearchWindow) and is_centred(window.shift(center))):
            # the taper distorts what is near the border, and some of the target may be beyond it
            window = model.layout.window(frame, center, size, window.angle)
            response = ResponseMap(window, model.response(window))
            center = inside(response.local_maximum(center), frame)
        shift = window.shift(center)
        self._window = window
        self.resized = self._time.is_due(_SCALE_EVERY) or self._growing
        if self.resized:
            growth = model.growth(window, shift)
            self._growing = abs(math.log(growth)) > _GROWING
            size = self._bounded((window.size[0] * growth, window.size[1] * growth))
            model = model.with_scale(
                window, shift, growth, self._time.count(_SCALE_EVERY), self._first_model)
        if self._time.is_due(_COLOURS_EVERY, 1):
            model = model.with_colours(window, shift, self._time.count(_COLOURS_EVERY))
        self._verify(window, center, response)
        turn = live.turn if window.angle == live.angle else window.angle
        if window.angle and self._time.is_due(_TURNED_EVERY):
            turn = self._template.angle(frame, window, center, self._similarity)
        model = model.updated(window, shift, self._time.step, self._first_model)
        return replace(live, model=model, center=center, size=size, turn=turn)

    def _verify(self, window: SearchWindow, center: Point, response: ResponseMap) -> None:
        """Compare a place, in pixels, with the initial template, if that's due."""
        live = self._live
        questionable = (self.uncertain or self._similarity < ALWAYS_GOOD
                        or response.peak < _QUESTIONABLE_RESPONSE * live.usual_response)
        if self._time.is_due(_VERIFIED_EVERY, 1) or questionable:
            self._similarity = live.model.credibility(
                self._template.similarity(window, window.shift(center)), response, center)

    def _bounded(self, size: Point) -> Point:
        """Clamp a size, in the first one's aspect; to near the last one while out of sight."""
        width, height = self._first_size
        factor = min(max(size[0] / width, SMALLEST), LARGEST)
        if self._failure is not None and self._presence.unseen_frames:
            least, largest = self._failure.bounds(width)
            factor = min(max(factor, least), largest)
        return factor * width, factor * height

    def _judge(self, before: TargetSnapshot, response: ResponseMap, dt: float) -> None:
        """
        Update the usual values, or, if tracking has failed, start re-detection with a snapshot.

        A target that's surely present only looks different; a model that doesn't learn can't tell.
        """
        peak = response.peak
        if self._time.is_first:
            least, least_similar = self._least_usual
            self._live = before = replace(
                self._live, usual_response=max(peak, least),
                usual_similarity=max(self._similarity, least_similar))
        sure = before.model.LEARNS and self._presence.is_sure(self._similarity, response.sharpness)
        if has_failed(before, self._similarity, peak) and not sure:
            self._failure = Redetection(before, self._template, self._velocity, dt, self._rng)
        else:
            self._live = self._live.followed(peak, self._similarity)
            self._velocity = mean_velocity(
                self._velocity, before.center, self.center, dt, _VELOCITY_RATE)
