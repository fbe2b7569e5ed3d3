"""Re-detection: how a target is searched and found again after a tracking failure."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
import math

import numpy as np

from vtrack_ros.appearance.colour_model import box_mean, colour_index
from vtrack_ros.appearance.sampling import sparse_part
from vtrack_ros.frame import Frame, Point
from vtrack_ros.localisation.candidates import distinct
from vtrack_ros.localisation.distractors import is_distractor
from vtrack_ros.localisation.presence import (
    absent_error, EVEN_SIMILARITY, evidence, InitialTemplate)
from vtrack_ros.localisation.response_map import ResponseMap
from vtrack_ros.localisation.search_window import inside
from vtrack_ros.localisation.target_model import TargetSnapshot

#: Similarity that ends the failure, or justifies a jump from a target that is seen: the lower of a
#: share and a level, but never one that speaks against the target.
_TRUSTED_SHARE, _TRUSTED = 0.6, 0.13
#: Similarity that leaves the present place plausible, likewise.
_PLAUSIBLE_SHARE, _PLAUSIBLE = 0.35, 0.09
#: Frames of trusted similarity that end the failure.
_TRUSTED_FRAMES = 5
#: Updates after which a target that looks different, but is seen well, is taken for changed.
_ACCEPTED_UPDATES, _ACCEPTED, _ACCEPTED_RESPONSE = 40, 0.12, 0.8
#: A jump needs this much more similarity, and that often while the present place is plausible.
_JUMP_GAIN_SHARE, _JUMP_GAIN = 0.1, 0.05
_JUMP_FRAMES = 3
#: The least logarithm of the odds for the target at a place that is worth a jump. They rise with a
#: power of the response there, even at that share of the usual one, and of the frames searched,
#: even at so many and no more from so many on: who has just been hidden is rarely back at once,
#: but who has been gone for long isn't any the likelier to come back.
_ODDS = 1.3
_RESPONSE_POWER, _EVEN_RESPONSE = 4.0, 0.65
_FRAMES_POWER, _EVEN_FRAMES, _MOST_FRAMES = 0.5, 12, 25
#: Windows searched in a frame; after so many frames by colours, too.
_SEARCHES, _COLOURED = 3, 8
#: Of colours so many pixels are looked at across a target, or fewer where those of the whole frame
#: would be more than that; if they are still more, those of a part of it.
_COLOUR_PIXELS, _MOST_COLOURS = (6, 3), 1 << 14
#: So many maxima are looked at again, each in the middle of a window: of those of this share of
#: the usual response the most probable ones, where that share more is a factor of e in the odds,
#: and further apart than that, in sides. A place is worth verifying that has this share there.
_LOOKS, _WORTH_LOOKING, _TEMPERATURE, _APART = 2, 0.35, 0.1, 0.5
_WORTH_VERIFYING = 0.5
#: The least that a share of the usual response is taken for.
_LEAST_SHARE = 1e-6
#: The target is searched on its straight way on for that long; then where it was seen last.
_EXTRAPOLATED_FRAMES = 60
#: By which factor the size of a target may change that isn't certain.
_DRIFT = 1.5
#: A model that doesn't learn prefers another place where its response has this share of the usual
#: one before the failure, and is higher than at the present place by so much.
_PREFERRED, _PREFERENCE = 0.7, 0.2


@dataclass(frozen=True)
class Candidate:
    """
    A place that was searched, in pixels, its similarity, and its response.

    `odds` is the logarithm of the odds for the target there: see `Redetection`.
    """

    center: Point
    similarity: float
    peak: float
    sharpness: float
    odds: float


@dataclass(frozen=True)
class Verdict:
    """
    What one more frame of a search says: what to go on with, and how similar its place is.

    `over` tells whether the failure is over, `elsewhere` whether it goes on at another place: that
    where the response has that sharpness.
    """

    live: TargetSnapshot
    similarity: float
    over: bool = False
    elsewhere: bool = False
    sharpness: float = 0.0


class Redetection:
    """
    Searches, after a tracking failure, with the target as it was known before.

    Updates of the live model never stop, since a change of appearance looks like an occlusion. The
    snapshot, of `age` frames before, searches some windows in each frame beside the live one,
    among them that of its rival, where the live model answers besides. It replaces the live one
    once it has found a place that is verifiably more similar to the target, and where the odds are
    for it: similarity and sharpness count as for its presence, the response beside the usual one,
    for how long it has been searched, and the way to it from where the target was, or would be by
    its velocity before the failure, [px/frame]: as far as a target out of sight strays
    (`absent_error`), with heavy tails. Long after the failure it isn't on its straight way any
    more, so where it was seen last counts instead. The failure is over, too, when the live place
    has been similar enough for a while.

    Where the model doesn't learn, similarity alone verifies. A far higher response elsewhere is
    followed too: it's the same model's, so it can be compared, but the failure is over only once
    that is verified.
    """

    def __init__(self, snapshot: TargetSnapshot, template: InitialTemplate, velocity: Point,
                 age: float, rng: np.random.Generator) -> None:
        self._snapshot, self._template = snapshot, template
        self._velocity = velocity
        self._age = age
        self._rng = rng
        self._last_seen = snapshot.center
        self._updates = self._trusted_frames = self._jump_frames = 0

    def continued(self, snapshot: TargetSnapshot, template: InitialTemplate) -> Redetection:
        """Return the same search, for another localiser's snapshot and template to go on with."""
        search = copy(self)
        search._snapshot = replace(
            snapshot, center=self._snapshot.center, size=self._snapshot.size)
        search._template = template
        search._trusted_frames = search._jump_frames = 0
        return search

    @property
    def lost(self) -> Point:
        """Return where the target was last before the failure, in pixels."""
        return self._snapshot.center

    def bounds(self, width: float) -> tuple[float, float]:
        """Return the least and the largest factor of a width that the size may have."""
        known = self._snapshot.size[0] / width
        return known / _DRIFT, known * _DRIFT

    def update(self, frame: Frame, live: TargetSnapshot, similarity: float, peak: float,
               dt: float, search: bool = True, seen: bool = False,
               distractors: Sequence[Point] = (), rival: Point | None = None) -> Verdict:
        """
        Judge the live place, and search with the snapshot, unless not wanted.

        `live` is as it was updated in this frame, `similarity` its place's to the initial
        template, `peak` the highest response about it. A target that was `seen` there in the last
        frame is left only for a similarity that is trusted. No jump is to one of the
        `distractors`, places in pixels: motion told which one is the target. The `rival` is where
        the live model's response was highest of all other places, in pixels: it's looked at.
        """
        usual = live.usual_response
        live = live.followed(peak)
        self._updates += 1
        self._age += dt
        if seen:
            self._last_seen = live.center
        level = self._snapshot.usual_similarity
        trusted = max(min(_TRUSTED_SHARE * level, _TRUSTED), EVEN_SIMILARITY)
        self._trusted_frames = self._trusted_frames + 1 if similarity > trusted else 0
        if (self._updates > _ACCEPTED_UPDATES and similarity > _ACCEPTED
                and peak > _ACCEPTED_RESPONSE * usual):
            return Verdict(replace(live, usual_similarity=similarity), similarity, over=True)
        if self._trusted_frames >= _TRUSTED_FRAMES:
            return Verdict(live, similarity, over=True)
        if not search:
            return Verdict(live, similarity)
        candidates = self._candidates(frame, live.center, distractors, rival)
        learns = self._snapshot.model.LEARNS
        least = max(EVEN_SIMILARITY if learns and not seen else trusted,
                    similarity + min(_JUMP_GAIN_SHARE * level, _JUMP_GAIN))
        best = max((one for one in candidates if one.similarity >= least
                    and (one.odds >= _ODDS or not learns)),
                   key=lambda one: one.odds if learns else one.similarity, default=None)
        if best is None:
            return self._preferred(candidates, live, similarity, peak)
        self._jump_frames += 1
        plausible = similarity >= min(_PLAUSIBLE_SHARE * level, _PLAUSIBLE)
        if plausible and self._jump_frames < _JUMP_FRAMES:
            return Verdict(live, similarity)
        return Verdict(replace(self._snapshot, center=best.center), best.similarity, over=True,
                       elsewhere=True, sharpness=best.sharpness)

    def _preferred(self, candidates: list[Candidate], live: TargetSnapshot, similarity: float,
                   peak: float) -> Verdict:
        """Return where a model that doesn't learn goes on, none of the places being verified."""
        best = max(candidates, key=lambda one: one.peak, default=None)
        least = max(_PREFERRED * self._snapshot.usual_response, peak + _PREFERENCE)
        if best is None or self._snapshot.model.LEARNS or best.peak <= least:
            return Verdict(live, similarity)
        return Verdict(replace(live, center=best.center), best.similarity, elsewhere=True,
                       sharpness=best.sharpness)

    def _candidates(self, frame: Frame, live: Point, distractors: Sequence[Point],
                    rival: Point | None) -> list[Candidate]:
        """Return what is worth a jump, of the maxima in this frame."""
        snapshot, candidates = self._snapshot, []
        side = math.sqrt(math.prod(snapshot.size))
        for response in self._maxima(frame, rival):
            if response.peak < _WORTH_VERIFYING * snapshot.response_unit:
                continue
            center = inside(response.center, frame)
            away = np.abs(np.subtract(center, live)) > 0.3 * np.array(snapshot.size)
            if not away.any() or is_distractor(center, distractors, side):
                continue
            similarity = snapshot.model.credibility(
                self._template.similarity(snapshot.window(frame, center)), response, center)
            candidates.append(Candidate(
                center, similarity, response.peak, response.sharpness,
                self._odds(center, similarity, response)))
        return candidates

    def _maxima(self, frame: Frame, rival: Point | None) -> list[ResponseMap]:
        """
        Return the responses about the most promising places of this frame.

        A filter's response is less towards the border of a window, so what is found there is
        looked at again, in the middle of one.
        """
        snapshot = self._snapshot
        searched = [snapshot.localise(frame, place) for place in self._places(frame, rival)]
        if not snapshot.model.LEARNS:
            return searched
        usual = snapshot.response_unit
        promising = sorted((
            (inside(each.center, frame), each,
             each.peak / (_TEMPERATURE * usual) - self._against_way(each.center))
            for each in searched if each.peak >= _WORTH_LOOKING * usual),
            key=lambda one: -one[2])
        apart = _APART * math.sqrt(math.prod(snapshot.size))
        return [snapshot.localise(frame, place)
                for place, _, _ in distinct(promising, apart)[:_LOOKS]]

    def _odds(self, center: Point, similarity: float, response: ResponseMap) -> float:
        """Return the logarithm of the odds for the target at a place, [px], where it's sought."""
        share = response.peak / self._snapshot.response_unit
        return (evidence(similarity, response.sharpness) - self._against_way(center)
                + _RESPONSE_POWER * math.log(max(share, _LEAST_SHARE) / _EVEN_RESPONSE)
                + _FRAMES_POWER * math.log(
                    (1 + min(self._updates, _MOST_FRAMES)) / _EVEN_FRAMES))

    def _against_way(self, center: Point) -> float:
        """Return by how much the way to a place, in pixels, lowers the logarithm of the odds."""
        way = min(math.dist(center, place) for place in (self._snapshot.center, self._forecast))
        return math.log1p((way / self._spread)**2)

    @property
    def _forecast(self) -> Point:
        """Return where the target may be by now, [px]: straight on, or where it was last seen."""
        if self._age > _EXTRAPOLATED_FRAMES:
            return self._last_seen
        x, y = (place + self._age * velocity
                for place, velocity in zip(self._snapshot.center, self._velocity))
        return x, y

    @property
    def _spread(self) -> float:
        """Return how far the target has strayed, [px]: a standard deviation."""
        return math.sqrt(math.prod(self._snapshot.size)) * absent_error(self._age)

    def _places(self, frame: Frame, rival: Point | None) -> list[Point]:
        """Return the places to search in this frame."""
        center = self._snapshot.center
        places = [self._forecast if self._updates % 2 else center]
        while len(places) < _SEARCHES:
            if self._updates > _COLOURED and self._rng.random() < 0.5:
                places.append(self._coloured_place(frame))
            else:
                x, y = center + self._spread * self._rng.standard_normal(2)
                places.append((x, y))
        if rival is not None:
            places.append(rival)
        return [inside(place, frame) for place in places]

    def _coloured_place(self, frame: Frame) -> Point:
        """Return a place anywhere in the frame, or in a part of it, with the target's colours."""
        width, height = self._snapshot.size
        fine, coarse = (max(1, int(min(width, height) / pixels)) for pixels in _COLOUR_PIXELS)
        stride = fine if math.prod(frame.shape[:2]) <= _MOST_COLOURS * fine**2 else coarse
        pixels, (left, top) = sparse_part(frame, stride, _MOST_COLOURS, self._rng)
        probability = self._snapshot.model.colours.probability(colour_index(pixels))
        colour = box_mean(probability, (max(1, int(width / stride)), max(1, int(height / stride))))
        # random weights, or one blob of the same colour would be searched again and again
        colour *= self._rng.uniform(0.7, 1.0, colour.shape).astype(np.float32)
        row, column = divmod(int(colour.argmax()), colour.shape[1])
        return float(left + column * stride), float(top + row * stride)
