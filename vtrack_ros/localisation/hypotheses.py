"""Two models of one target, side by side, and which of them is believed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from vtrack_ros.appearance.image_motion import TargetFlow
from vtrack_ros.appearance.siamese_network import (
    EXEMPLAR, exemplar_side, SEARCHED, SiameseNetwork)
from vtrack_ros.frame import Array, Frame, Point
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.distractors import AT, HIDING
from vtrack_ros.localisation.localiser import Localiser
from vtrack_ros.localisation.presence import ALWAYS_GOOD, support_of
from vtrack_ros.localisation.response_map import Found, ResponseMap
from vtrack_ros.localisation.running_means import latest_weight
from vtrack_ros.localisation.search_window import inside, Step
from vtrack_ros.localisation.siamese_localiser import SiameseLocaliser, SUPPORT
from vtrack_ros.tracker import Estimate

#: Weight of the latest comparison in the moving average of each model's similarity.
_RATE = 1 / 7
#: Ratio of mean similarities (the other model's to the leader's) above which the other model takes
#: over; similarity that anything has by chance, added to both before; ratio (the leader's to the
#: other's) above which the other restarts beside the leader; least number of frames apart for it.
_TAKEOVER_RATIO, _BY_CHANCE, _RESTART_RATIO, _APART_FRAMES = 1.15, 0.05, 1.1, 6
#: Interval [frames] of the other model's updates while both agree and are sure (one more where the
#: leader's size was just measured); number of first frames in each of which it's updated, because
#: the target separates from its first background then.
_PAUSE, _FIRST = 6.5, 30
#: Overlap (IoU) of the boxes below which the models are at different places; overlap from which
#: they agree, so that snapshots are kept for a restart: not one whose size has drifted.
_SAME_PLACE, _AGREEMENT = 0.5, 0.75
#: Share of the highest response from which the other model stays at its own local maximum; low, as
#: a double that passes in front lowers that maximum.
_LOCAL_PEAK_SHARE = 0.5
#: Lower bound of the similarities that are averaged.
_LEAST_SIMILARITY = 0.01


@dataclass(frozen=True)
class FirstFrame:
    """The part of the first frame that a target is learned from; its place there, in pixels."""

    frame: Frame
    center: Point
    size: Point

    @classmethod
    def of(cls, frame: Frame, center: Point, size: Point) -> FirstFrame:
        """Copy the part of a frame that the models look at."""
        half = SEARCHED / EXEMPLAR * exemplar_side(size) / 2 + 2
        left, top = (max(0, int(place - half)) for place in center)
        right, bottom = (int(place + half) + 1 for place in center)
        return cls(frame[top:bottom, left:right].copy(), (center[0] - left, center[1] - top), size)


class Hypotheses:
    """
    Localises a target with two models; the one that is more similar to its first frame leads.

    A filter that's learned with the surroundings tells the target from them best, but where the
    camera follows the target it learns the ground behind it. A filter that sees the target alone
    can't, but is easily distracted by whatever resembles it. Neither is right everywhere, so both
    are hypotheses, each with its own place. The decision between them is one over time: by the
    moving averages of the similarity of each one's place to its own initial template. The one
    that's wrong for long restarts at the leader's place, as it was when they last agreed.

    A network, where one is given, is the only hypothesis: it doesn't learn what's wrong. The
    interface is that of a `Localiser`; the leader's answers are returned.
    """

    def __init__(self, frame: Frame, center: Point, size: Point, rng: np.random.Generator,
                 network: SiameseNetwork | None = None) -> None:
        self._first = FirstFrame.of(frame, center, size)
        self._rng = rng
        self._begin(frame, center, size, network)

    def use(self, network: SiameseNetwork | None) -> None:
        """Continue with the same target by a network, or, with None, by correlation filters."""
        before, first = self._leader, self._first
        self._begin(first.frame, first.center, first.size, network)
        for each in self._similarities:
            if before.uncertain:
                # usual values can't be learned from the next frame: the target may not be in it
                each.update(first.frame, each.localise(first.frame, first.center), first.center, 1)
            each.resume(each.snapshot, before)
            if network is None:
                # a network's box may have another aspect: keep the area
                each.transform(math.sqrt(math.prod(before.size) / math.prod(each.size)), 0.0)
        self._latest = before.center

    def _begin(self, frame: Frame, center: Point, size: Point,
               network: SiameseNetwork | None) -> None:
        """Learn the target from its first frame."""
        self.network = network
        """The network that localises the target; None: correlation filters do."""
        if network is None:
            self._leader = Localiser(frame, center, size, self._rng)
            self._other = Localiser(frame, center, size, self._rng, confined=True)
        else:
            self._leader = self._other = SiameseLocaliser(frame, center, size, self._rng, network)
        self._similarities = {self._leader: 1.0, self._other: 1.0}
        self._agreed = {each: each.snapshot for each in self._similarities}
        self._frames = self._apart = 0
        #: The leader's place at the last update of the other model; time since then, [frames].
        self._latest, self._waiting = center, 0.0
        #: Ratio of the size that both agree on, their geometric mean, to the leader's.
        self._growth = 1.0

    @property
    def more_windows(self) -> int:
        """Return how many windows may be searched in a frame besides the first one."""
        return self._leader.MORE_WINDOWS

    @property
    def center(self) -> Point:
        """Return the target's centre, in pixels."""
        return self._leader.center

    @property
    def size(self) -> Point:
        """Return the target's (width, height), in pixels."""
        return self._leader.size

    @property
    def angle(self) -> float:
        """Return the target's rotation since the first frame, in radians."""
        return self._leader.angle

    @property
    def box(self) -> Box:
        """Return the target's bounding box; while both models agree, of their mean size."""
        return Box.around_ellipse(self.center, self._shown_size, self.angle)

    @property
    def reach(self) -> Point:
        """Return the search window's (width, height) in units of the target's."""
        return self._leader.reach

    @property
    def response_unit(self) -> float:
        """Return the running mean of the highest response, with a positive lower bound."""
        return self._leader.response_unit

    @property
    def uncertain(self) -> bool:
        """Tell whether tracking has failed, so that the target is searched elsewhere too."""
        return self._leader.uncertain

    @property
    def is_followed(self) -> bool:
        """
        Tell whether the target is seen at its place, so that forecasts may learn from it.

        What a network sees during a tracking failure may be something else: that doesn't count.
        """
        return not (self.unseen_frames or (self.network is not None and self.uncertain))

    @property
    def unseen_frames(self) -> float:
        """Return the time, [frames], since the target was last seen; 0: in the last frame."""
        return self._leader.unseen_frames

    @property
    def flow(self) -> TargetFlow:
        """Return the optical flow of the target's points; see `Localiser.flow`."""
        return self._leader.flow

    def localise(self, frame: Frame, center: Point, angle: float | None = None) -> ResponseMap:
        """Return the response about a place, in pixels; see `Localiser.localise`."""
        return self._leader.localise(frame, center, angle)

    def localise_beside(self, frame: Frame, center: Point,
                        steps: Sequence[Step]) -> list[ResponseMap]:
        """Return the responses in neighbouring windows; see `WindowLayout.windows_beside`."""
        return self._leader.snapshot.localise_beside(frame, center, steps)

    def likeness(self, frame: Frame, place: Point) -> float:
        """Return a place's relative similarity, in pixels; see `Localiser.likeness`."""
        return self._leader.likeness(frame, place)

    def update(self, frame: Frame, found: Found, dt: float) -> bool:
        """
        Update the models with the place that a tracker has chosen; see `Localiser.update`.

        While a distractor hides the target, the other model isn't updated: it would follow that.
        If it has followed one near the target, it restarts beside the leader: it uses appearance
        only, and motion tells which one is the target. Re-detection, also by appearance, doesn't
        jump to one either. But a target unseen for longer than `HIDING` may be one of them.

        Returns whether the target is elsewhere: found again, or where the other model has it.
        """
        distractors = found.distractors if self.unseen_frames <= HIDING else ()
        support = SUPPORT if self.network else support_of(self._other.similarity)
        elsewhere = self._leader.update(
            frame, found.response, found.place, dt, support=found.motion + support,
            distractors=distractors, rival=found.rival)
        if self.network is not None:
            return elsewhere
        if self._leader.restarted:
            self._other.restart_beside(self._leader)
            self._similarities = {self._leader: self._leader.similarity,
                                  self._other: self._leader.similarity / _RESTART_RATIO}
            self._agreed = {each: each.snapshot for each in self._similarities}
            self._apart, self._latest = 0, self._leader.center
            self._growth = 1.0
        self._frames += 1
        self._waiting += dt
        # to balance the load over frames, the two measure sizes in different ones
        if found.hidden or (self._waiting < _PAUSE + self._leader.resized
                            and not self._questionable()):
            return elsewhere
        self._update_other(frame)
        rate = latest_weight(_RATE, 1, self._frames)
        for each, mean in self._similarities.items():
            self._similarities[each] += rate * (max(each.similarity, _LEAST_SIMILARITY) - mean)
        return self._decide(distractors) or elsewhere

    def require(self, confidence: float) -> None:
        """Set the least confidence at which the target is reported as present."""
        for each in self._similarities:
            each.require(confidence)

    def transform(self, growth: float, turn: float) -> None:
        """Scale the target by a factor, and turn it by a further angle, in radians."""
        for each in self._similarities:
            each.transform(growth, turn)

    def estimate(self, covariance: Array, particles: Array | None = None) -> Estimate:
        """Return the leader's estimate, with this box; see `Localiser.estimate`."""
        return self._leader.estimate(covariance, particles, self._shown_size)

    @property
    def _shown_size(self) -> Point:
        width, height = self.size
        return self._growth * width, self._growth * height

    def _questionable(self) -> bool:
        """Tell whether the two disagree, or the leader's similarity is low, or they're new."""
        return self._frames <= _FIRST or self._apart > 0 or self._leader.similarity < ALWAYS_GOOD

    def _update_other(self, frame: Frame) -> None:
        """Update the other model at its own maximum; its window moves with a leader nearby."""
        other, leader = self._other, self._leader
        center, before, dt = other.center, self._latest, self._waiting
        self._latest, self._waiting = leader.center, 0.0
        if math.dist(center, before) < math.sqrt(math.prod(other.size)):
            center = inside((center[0] + leader.center[0] - before[0],
                             center[1] + leader.center[1] - before[1]), frame)
        response = other.localise(frame, center, leader.angle)
        place = response.local_maximum(center)
        if response.sample_one(place) < _LOCAL_PEAK_SHARE * response.peak:
            place = response.center
        # only the leader searches elsewhere: two independent searches err twice as often
        other.update(frame, response, place, dt, leads=False)

    def _decide(self, distractors: Sequence[Point]) -> bool:
        """Tell whether the other model takes over; it may be restarted beside the leader."""
        leader, other = self._leader, self._other
        overlap = leader.box.iou(other.box)
        self._growth = 1.0
        if overlap >= _SAME_PLACE:
            self._apart = 0
            self._growth = math.sqrt(other.size[0] / leader.size[0])
            if overlap >= _AGREEMENT:
                self._agreed = {each: each.snapshot for each in self._similarities}
            return False
        if self._follows_distractor(distractors):
            self._restart_other()
            return False
        self._apart += 1
        believed, rival = self._similarities[leader], self._similarities[other]
        if rival + _BY_CHANCE > _TAKEOVER_RATIO * (believed + _BY_CHANCE):
            self._leader, self._other = other, leader
            self._apart = 0
            return True
        if self._apart >= _APART_FRAMES and rival * _RESTART_RATIO < believed:
            self._restart_other()
        return False

    def _follows_distractor(self, distractors: Sequence[Point]) -> bool:
        """Tell whether the other model is at a distractor, nearer to it than to the leader."""
        place, near = self._other.center, AT * math.sqrt(math.prod(self.size))
        nearest = min((math.dist(place, each) for each in distractors), default=math.inf)
        return nearest < min(near, math.dist(place, self.center))

    def _restart_other(self) -> None:
        """Restart the other model beside the leader, from its snapshot when they last agreed."""
        leader, other = self._leader, self._other
        other.resume(self._agreed[other], leader)
        self._similarities[other] = self._similarities[leader] / _RESTART_RATIO
        self._apart = 0
