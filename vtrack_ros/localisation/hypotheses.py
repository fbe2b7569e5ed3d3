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
from vtrack_ros.localisation.candidates import Found
from vtrack_ros.localisation.distractors import AT, HIDING
from vtrack_ros.localisation.localiser import Localiser
from vtrack_ros.localisation.presence import ALWAYS_GOOD, support_of
from vtrack_ros.localisation.response_map import ResponseMap
from vtrack_ros.localisation.running_means import latest_weight
from vtrack_ros.localisation.search_window import inside, Step
from vtrack_ros.localisation.siamese_localiser import SiameseLocaliser, SUPPORT
from vtrack_ros.tracker import Estimate

#: Weight of the latest frame in the running mean of a model's similarity.
_RATE = 1 / 7
#: The other model takes over when it's so much more similar to what it saw at first, beside what
#: anything has of it by chance; it starts again beside the leader when it's been so much less
#: similar for so many frames.
_TAKES_OVER, _BY_CHANCE, _GIVES_UP, _APART = 1.15, 0.05, 1.1, 6
#: While they agree and are sure, the other one is updated after so many frames' time, and one more
#: where the leader's size was just measured; in each of the first frames, where the target parts
#: from what was behind it.
_PAUSE, _FIRST = 6.5, 30
#: Boxes that overlap less than that are of different places; the models agree about the target
#: where they overlap by so much more: a size that drifts away isn't what to begin again with.
_TOGETHER, _ALIKE = 0.5, 0.75
#: The other model stays at its own maximum where that has this share of the highest response: less
#: is left of it where a double passes in front.
_LEVEL = 0.5
#: The least that a similarity is taken for.
_LEAST = 0.01


@dataclass(frozen=True)
class FirstFrame:
    """The part of the first frame that a target is learned from; its place there, in pixels."""

    frame: Frame
    center: Point
    size: Point

    @classmethod
    def of(cls, frame: Frame, center: Point, size: Point) -> FirstFrame:
        """Copy as much of a frame as is looked at."""
        half = SEARCHED / EXEMPLAR * exemplar_side(size) / 2 + 2
        left, top = (max(0, int(place - half)) for place in center)
        right, bottom = (int(place + half) + 1 for place in center)
        return cls(frame[top:bottom, left:right].copy(), (center[0] - left, center[1] - top), size)


class Hypotheses:
    """
    Localises a target with two models, and believes the one that is more like its first frame.

    A filter that's learned with the surroundings tells the target from them best, but where the
    camera follows the target it learns the ground behind it. A filter that sees the target alone
    can't, but is easily led astray by whatever resembles it. No single one is right everywhere,
    so both are hypotheses, each with its own place, and the decision is one over time: by the
    running means of how similar each one's place is to its own initial template. Whoever is wrong
    for long starts again at the leader's place, with what it knew when they last agreed.

    A network, where one is given, is the only hypothesis: it doesn't learn what's wrong. It's
    asked, and told, like a `Localiser`; the leader answers.
    """

    def __init__(self, frame: Frame, center: Point, size: Point, rng: np.random.Generator,
                 network: SiameseNetwork | None = None) -> None:
        self._first = FirstFrame.of(frame, center, size)
        self._rng = rng
        self._begin(frame, center, size, network)

    def use(self, network: SiameseNetwork | None) -> None:
        """Localise the same target, where it is, by a network, or None: by correlation filters."""
        before, first = self._leader, self._first
        self._begin(first.frame, first.center, first.size, network)
        for each in self._similarities:
            if before.uncertain:
                # what's usual can't be learned from the next frame: the target may not be in it
                each.update(first.frame, each.localise(first.frame, first.center), first.center, 1)
            each.resume(each.snapshot, before)
            if network is None:
                # a network's box may have another aspect: as large a target is meant
                each.transform(math.sqrt(math.prod(before.size) / math.prod(each.size)), 0.0)
        self._latest = before.center

    def _begin(self, frame: Frame, center: Point, size: Point,
               network: SiameseNetwork | None) -> None:
        """Learn the target from its first frame."""
        self.network = network
        """What localises the target, if it isn't correlation filters."""
        if network is None:
            self._leader = Localiser(frame, center, size, self._rng)
            self._other = Localiser(frame, center, size, self._rng, confined=True)
        else:
            self._leader = self._other = SiameseLocaliser(frame, center, size, self._rng, network)
        self._similarities = {self._leader: 1.0, self._other: 1.0}
        self._agreed = {each: each.snapshot for each in self._similarities}
        self._frames = self._apart = 0
        #: The leader's place, and the time since, when the other one was updated last.
        self._latest, self._waiting = center, 0.0
        #: By which factor the size that both agree on is larger than the leader's.
        self._growth = 1.0

    @property
    def more_windows(self) -> int:
        """Return how many windows may be searched in a frame beside the first one."""
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
        """Return by how much the target has turned since the first frame, in radians."""
        return self._leader.angle

    @property
    def box(self) -> Box:
        """Return the target's bound; while both models agree, of the size between theirs."""
        return Box.around_ellipse(self.center, self._shown_size, self.angle)

    @property
    def reach(self) -> Point:
        """Return the search window's (width, height) in units of the target's."""
        return self._leader.reach

    @property
    def usual_response(self) -> float:
        """Return the running mean of the highest response, which is positive."""
        return self._leader.usual_response

    @property
    def uncertain(self) -> bool:
        """Tell whether tracking has failed, so that the target is searched elsewhere too."""
        return self._leader.uncertain

    @property
    def is_followed(self) -> bool:
        """
        Tell whether forecasts may learn from where the target is: whether it's seen there.

        What a network sees while it's searched elsewhere may be something else.
        """
        return not (self.unseen_frames or (self.network is not None and self.uncertain))

    @property
    def unseen_frames(self) -> float:
        """Return for how many frames the target hasn't been seen; 0 if it was in the last one."""
        return self._leader.unseen_frames

    @property
    def flow(self) -> TargetFlow:
        """Return what tells where the target's points go; see `Localiser.flow`."""
        return self._leader.flow

    def localise(self, frame: Frame, center: Point, angle: float | None = None) -> ResponseMap:
        """Return the response about a place, in pixels; see `Localiser.localise`."""
        return self._leader.localise(frame, center, angle)

    def localise_beside(self, frame: Frame, center: Point,
                        steps: Sequence[Step]) -> list[ResponseMap]:
        """Return the responses in windows beside that one; see `WindowLayout.windows_beside`."""
        return self._leader.snapshot.localise_beside(frame, center, steps)

    def likeness(self, frame: Frame, place: Point) -> float:
        """Return how similar a place, in pixels, is to the target; see `Localiser.likeness`."""
        return self._leader.likeness(frame, place)

    def update(self, frame: Frame, found: Found, dt: float) -> bool:
        """
        Take the place that a tracker decided for; see `Localiser.update`.

        While the target is hidden by a distractor the other model isn't asked: it would follow it.
        If it has followed one of those near the target, it starts again beside the leader: it goes
        by the look alone, and motion told which one is the target. Nor does re-detection, which
        goes by it too, jump to one. But who hasn't been seen for long may be one of them.

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
                                  self._other: self._leader.similarity / _GIVES_UP}
            self._agreed = {each: each.snapshot for each in self._similarities}
            self._apart, self._latest = 0, self._leader.center
            self._growth = 1.0
        self._frames += 1
        self._waiting += dt
        # no frame should take much longer than the others: the two measure sizes in turns
        if found.hidden or (self._waiting < _PAUSE + self._leader.resized
                            and not self._questionable()):
            return elsewhere
        self._update_other(frame)
        rate = latest_weight(_RATE, 1, self._frames)
        for each, mean in self._similarities.items():
            self._similarities[each] += rate * (max(each.similarity, _LEAST) - mean)
        return self._decide(distractors) or elsewhere

    def require(self, confidence: float) -> None:
        """Say that the target is there from this confidence on."""
        for each in self._similarities:
            each.require(confidence)

    def transform(self, growth: float, turn: float) -> None:
        """Take the target for larger by a factor, and turned by an angle more, in radians."""
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
        """Tell whether the two disagree, or the leader isn't like itself, or they're new."""
        return (self._frames <= _FIRST or self._apart > 0
                or self._leader.similarity < ALWAYS_GOOD)

    def _update_other(self, frame: Frame) -> None:
        """Let the other model follow its own maximum; about the leader's place, if it's near."""
        other, leader = self._other, self._leader
        center, before, dt = other.center, self._latest, self._waiting
        self._latest, self._waiting = leader.center, 0.0
        if math.dist(center, before) < math.sqrt(math.prod(other.size)):
            center = inside((center[0] + leader.center[0] - before[0],
                             center[1] + leader.center[1] - before[1]), frame)
        response = other.localise(frame, center, leader.angle)
        place = response.local_maximum(center)
        if response.sample_one(place) < _LEVEL * response.peak:
            place = response.center
        # the leader is what it's found by: two that search each by itself err twice as often
        other.update(frame, response, place, dt, search=False)

    def _decide(self, distractors: Sequence[Point]) -> bool:
        """Tell whether the other model takes over; or let it start again at the leader's place."""
        leader, other = self._leader, self._other
        overlap = leader.box.iou(other.box)
        self._growth = 1.0
        if overlap >= _TOGETHER:
            self._apart = 0
            self._growth = math.sqrt(other.size[0] / leader.size[0])
            if overlap >= _ALIKE:
                self._agreed = {each: each.snapshot for each in self._similarities}
            return False
        if self._follows(distractors):
            self._start_again()
            return False
        self._apart += 1
        believed, rival = self._similarities[leader], self._similarities[other]
        if rival + _BY_CHANCE > _TAKES_OVER * (believed + _BY_CHANCE):
            self._leader, self._other = other, leader
            self._apart = 0
            return True
        if self._apart >= _APART and rival * _GIVES_UP < believed:
            self._start_again()
        return False

    def _follows(self, distractors: Sequence[Point]) -> bool:
        """Tell whether the other model is at a distractor, and farther from the leader."""
        place, near = self._other.center, AT * math.sqrt(math.prod(self.size))
        nearest = min((math.dist(place, each) for each in distractors), default=math.inf)
        return nearest < min(near, math.dist(place, self.center))

    def _start_again(self) -> None:
        """Let the other model start again beside the leader, with what it knew in agreement."""
        leader, other = self._leader, self._other
        other.resume(self._agreed[other], leader)
        self._similarities[other] = self._similarities[leader] / _GIVES_UP
        self._apart = 0
