"""Localises one target by a Siamese network, and verifies it by the initial template."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vtrack_ros.appearance.siamese_network import (
    Blob, EXEMPLAR, exemplar_side, SEARCHED, SiameseNetwork)
from vtrack_ros.frame import Array, Frame, Point
from vtrack_ros.localisation.localiser import LARGEST, Localiser, SMALLEST
from vtrack_ros.localisation.response_map import ResponseMap
from vtrack_ros.localisation.search_window import Grid, inside, Step
from vtrack_ros.localisation.target_model import TargetModel, TargetSnapshot

#: Log-odds of places off a target: response 0; how much more they are on it: response 1.
_ELSEWHERE, _RANGE = -6.0, 16.0
#: Cells along a side of the response map; standard deviation of a box's Gaussian in it, [cells].
_CELLS, _SPREAD = 32, 1.0
#: Share of the highest response below which a box isn't used.
_SHARE = 0.3
#: Exponent of the boxes' responses at a place, as weights of their mean; lower bound of responses.
_WEIGHT_POWER, _LEAST_LEVEL = 16, 1e-6
#: Rate at which the response of a box decays exponentially with its change of size and shape.
_CHANGE = 0.148
#: Factor that brings the product of similarity and response to the scale of a similarity.
_CREDIBLE = 1.75
#: Log-odds added to the evidence for a network's target: it responds to other things, too.
SUPPORT = -1.5
#: Weight, per frame, of the network's box in the moving average of the size's logarithm.
_SIZE_RATE = 0.35
#: Largest correction of the network's box in the first frame, as a share of its size.
_CORRECTED = 0.15
#: The correction holds for the appearance in the first frame: similarity from which it's applied
#: in full, below it in proportion; weight of the latest frame in the moving average of that share.
_FULL_SIMILARITY, _ALIKE_RATE = 0.2, 0.1


@dataclass(frozen=True)
class SiameseResponse(ResponseMap):
    """
    The response in each cell, and the boxes that it's made of.

    `boxes`, shape (N, 4), are centres, widths and heights in pixels, `levels`, shape (N,), their
    responses.
    """

    boxes: Array
    levels: Array

    @classmethod
    def of(cls, center: Point, side: float, boxes: Array, levels: Array) -> SiameseResponse:
        """Make the response in the square of that centre and side, in pixels."""
        cell = side / _CELLS
        at = np.arange(_CELLS) - _CELLS // 2
        along_x, along_y = (
            np.exp(-(at - (boxes[:, axis, None] - center[axis]) / cell)**2 / (2 * _SPREAD**2))
            for axis in (0, 1))
        values = ((levels[:, None] * along_y)[:, :, None] * along_x[:, None]).max(axis=0)
        return cls(Grid(center, (cell, cell), 0.0), values.astype(np.float32), boxes, levels)

    def box_at(self, place: Point) -> Array:
        """
        Return the box that the network has found about a place, shape (4,), in pixels.

        The mean of those there, dominated by the likeliest. It isn't that one alone: of two that
        are as likely, the least difference would decide which one it is.
        """
        away = ((self.boxes[:, :2] - place) / self.window.cell)**2
        logs = np.log(np.maximum(self.levels, _LEAST_LEVEL)) - away.sum(axis=1) / (2 * _SPREAD**2)
        weights = np.exp(_WEIGHT_POWER * (logs - logs.max()))
        box: Array = weights @ self.boxes / weights.sum()
        return box


@dataclass(frozen=True)
class SiameseModel(TargetModel):
    """
    The models that a target is searched and verified with, and a network that localises it.

    The network's box of the target in the first frame isn't the one that was given: `correction`,
    (x, y, width, height), is the shift from it in units of its size, and the factors of its size;
    `alike`, from 0 to 1, is the share of the correction that's applied.
    """

    LEARNS = False

    network: SiameseNetwork
    target: Blob
    correction: Array
    alike: float = 1.0

    @classmethod
    def beside(cls, model: TargetModel, network: SiameseNetwork, frame: Frame, center: Point,
               size: Point) -> SiameseModel:
        """Extend a model by a network that is shown the target in its first frame."""
        target = network.learn(frame, center, size)
        found = cls(model.layout, model.correlation, model.colours, model.scale, network, target,
                    np.array([0.0, 0.0, 1.0, 1.0]))
        box = found.localise(frame, center, size).box_at(center)
        correction = np.concatenate([(center - box[:2]) / box[2:], size / box[2:]])
        neutral = found.correction
        return replace(found, correction=correction.clip(
            neutral - _CORRECTED, neutral + _CORRECTED))

    def localise(self, frame: Frame, center: Point, size: Point,
                 angle: float = 0.0) -> SiameseResponse:
        """
        Return the response about a target of that centre and size, in pixels; angles are ignored.

        The network's log-odds, scaled to 0 off a target and 1 on it, at the centre of the box that
        it has found in each place: it's more exact than the places, a quarter of the target apart.
        """
        side = SEARCHED / EXEMPLAR * exemplar_side(size)
        odds, found = self.network.search(self.target, frame, center, side)
        levels = ((odds - _ELSEWHERE) / _RANGE).clip(0.0).ravel()
        strong = levels >= _SHARE * levels.max()
        boxes = found.reshape(4, -1).T[strong]
        boxes[:, :2] += self.alike * self.correction[:2] * boxes[:, 2:]
        boxes[:, 2:] *= self.correction[2:]**self.alike
        return SiameseResponse.of(
            center, side, boxes, levels[strong] * _steadiness(boxes[:, 2:], size))

    def localise_beside(self, frame: Frame, center: Point, size: Point, angle: float,
                        steps: Sequence[Step]) -> list[ResponseMap]:
        """Return the responses about places some steps away, by half windows of the filter's."""
        width, height = (side * reach / 2 for side, reach in zip(size, self.layout.reach))
        halves = Grid(center, (width, height), angle)
        return [self.localise(frame, inside(halves.at(step), frame), size) for step in steps]

    def seen(self, similarity: float) -> SiameseModel:
        """Return the model with `alike` updated by a frame of that similarity to the first."""
        alike = self.alike + _ALIKE_RATE * (min(similarity / _FULL_SIMILARITY, 1.0) - self.alike)
        return replace(self, alike=max(alike, 0.0))

    def credibility(self, similarity: float, response: ResponseMap, place: Point) -> float:
        """Return the similarity of a place, in pixels, times the network's response there."""
        return _CREDIBLE * similarity * response.sample_one(place)


def _steadiness(sizes: Array, size: Point) -> Array:
    """
    Return a penalty factor, shape (N,), of boxes with sizes of shape (N, 2), for their change.

    1 for one of the same size and shape [Li et al. 2018, sec. 4.3]: many boxes overlap the target,
    and the network's odds alone don't tell which is the best of them.
    """
    width, height = sizes.T
    change = np.ones(len(sizes))
    for found, before in ((width / height, size[0] / size[1]),
                          (exemplar_side((width, height)), exemplar_side(size))):
        change *= np.maximum(found / before, before / found)
    steadiness: Array = np.exp(_CHANGE * (1 - change))
    return steadiness


class SiameseLocaliser(Localiser):
    """
    Localises a target by a Siamese network, which doesn't learn.

    Its boxes have their own aspect, and none is turned. Presence and re-detection are those of
    `Localiser`: the initial template, of a correlation filter, decides.
    """

    #: The network's window is larger than a filter's, and takes ten times as long.
    MORE_WINDOWS = 2
    #: Larger, for it's nearly always sure, and its boxes don't have the selected box's aspect.
    LEAST_ERRORS = (0.12, 0.10)

    def __init__(self, frame: Frame, center: Point, size: Point, rng: np.random.Generator,
                 network: SiameseNetwork) -> None:
        super().__init__(frame, center, size, rng)
        self._first_model = SiameseModel.beside(self._live.model, network, frame, center, size)
        self._live = replace(self._live, model=self._first_model)
        # none: those of `Localiser` are of the correlation filter's responses
        self._least_usual = 0.0, 0.0

    def resume(self, snapshot: TargetSnapshot, beside: Localiser) -> None:
        """Continue at another localiser's place, with the bounding box of its turned target."""
        super().resume(snapshot, beside)
        size = self._bounded((beside.box.width, beside.box.height))
        self._live = replace(self._live, size=size, turn=0.0)

    def _updated(self, frame: Frame, response: ResponseMap, center: Point,
                 dt: float) -> TargetSnapshot:
        """Return the target at a place, compared with the initial template if that's due."""
        live, size = self._live, self._live.size
        if isinstance(response, SiameseResponse):
            rate = (1 - (1 - _SIZE_RATE)**dt) * min(response.sample_one(center), 1.0)
            width, height = (
                before * (found / before)**rate
                for before, found in zip(size, response.box_at(center)[2:].tolist()))
            size = self._bounded((width, height))
        self._window = window = live.model.layout.window(frame, center, size)
        self._verify(window, center, response)
        assert isinstance(live.model, SiameseModel)
        return replace(live, model=live.model.seen(self._similarity), center=center, size=size,
                       turn=0.0)

    def _bounded(self, size: Point) -> Point:
        """Clamp each side of a size to `SMALLEST` and `LARGEST` of its first length."""
        width, height = (min(max(side, SMALLEST * first), LARGEST * first)
                         for side, first in zip(size, self._first_size))
        return width, height
