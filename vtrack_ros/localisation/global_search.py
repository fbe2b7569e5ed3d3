"""Global search: the whole frame is searched for a target that has long been unlike itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math

import numpy as np

from vtrack_ros.frame import Frame, Point
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.distractors import is_distractor
from vtrack_ros.localisation.presence import evidence, InitialTemplate
from vtrack_ros.localisation.search_window import inside
from vtrack_ros.localisation.target_model import TargetModel, TargetSnapshot

#: What is tracked is doubted while the running mean of its similarity, in which the latest frame
#: has this weight, is below this level, since that many frames; or when it has failed for longer.
_RATE, _DOUBTED, _PATIENCE, _FAILED = 0.05, 0.15, 20.0, 30.0
#: What was found after a failure is doubted at once, until it has had this share of the similarity
#: that was usual before.
_CONFIRMED = 0.9
#: Weight of the latest frame in the mean that another place is compared with.
_RECENT_RATE = 0.25
#: Places searched in a frame.
_LOOKS = 2
#: A place is the target's where it's so similar to the initial template, so much more so than what
#: is tracked, or as much about where it was lost, and so evident; and again within so many frames.
_LEAST, _GAIN, _GAIN_WHERE_LOST, _EVIDENT = 0.18, 1.3, 1.0, 0.7
_CONFIRMING = 5.0
#: A box that overlaps more than that with what is tracked is no other one.
_SAME = 0.3
#: How often it's searched at the size that it had at first; else at the last one beyond doubt.
_FIRST_SIZE = 0.4
#: Standard deviations of the places about what is tracked, and about where it was lost, in sides;
#: the others are spread evenly, however many they are, by steps of these shares of the frame: the
#: golden section of the plane.
_NEAR, _NEAR_WHERE_LOST, _STEP = 2.5, 1.0, (0.7548776662, 0.5698402910)


@dataclass(frozen=True)
class Sighting:
    """A place, in pixels, where the target was seen, its size, and what speaks for it."""

    center: Point
    size: Point
    similarity: float
    sharpness: float


class GlobalSearch:
    """
    Searches the whole frame for the target of the first one, where what is tracked isn't like it.

    A model that has learned something else answers to that as sharply as to its target before, and
    re-detection, which goes by the latest models, can't tell. Nor does the initial template, for
    a target changes its looks. But where something else has been far more like the first look than
    what is tracked, twice, the target is there. So it is with a look-alike that was found while
    the target was hidden: and about the place where it was lost, as like is enough, but for what
    motion has told from the target there.
    """

    def __init__(self, model: TargetModel, template: InitialTemplate, size: Point,
                 rng: np.random.Generator) -> None:
        self._model, self._template, self._first_size = model, template, size
        # of its own: searching changes nothing for the others who draw
        self._rng = rng.spawn(1)[0]
        self._size = size
        self._looks = 0
        self.restart(1.0)

    def restart(self, similarity: float, usual: float = 0.0, lost: Point | None = None) -> None:
        """
        Count the target as found, with that similarity to the initial template.

        If a failure is over, `usual` is what was usual before it, and `lost` the place then, [px].
        """
        self._mean = self._recent = similarity
        #: What was found is the target beyond doubt when it has been so similar; 0 from then on.
        self._unconfirmed = _CONFIRMED * usual
        self._lost = lost
        self._doubted = self._failed = 0.0
        self._candidate: Sighting | None = None
        self._waited = 0.0
        #: By which factor what is looked at has to be more similar than what is tracked.
        self._gain = _GAIN

    def update(self, frame: Frame, live: TargetSnapshot, similarity: float, failed: bool,
               dt: float, distractors: Sequence[Point] = ()) -> Sighting | None:
        """
        Return where the target is instead of the live place, or None while that's the best one.

        `similarity` is the live place's to the initial template, `failed` tells whether tracking
        has failed there. The places of `distractors` near it are in pixels.
        """
        self._mean += _RATE * (similarity - self._mean)
        self._recent += _RECENT_RATE * (similarity - self._recent)
        self._failed = self._failed + dt if failed else 0.0
        self._doubted = self._doubted + dt if self._mean < _DOUBTED else 0.0
        if not (failed or self._doubted):
            self._size = live.size
        if self._recent >= self._unconfirmed:
            self._unconfirmed, self._lost = 0.0, None
        if (self._doubted < _PATIENCE and self._failed < _FAILED
                and (failed or not self._unconfirmed)):
            self._candidate = None
            return None
        tracked, candidate = max(self._recent, similarity), self._candidate
        if candidate is None:
            for place, size, self._gain in self._places(frame, live):
                self._candidate = self._look(
                    frame, live, inside(place, frame), size, tracked, distractors)
                if self._candidate is not None:
                    break
            self._waited = 0.0
            return None
        self._waited += dt
        found = self._look(frame, live, candidate.center, candidate.size, tracked, distractors)
        if found is None and self._waited > _CONFIRMING:
            self._candidate = None
        return found

    def _places(self, frame: Frame, live: TargetSnapshot) -> Iterator[tuple[Point, Point, float]]:
        """
        Return the next places, in pixels, with the size that's looked for there and its `_gain`.

        About where it was lost, unless it's tracked there; near it and anywhere in turns.
        """
        height, width = frame.shape[:2]
        if self._lost is not None and not _overlaps(live, self._lost, self._size):
            side = math.sqrt(math.prod(self._size))
            x, y = self._lost + _NEAR_WHERE_LOST * side * self._rng.standard_normal(2)
            yield (float(x), float(y)), self._size, _GAIN_WHERE_LOST
        for _ in range(_LOOKS):
            self._looks += 1
            size = self._first_size if self._rng.random() < _FIRST_SIZE else self._size
            if self._looks % 2:
                x, y = live.center + (
                    _NEAR * math.sqrt(math.prod(size)) * self._rng.standard_normal(2))
            else:
                x, y = ((0.5 + self._looks * step) % 1.0 * side
                        for step, side in zip(_STEP, (width, height)))
            yield (float(x), float(y)), size, _GAIN

    def _look(self, frame: Frame, live: TargetSnapshot, place: Point, size: Point, tracked: float,
              distractors: Sequence[Point]) -> Sighting | None:
        """Return the target as it's seen about a place, in that size, unless it's the live one."""
        response = self._model.localise(frame, place, size)
        center = inside(response.center, frame)
        if _overlaps(live, center, size):
            return None
        if self._gain < _GAIN and is_distractor(center, distractors, math.sqrt(math.prod(size))):
            return None
        similarity = self._template.similarity(self._model.layout.window(frame, center, size))
        if (similarity < max(_LEAST, self._gain * tracked)
                or evidence(similarity, response.sharpness) < _EVIDENT):
            return None
        return Sighting(center, size, similarity, response.sharpness)


def _overlaps(live: TargetSnapshot, center: Point, size: Point) -> bool:
    """Tell whether the live box is about the same place as one of that centre and size, [px]."""
    return Box.from_center(*center, *size).iou(Box.from_center(*live.center, *live.size)) > _SAME
