"""Global search: the whole frame is searched for a target that has long been unlike itself."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math

import numpy as np

from vtrack_ros.frame import Frame, Point
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.distractors import is_distractor
from vtrack_ros.localisation.presence import evidence, InitialTemplate
from vtrack_ros.localisation.response_map import ResponseMap
from vtrack_ros.localisation.running_means import latest_weight
from vtrack_ros.localisation.search_window import inside, Step
from vtrack_ros.localisation.target_model import TargetModel, TargetSnapshot

#: What is tracked is doubted after a time with a low moving average of its similarity, or after a
#: longer tracking failure: weight per frame, level below which the average is low, and the two
#: times, [frames].
_RATE, _DOUBTED_SIMILARITY, _DOUBTED_FRAMES, _FAILED_FRAMES = 0.05, 0.15, 20.0, 30.0
#: What was found after a failure is doubted at once, until its recent similarity reaches this
#: share of the one that was usual before.
_CONFIRMED = 0.9
#: Weight per frame in the recent similarity, which other places are compared with.
_RECENT_RATE = 0.25
#: Windows about a place anywhere in the frame, by steps of half a window (right, down): they
#: share their features, so that five of them take the time of three and a half separate ones.
_WINDOWS: tuple[Step, ...] = ((0, 0), (-1, -1), (1, -1), (-1, 1), (1, 1))
#: A place is the target's from these values on: similarity to the initial template; its ratio to
#: that of what is tracked, anywhere, and about where the target was lost; log-odds of presence.
_LEAST_SIMILARITY, _GAIN, _GAIN_WHERE_LOST, _EVIDENT = 0.18, 1.3, 1.0, 0.7
#: Highest response times sharpness below which a place isn't compared with the template: of 49
#: places that were accepted without this bound none had less, of the others seven in ten.
_PROMISING = 0.6
#: Time, [frames], within which it has to be found there again.
_CONFIRMING = 5.0
#: Overlap (IoU) with the box that is tracked above which a place is the same one.
_SAME_PLACE = 0.3
#: Probability that the target is searched at its first size; else at the last one not in doubt.
_FIRST_SIZE = 0.4
#: Standard deviation, [sides], of the places about where it was lost; interval [frames] at which
#: what is tracked is searched about; steps, as shares of the frame, of a low-discrepancy sequence
#: of all other places: the golden section of the plane, which spreads any number of them evenly.
_NEAR_WHERE_LOST, _BESIDE_EVERY, _STEP = 1.0, 4, (0.7548776662, 0.5698402910)


@dataclass(frozen=True)
class Sighting:
    """A place, in pixels, where the target was seen, its size, and what speaks for it."""

    center: Point
    size: Point
    similarity: float
    sharpness: float
    #: Least ratio of its similarity to that of what is tracked.
    gain: float


class GlobalSearch:
    """
    Searches the whole frame for the first frame's target, where what is tracked is unlike it.

    A model that has learned something else responds to that as sharply as to its target before,
    and re-detection, which uses the latest models, can't tell. Nor can the initial template alone,
    for a target changes its appearance. But where another place is far more similar to the first
    frame than what is tracked, and again in a later frame, the target is there. The same holds
    after re-detection has jumped to a look-alike of an occluded target; about the place where it
    was lost an equal similarity is enough then, except at the distractors, which motion has told
    from the target.
    """

    def __init__(self, model: TargetModel, template: InitialTemplate, size: Point,
                 rng: np.random.Generator) -> None:
        self._model, self._template, self._first_size = model, template, size
        # a generator of its own: searching doesn't change what others draw
        self._rng = rng.spawn(1)[0]
        self._size = size
        #: Number of frames in which the search went on so far.
        self._searches = 0
        self.restart(1.0)

    def restart(self, similarity: float, usual: float = 0.0, lost: Point | None = None) -> None:
        """
        Reset: the target was found, with that similarity to the initial template.

        After a failure, `usual` is the usual similarity before it, and `lost` its place, [px].
        """
        self._mean = self._recent = similarity
        #: Recent similarity from which what was found isn't in doubt any more; 0 from then on.
        self._unconfirmed = _CONFIRMED * usual
        self._lost = lost
        self._doubted = self._failed = 0.0
        self._candidate: Sighting | None = None
        self._waited = 0.0

    def update(self, frame: Frame, live: TargetSnapshot, similarity: float, failed: bool,
               dt: float, distractors: Sequence[Point] = ()) -> Sighting | None:
        """
        Return where the target is instead of the live place, or None if nothing better is found.

        `similarity` is the live place's to the initial template, `failed` tells whether tracking
        has failed there. The places of `distractors` near it are in pixels.
        """
        self._mean += latest_weight(_RATE, dt) * (similarity - self._mean)
        self._recent += latest_weight(_RECENT_RATE, dt) * (similarity - self._recent)
        self._failed = self._failed + dt if failed else 0.0
        self._doubted = self._doubted + dt if self._mean < _DOUBTED_SIMILARITY else 0.0
        if not (failed or self._doubted):
            self._size = live.size
        if self._recent >= self._unconfirmed:
            self._unconfirmed, self._lost = 0.0, None
        if (self._doubted < _DOUBTED_FRAMES and self._failed < _FAILED_FRAMES
                and (failed or not self._unconfirmed)):
            self._candidate = None
            return None
        tracked, candidate = max(self._recent, similarity), self._candidate
        if candidate is None:
            for response, size, gain in self._searched(frame, live):
                self._candidate = self._look(
                    frame, live, response, size, gain, tracked, distractors)
                if self._candidate is not None:
                    break
            self._waited = 0.0
            return None
        self._waited += dt
        response = self._model.localise(frame, candidate.center, candidate.size)
        found = self._look(
            frame, live, response, candidate.size, candidate.gain, tracked, distractors)
        if found is None and self._waited > _CONFIRMING:
            self._candidate = None
        return found

    def _searched(self, frame: Frame,
                  live: TargetSnapshot) -> Iterator[tuple[ResponseMap, Point, float]]:
        """
        Search the next places; return each one's response, the size searched, and its gain.

        One about where the target was lost, unless it's tracked there; and one anywhere in the
        frame, or, every `_BESIDE_EVERY` frames, about what is tracked.
        """
        size, side = self._size, math.sqrt(math.prod(self._size))
        if self._lost is not None and not _overlaps(live, self._lost, size):
            x, y = self._lost + _NEAR_WHERE_LOST * side * self._rng.standard_normal(2)
            place = inside((float(x), float(y)), frame)
            yield self._model.localise(frame, place, size), size, _GAIN_WHERE_LOST
        if self._rng.random() < _FIRST_SIZE:
            size = self._first_size
        self._searches += 1
        if self._searches % _BESIDE_EVERY:
            x, y = ((0.5 + self._searches * step) % 1.0 * length
                    for step, length in zip(_STEP, frame.shape[1::-1]))
        else:
            x, y = live.center
        for response in self._model.localise_beside(frame, (x, y), size, 0.0, _WINDOWS):
            yield response, size, _GAIN

    def _look(self, frame: Frame, live: TargetSnapshot, response: ResponseMap, size: Point,
              gain: float, tracked: float, distractors: Sequence[Point]) -> Sighting | None:
        """Return the target at the response's maximum, in that size, or None if it isn't there."""
        if response.peak * response.sharpness < _PROMISING:
            return None
        center = inside(response.center, frame)
        if _overlaps(live, center, size):
            return None
        if gain < _GAIN and is_distractor(center, distractors, math.sqrt(math.prod(size))):
            return None
        similarity = self._template.similarity(self._model.layout.window(frame, center, size))
        if (similarity < max(_LEAST_SIMILARITY, gain * tracked)
                or evidence(similarity, response.sharpness) < _EVIDENT):
            return None
        return Sighting(center, size, similarity, response.sharpness, gain)


def _overlaps(live: TargetSnapshot, center: Point, size: Point) -> bool:
    """Tell whether the live box and one of that centre and size, [px], are at `_SAME_PLACE`."""
    tracked = Box.from_center(*live.center, *live.size)
    return Box.from_center(*center, *size).iou(tracked) > _SAME_PLACE
