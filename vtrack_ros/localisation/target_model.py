"""The state of one target: models of its appearance, its place and its usual values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from vtrack_ros.appearance.colour_model import box_mean, ColourModel
from vtrack_ros.appearance.constrained_filter import ConstrainedFilter
from vtrack_ros.appearance.regression import CorrelationFilter, ScaleRegression
from vtrack_ros.frame import Array32, Frame, Point
from vtrack_ros.localisation.response_map import ResponseMap
from vtrack_ros.localisation.running_means import latest_weight
from vtrack_ros.localisation.search_window import (
    DETAIL, SAMPLES, SearchWindow, Step, WindowLayout)

#: Standard deviation of the desired response, as a share of the target's mean side.
_LABEL_WIDTH = 1 / 16
#: Weight of the colours in the response; the rest is the correlation filter's.
_COLOUR_WEIGHT = 0.3
#: Distance from a window's centre, [cells along either axis], above which a target needs a new
#: window about it.
_CENTRED = 1.0
#: Rotation, [rad], up to which a target is taken to be upright.
_LEAST_TURN = 0.05
#: Learning rates: weights of an example in the running averages.
_COLOUR_RATE = 0.08
_SCALE_RATE = 0.05
#: Weights of the first frame's model in each update, as shares of the learning rate: without them
#: errors of place and size add up, and after some minutes the model is of something else.
_FIRST_IN_FILTER, _FIRST_IN_SCALE = 0.3, 0.15
#: Weight of a frame in the usual response and similarity: low, or they would adapt to an occluder.
_USUAL_RATE = 0.03
#: Lower bound of the usual response as the divisor of others.
_LEAST_RESPONSE = 1e-6


@dataclass(frozen=True)
class TargetModel:
    """
    A correlation filter, a colour model and a scale regression of one target.

    It's never changed in place: a snapshot of it is the object itself.
    """

    #: Whether it's updated, so that its responses at different times aren't comparable.
    LEARNS: ClassVar[bool] = True

    layout: WindowLayout
    correlation: CorrelationFilter
    colours: ColourModel
    scale: ScaleRegression

    @classmethod
    def create(cls, window: SearchWindow, confined: bool = False, shift: Point = (0.0, 0.0),
               growth: float = 1.0) -> TargetModel:
        """
        Learn the target in a window; confined: a filter of its box only.

        It's `shift` cells off the window's centre, and by the factor `growth` larger than the
        window's size: windows are of whole pixels.
        """
        layout = window.layout
        width, height = layout.target
        correlation = CorrelationFilter.create(
            layout.rows, layout.columns, _LABEL_WIDTH * float(np.sqrt(width * height)))
        if confined:
            correlation = ConstrainedFilter.within(width, height, correlation)
        scale = ScaleRegression.create(SAMPLES * width, SAMPLES * height)
        return cls(
            layout, correlation.updated(window.spectrum, 1.0, shift),
            ColourModel.create().updated(window.colours, window.rectangle(shift), 1.0),
            scale.updated(window.grey, window.sample_at(shift), growth, 1.0))

    def response(self, window: SearchWindow) -> Array32:
        """
        Return the response to the target's centre in each cell of a window.

        The weighted sum of the correlation response and of the mean foreground probability over
        the target's box.
        """
        width, height = self.layout.target
        probability = self.colours.probability(window.colours)
        colour = box_mean(
            probability, (max(1, round(DETAIL * width)), max(1, round(DETAIL * height))))
        response = self.correlation.response(window.spectrum)
        response *= np.float32(1 - _COLOUR_WEIGHT)
        response += np.float32(_COLOUR_WEIGHT) * colour[::DETAIL, ::DETAIL]
        return response

    def localise(self, frame: Frame, center: Point, size: Point,
                 angle: float = 0.0) -> ResponseMap:
        """
        Return the response in the window about a target of that centre and size, in pixels.

        The window is turned by an angle, [rad].
        """
        window = self.layout.window(frame, center, size, angle)
        return ResponseMap(window, self.response(window))

    def localise_beside(self, frame: Frame, center: Point, size: Point, angle: float,
                        steps: Sequence[Step]) -> list[ResponseMap]:
        """Return the responses in neighbouring windows; see `WindowLayout.windows_beside`."""
        windows = self.layout.windows_beside(frame, center, size, angle, steps)
        return [ResponseMap(window, self.response(window)) for window in windows]

    def credibility(self, similarity: float, response: ResponseMap, place: Point) -> float:
        """Return a place's similarity to the initial template, as is; a subclass may weight it."""
        return similarity

    def growth(self, window: SearchWindow, shift: Point) -> float:
        """Return by which factor the target, `shift` cells off the centre, grew."""
        return self.scale.growth(window.grey, window.sample_at(shift))

    def updated(self, window: SearchWindow, shift: Point, count: float,
                first: TargetModel) -> TargetModel:
        """
        Return the model whose filter has learned the target, `shift` cells off the centre.

        The learning rate is multiplied by `count`, the number of examples that this one stands
        for. A share of it goes to the filter of the `first` frame's model.
        """
        rate = latest_weight(self.correlation.RATE, count)
        correlation = self.correlation.updated(window.spectrum, rate, shift)
        correlation = correlation.mixed(first.correlation, _FIRST_IN_FILTER * rate)
        return replace(self, correlation=correlation)

    def with_colours(self, window: SearchWindow, shift: Point, count: float) -> TargetModel:
        """Return the model that has learned the target's colours too, as `updated`."""
        rate = latest_weight(_COLOUR_RATE, count)
        colours = self.colours.updated(window.colours, window.rectangle(shift), rate)
        return replace(self, colours=colours)

    def with_scale(self, window: SearchWindow, shift: Point, growth: float, count: float,
                   first: TargetModel) -> TargetModel:
        """Return the model that learned the scale of a target grown by a factor, as `updated`."""
        rate = latest_weight(_SCALE_RATE, count)
        scale = self.scale.mixed(first.scale, _FIRST_IN_SCALE * rate)
        scale = scale.updated(window.grey, window.sample_at(shift), growth, rate)
        return replace(self, scale=scale)


@dataclass(frozen=True)
class TargetSnapshot:
    """
    The state of the target at one time; the live one is replaced in every frame.

    Centre and size are in pixels, the size as it would be upright; `turn` is the sum of the
    rotations measured since the first frame, [rad]. The usual values are moving averages of the
    highest response, and of the similarity to the initial template.
    """

    model: TargetModel
    center: Point
    size: Point
    usual_response: float
    usual_similarity: float
    turn: float = 0.0

    @property
    def angle(self) -> float:
        """Return the target's rotation, [rad]; 0 where it's so small that it may be an error."""
        return self.turn if abs(self.turn) > _LEAST_TURN else 0.0

    @property
    def response_unit(self) -> float:
        """Return the unit of responses: the usual one, with a positive lower bound."""
        return max(self.usual_response, _LEAST_RESPONSE)

    def localise(self, frame: Frame, center: Point, angle: float | None = None) -> ResponseMap:
        """Return the response in the window about a place, in pixels; maybe at another angle."""
        return self.model.localise(
            frame, center, self.size, self.angle if angle is None else angle)

    def localise_beside(self, frame: Frame, center: Point,
                        steps: Sequence[Step]) -> list[ResponseMap]:
        """Return the responses in neighbouring windows; see `WindowLayout.windows_beside`."""
        return self.model.localise_beside(frame, center, self.size, self.angle, steps)

    def window(self, frame: Frame, center: Point) -> SearchWindow:
        """Describe the window about a place, in pixels."""
        return self.model.layout.window(frame, center, self.size, self.angle)

    def followed(self, response: float, similarity: float | None = None) -> TargetSnapshot:
        """Return the snapshot with usual values updated by one more frame's."""
        usual_response, usual_similarity = self.usual_response, self.usual_similarity
        usual_response += _USUAL_RATE * (response - usual_response)
        if similarity is not None:
            usual_similarity += _USUAL_RATE * (similarity - usual_similarity)
        return replace(self, usual_response=usual_response, usual_similarity=usual_similarity)


def is_centred(shift: Point) -> bool:
    """Tell whether a target `shift` cells off a window's centre needs no window of its own."""
    return max(abs(shift[0]), abs(shift[1])) <= _CENTRED
