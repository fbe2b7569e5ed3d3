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
from vtrack_ros.localisation.distractors import is_distractor
from vtrack_ros.localisation.presence import (
    absent_error, EVEN_SIMILARITY, evidence, InitialTemplate)
from vtrack_ros.localisation.response_map import distinct, ResponseMap
from vtrack_ros.localisation.search_window import inside
from vtrack_ros.localisation.target_model import TargetSnapshot

#: Trusted similarity, which ends the failure or justifies a jump from a target that is seen: the
#: lower of a share of the usual similarity and a level, but at least `EVEN_SIMILARITY`; number of
#: consecutive frames of it that end the failure.
_TRUSTED_SHARE, _TRUSTED, _TRUSTED_FRAMES = 0.6, 0.13, 5
#: Similarity from which the present place is plausible: the lower of a share and a level again.
_PLAUSIBLE_SHARE, _PLAUSIBLE = 0.35, 0.09
#: A target whose appearance has changed is accepted, which ends the failure, above all of: number
#: of updates, similarity, response as a share of the usual one.
_ACCEPTED_UPDATES, _ACCEPTED, _ACCEPTED_RESPONSE = 40, 0.12, 0.8
#: Gain in similarity that a jump needs: the lower of a share of the usual similarity and a value.
_JUMP_GAIN_SHARE, _JUMP_GAIN = 0.1, 0.05
#: Number of frames, not necessarily consecutive, in which such a place has to be found while the
#: present one is plausible.
_JUMP_FRAMES = 3
#: Log-odds of the target at a place that are worth a jump; those that are enough to follow it
#: there while the failure goes on, and those of appearance here below which they are.
_JUMP_ODDS, _MOVE_ODDS, _HARDLY_THERE = 1.3, 0.7, -1.0
#: Exponent of the response, as a share of the usual one, in the odds; share that leaves them as
#: they are; lower bound of the share.
_RESPONSE_POWER, _EVEN_RESPONSE, _LEAST_SHARE = 4.0, 0.65, 1e-6
#: Exponent of 1 + the number of frames searched in the odds, the value that leaves them as they
#: are, and an upper clamp of the number: a target that was just occluded is rarely back at once,
#: but one that has been gone for long isn't any the likelier to come back.
_FRAMES_POWER, _EVEN_FRAMES, _MOST_FRAMES = 0.5, 12, 25
#: Windows searched in a frame, besides the rival's; frames after which colours propose some.
_SEARCHES, _COLOURED = 3, 8
#: Subsampling for the search by colours: pixels across the target's shorter side, (fine, coarse);
#: coarse where fine would be more than the second value in the whole frame. If coarse is more
#: too, only a part of the frame is used.
_COLOUR_PIXELS, _MOST_COLOURS = (6, 3), 1 << 14
#: The most probable maxima are searched again, each in the middle of a window: their number; least
#: response, as a share of the usual one; increase of that share that multiplies the odds by e; and
#: the least distance between them, [sides].
_RECENTRED, _LEAST_PEAK, _TEMPERATURE, _APART = 2, 0.35, 0.1, 0.5
#: Share of the usual response there from which a place is compared with the initial template.
_LEAST_VERIFIED_PEAK = 0.5
#: Time, [frames], for which the velocity before the failure is extrapolated; after it the place
#: where the target was seen last is used instead.
_EXTRAPOLATED_FRAMES = 60
#: Largest factor, up or down, by which the size may change while the target is out of sight.
_DRIFT = 1.5
#: A model that doesn't learn moves to another place, unverified, where the response exceeds this
#: share of the usual one before the failure, and that at the present place by this difference.
_PREFERRED, _PREFERENCE = 0.7, 0.2


@dataclass(frozen=True)
class Candidate:
    """
    A place that was searched, in pixels, its similarity, and its response.

    `odds` are the log-odds of the target there: see `Redetection`.
    """

    center: Point
    similarity: float
    peak: float
    sharpness: float
    odds: float


@dataclass(frozen=True)
class Verdict:
    """
    The result of a search in one frame: the snapshot to go on with, and its place's similarity.

    `over` tells whether the failure is over, `elsewhere` whether the snapshot is at another place,
    where the response has that sharpness; `tentative` that the target only may be there: then the
    evidence of earlier frames still counts.
    """

    live: TargetSnapshot
    similarity: float
    over: bool = False
    elsewhere: bool = False
    sharpness: float = 0.0
    tentative: bool = False


class Redetection:
    """
    Searches, after a tracking failure, with a snapshot of the target from before it.

    Updates of the live model never stop, since a change of appearance looks like an occlusion. In
    each frame the snapshot, `age` frames old at first, searches some windows besides the live one,
    among them that about the rival, the live model's highest maximum that wasn't chosen. It
    replaces the live one once it has found a place that is verifiably more similar to the target,
    and whose log-odds are high enough. They consist of similarity and sharpness, as for presence;
    of the response as a share of the usual one; of the time searched; and of the distance from
    where the target was, or would be by its velocity before the failure, [px/frame]: a
    heavy-tailed density, as wide as a target out of sight strays (`absent_error`). Long after the
    failure the place where it was seen last replaces the extrapolated one. The failure is over,
    too, when the live place has been similar enough for a while. Where the target hardly is by its
    appearance, lower odds are enough to go on elsewhere, tentatively: the failure isn't over.

    Where the model doesn't learn, similarity alone verifies. A far higher response elsewhere is
    followed too, as the responses of the same model are comparable; but the failure is over only
    once that place is verified.
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
        """Return a copy of the search that goes on with another localiser's model and template."""
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
        """Return the bounds of the size, as factors of a width."""
        known = self._snapshot.size[0] / width
        return known / _DRIFT, known * _DRIFT

    def update(self, frame: Frame, live: TargetSnapshot, similarity: float, peak: float,
               dt: float, search: bool = True, odds: float = _HARDLY_THERE,
               distractors: Sequence[Point] = (), rival: Point | None = None) -> Verdict:
        """
        Judge the live place, and, with `search`, search elsewhere with the snapshot.

        `live` was updated in this frame, `similarity` is that of its place to the initial
        template, `peak` the highest response about it. `odds` are the log-odds that it was there
        by appearance until now: a target that was seen (0 or more) is left only for a trusted
        similarity. No jump is to one of the `distractors`, places in pixels: motion tells which
        one is the target. The `rival` is the highest maximum of the live model that wasn't chosen,
        in pixels; it's searched too.
        """
        usual, seen = live.usual_response, odds >= 0
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
        enough = _MOVE_ODDS if odds < _HARDLY_THERE else _JUMP_ODDS
        best = max((one for one in candidates if one.similarity >= least
                    and (one.odds >= enough or not learns)),
                   key=lambda one: one.odds if learns else one.similarity, default=None)
        if best is None:
            return self._preferred(candidates, live, similarity, peak)
        there = Verdict(replace(self._snapshot, center=best.center), best.similarity,
                        elsewhere=True, sharpness=best.sharpness)
        if learns and best.odds < _JUMP_ODDS:
            return replace(there, tentative=True)
        self._jump_frames += 1
        plausible = similarity >= min(_PLAUSIBLE_SHARE * level, _PLAUSIBLE)
        waits = plausible and self._jump_frames < _JUMP_FRAMES
        return Verdict(live, similarity) if waits else replace(there, over=True)

    def _preferred(self, candidates: list[Candidate], live: TargetSnapshot, similarity: float,
                   peak: float) -> Verdict:
        """Return where a model that doesn't learn goes on if none of the places is verified."""
        best = max(candidates, key=lambda one: one.peak, default=None)
        least = max(_PREFERRED * self._snapshot.usual_response, peak + _PREFERENCE)
        if best is None or self._snapshot.model.LEARNS or best.peak <= least:
            return Verdict(live, similarity)
        return Verdict(replace(live, center=best.center), best.similarity, elsewhere=True,
                       sharpness=best.sharpness)

    def _candidates(self, frame: Frame, live: Point, distractors: Sequence[Point],
                    rival: Point | None) -> list[Candidate]:
        """Return the maxima of this frame that may be jumped to, compared with the template."""
        snapshot, candidates = self._snapshot, []
        side = math.sqrt(math.prod(snapshot.size))
        for response in self._maxima(frame, rival):
            if response.peak < _LEAST_VERIFIED_PEAK * snapshot.response_unit:
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

        A filter's response is less towards the border of a window, so the best places found are
        searched again, each in the middle of one.
        """
        snapshot = self._snapshot
        searched = [snapshot.localise(frame, place) for place in self._places(frame, rival)]
        if not snapshot.model.LEARNS:
            return searched
        usual = snapshot.response_unit
        promising = sorted((
            (inside(each.center, frame), each,
             each.peak / (_TEMPERATURE * usual) - self._against_way(each.center))
            for each in searched if each.peak >= _LEAST_PEAK * usual),
            key=lambda one: -one[2])
        apart = _APART * math.sqrt(math.prod(snapshot.size))
        return [snapshot.localise(frame, place)
                for place, _, _ in distinct(promising, apart)[:_RECENTRED]]

    def _odds(self, center: Point, similarity: float, response: ResponseMap) -> float:
        """Return the log-odds of the target at a place, [px]; see the class."""
        share = response.peak / self._snapshot.response_unit
        return (evidence(similarity, response.sharpness) - self._against_way(center)
                + _RESPONSE_POWER * math.log(max(share, _LEAST_SHARE) / _EVEN_RESPONSE)
                + _FRAMES_POWER * math.log(
                    (1 + min(self._updates, _MOST_FRAMES)) / _EVEN_FRAMES))

    def _against_way(self, center: Point) -> float:
        """Return by how much the distance to a place, in pixels, lowers its log-odds."""
        way = min(math.dist(center, place) for place in (self._snapshot.center, self._forecast))
        return math.log1p((way / self._spread)**2)

    @property
    def _forecast(self) -> Point:
        """Return the expected place, [px]: extrapolated, or later on where it was last seen."""
        if self._age > _EXTRAPOLATED_FRAMES:
            return self._last_seen
        x, y = (place + self._age * velocity
                for place, velocity in zip(self._snapshot.center, self._velocity))
        return x, y

    @property
    def _spread(self) -> float:
        """Return the standard deviation, [px], of the target's displacement since the failure."""
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
        # random weights, or else one blob of the same colour would be searched again and again
        colour *= self._rng.uniform(0.7, 1.0, colour.shape).astype(np.float32)
        row, column = divmod(int(colour.argmax()), colour.shape[1])
        return float(left + column * stride), float(top + row * stride)
