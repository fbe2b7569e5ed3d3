"""Whether the target is present: by its similarity to the first frame, and a sharp response."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from vtrack_ros.appearance.colour_model import ColourModel
from vtrack_ros.appearance.regression import CorrelationFilter
from vtrack_ros.frame import Array, Frame, Point
from vtrack_ros.localisation.running_means import latest_weight
from vtrack_ros.localisation.search_window import SearchWindow
from vtrack_ros.localisation.target_model import TargetModel, TargetSnapshot
from vtrack_ros.tracker import TrackState

#: Similarity of the first frame itself. A filter that sees the target alone answers more to
#: anything than one that sees the surroundings too; with this weight the two are on one scale.
_PART_WEIGHT = 0.75
#: The least that the response of the target alone to itself is taken for: where there is less,
#: nothing is to be recognised, and it has to stay little.
_LEAST_PART = 0.1
#: Power of the colours' share, and the least that it's taken for: light takes all colours away.
_COLOUR_POWER, _LEAST_COLOUR = 0.25, 0.3

#: A target that has turned by more than this, [rad], stands upright where it has that share of the
#: similarity that it has as it's turned, and a step further where it has so many times as much.
_ANCHORED, _UPRIGHT = 0.1, 0.9
_STEP, _BETTER = 0.1, 1.05

#: Tracking fails when the response falls below this share of the usual one, or the similarity
#: below its share (or below a level that is trusted in every target).
_FAILED_RESPONSE = 0.7
_FAILED_SIMILARITY, ALWAYS_GOOD = 0.6, 0.15
#: Similarity to the initial template below which a place speaks against the target.
EVEN_SIMILARITY = 0.085
#: A logistic regression on real videos, under stress too: weights of the logarithms of sharpness
#: and similarity, the intercept, and the least of each.
_SHARPNESS_WEIGHT, _SIMILARITY_WEIGHT, _INTERCEPT = 2.4, 1.9, 1.65
_LEAST_SHARPNESS, _LEAST_SIMILARITY = 0.1, 0.01
#: Who turns changes by and by, who is hidden at once: logarithms of the similarity so far below
#: their running mean, of that weight of the latest frame, are an abrupt fall, until they are
#: within so much of it again; and what it takes off the evidence.
_FALL, _RECOVERED, _USUAL_RATE = 0.9, 0.45, 0.05
_FALL_WEIGHT = 1.0
#: Another model that is less similar to its own initial template than that speaks against the
#: target, by the logarithm of the ratio.
_UNLIKE = 0.07
#: Tracking hasn't failed where the evidence for the target is more than that.
_SURE = 1.0
#: Weight of the latest frame's evidence; that of those before counts as no clearer than so much.
_EVIDENCE_RATE, _CLEAR = 0.7, 3.0
#: The confidence from which on a target is said to be there, if nobody says otherwise.
DEFAULT_THRESHOLD = 0.45
#: A target is lost after more frames out of sight than that.
_LOST_FRAMES = 30
#: Each frame more without it is one more in which something else may look like it: the odds are
#: divided by their number, in units of that, up to this logarithm; until they're so much better.
#: It's a frame without it where they're below those of the default threshold.
_MOST_DOUBT, _RECOGNISED = 1.5, 1.0
_SEEN = math.log(DEFAULT_THRESHOLD / (1 - DEFAULT_THRESHOLD))
#: Standard deviation of centre and size, as a share of the target's mean side, where it's as
#: likely as not that the target is there.
_DOUBTED_ERROR = 0.3
#: Those in the first frame out of sight: by then a tracker often is on something else. On real
#: videos, with and without painted occluders, nine in ten true centres are within 2.2 sides then,
#: and 2.1 to 3.6 later.
_ABSENT_CENTER, _ABSENT_SIZE = 1.0, 0.3
#: The variance of the centre grows by as much again in that many frames.
_WANDERING_FRAMES = 30


@dataclass(frozen=True)
class InitialTemplate:
    """
    The verifier: what a target looked like in the first frame.

    The correlation filter of the first frame was learned against the surroundings, so it tells
    the target from them far better than a similarity of features does. But it was learned with
    them too: where the target stood, they still answer when it has gone. So a place has to satisfy
    both the whole filter and the part of it that sees the target alone (`filters` is both in one),
    and to have the target's colours: `colour` is its mean foreground probability at first.
    """

    filters: CorrelationFilter
    colours: ColourModel
    colour: float

    @classmethod
    def of(cls, model: TargetModel, window: SearchWindow) -> InitialTemplate:
        """Keep a model, and the window that it was learned from, the target in its middle."""
        whole = model.correlation
        part = whole.confined(*window.layout.target)
        own = float(part.response(window.spectrum).max())
        gain = _PART_WEIGHT / max(own, _LEAST_PART)
        both = np.stack([whole.numerator, np.complex64(gain) * part.numerator])
        colour = model.colours.mean_probability(window.colours, window.rectangle((0.0, 0.0)))
        return cls(replace(whole, numerator=both), model.colours, colour)

    def similarity(self, window: SearchWindow, shift: Point = (0.0, 0.0)) -> float:
        """
        Return how similar a place is to the target at first: 0.75 if it's the same.

        The lesser of the two filters' highest responses within two cells of the place, `shift`
        cells from the window's centre, times a root of its share of the target's colours.
        """
        rows, columns = window.layout.rows, window.layout.columns
        row = min(max(round(shift[1]) + rows // 2, 0), rows - 1)
        column = min(max(round(shift[0]) + columns // 2, 0), columns - 1)
        near = self.filters.response(
            window.spectrum, slice(max(0, row - 2), row + 3),
            slice(max(0, column - 2), column + 3))
        colour = self.colours.mean_probability(
            window.colours, window.rectangle(shift)) / max(self.colour, 1e-6)
        similarity: float = min(near.reshape(2, -1).max(axis=1).tolist())
        similarity *= min(max(colour, _LEAST_COLOUR), 1.0)**_COLOUR_POWER
        return similarity

    def angle(self, frame: Frame, window: SearchWindow, place: Point, own: float) -> float:
        """
        Return by which angle, [rad], a target has turned that was seen in a turned window.

        Its place is in pixels, `own` its similarity there. A rotation that is added up from steps
        drifts, so angles about it are looked at; and who stands as at first is about as similar
        upright as in the window.
        """
        if abs(window.angle) < _ANCHORED:
            return window.angle
        near = [math.remainder(window.angle + step, math.tau) for step in (-_STEP, _STEP)]
        upright, *others = (
            self.similarity(window.layout.window(frame, place, window.size, angle))
            for angle in (0.0, *near))
        if upright > _UPRIGHT * own:
            return 0.0
        best, angle = max(zip(others, near))
        return angle if best > _BETTER * own else window.angle


def has_failed(known: TargetSnapshot, similarity: float, peak: float) -> bool:
    """
    Tell whether tracking has failed, from what was known before the frame.

    `similarity` is the place's to the initial template, `peak` the highest response about it.
    """
    least = min(_FAILED_SIMILARITY * known.usual_similarity, ALWAYS_GOOD)
    return peak < _FAILED_RESPONSE * known.usual_response or similarity < least


class PresenceDetector:
    """
    Judges from frame to frame whether the target is present; it is, at first.

    A place similar to the target's first look isn't enough, for it turns and is lit anew, and
    textures are a little similar to everything; but where the target is, the response to its live
    model is sharp as well. Neither alone tells as much as both. A similarity that fell abruptly
    speaks against it, one that faded doesn't.

    What is said of the target counts its motion and another model too (`confidence`,
    `absent_frames`), and whoever wants fewer wrong boxes, or fewer frames without one, says from
    which confidence on it's there. One that was lost for long has to be recognised beyond doubt,
    the more so the longer it was, and by the first frame's model: the live one has learned
    something else by then, to which it answers as sharply.
    What a tracker does goes by the look alone, and by even odds (`unseen_frames`): whoever
    searches elsewhere because the target rests loses more than is found.
    """

    def __init__(self) -> None:
        self._evidence = self._recognised = self._said = _CLEAR
        self._frames, self._usual, self._fallen = 0.0, math.log(_LEAST_SIMILARITY), False
        self.threshold = 0.5
        """The confidence from which on the target is said to be there."""
        self.unseen_frames = 0.0
        """For so many frames it was rather out of sight; 0 if it was seen in the last one."""
        self.absent_frames = 0.0
        """For so many frames it's said not to be there; 0 if it was in the last one."""
        #: So many frames were without it since it was last beyond doubt.
        self._missed = 0

    @property
    def confidence(self) -> float:
        """Return how sure it is that the target is where it was localised, in [0, 1]."""
        return logistic(self._said)

    def least_covariance(self, area: float, center_error: float, size_error: float) -> Array:
        """
        Return the covariance that no filter knows of, shape (4, 4), [px^2], of a box of that area.

        The error of the model itself, which drifts from where the target was pointed out, and that
        of a target that isn't seen (`unknown_covariance`). It's at least that of the errors given,
        in mean sides, and the larger the less the target is like itself: the standard deviation
        goes with the root of the odds against it.
        """
        doubted = _DOUBTED_ERROR * math.exp(-max(self._said, 0.0) / 2)
        return unknown_covariance(max(center_error, doubted), max(size_error, doubted), area,
                                  self.absent_frames)

    @property
    def doubts(self) -> bool:
        """Tell whether the target was lost for so long that it has to be recognised."""
        return self._missed > _LOST_FRAMES

    def judge(self, similarity: float, sharpness: float, dt: float, elsewhere: bool = False,
              support: float = 0.0, first_sharpness: float | None = None) -> None:
        """
        Take in one more frame's similarity to the initial template, and its sharpness.

        `support` is what else adds to the evidence; `first_sharpness` that of the first frame's
        model, where it `doubts`. To what is seen at another place, `elsewhere`, the last frames'
        mean nothing.
        """
        fallen = _FALL_WEIGHT * self._falls(similarity, dt, elsewhere)
        latest = evidence(similarity, sharpness) - fallen
        recognised = latest
        if first_sharpness is not None:
            recognised = evidence(similarity, first_sharpness) - fallen
        if not elsewhere:
            latest = _averaged(self._evidence, latest)
            recognised = _averaged(self._recognised, recognised)
        self._evidence, self._recognised = latest, recognised
        self._said = recognised + (0.0 if elsewhere else support)
        doubt = self._doubt
        if self._said >= (doubt + _RECOGNISED if doubt else _SEEN):
            self._missed, doubt = 0, 0.0
        self._said -= doubt
        if self._said < _SEEN:
            self._missed += 1
        seen, said = self._evidence >= 0.0, self.confidence >= self.threshold
        self.unseen_frames = 0.0 if seen else self.unseen_frames + dt
        self.absent_frames = 0.0 if said else self.absent_frames + dt

    def is_sure(self, similarity: float, sharpness: float) -> bool:
        """Tell whether the target is present beyond doubt if that's what the next frame says."""
        return _averaged(self._evidence, evidence(similarity, sharpness)) > _SURE

    @property
    def _doubt(self) -> float:
        """Return by how much the logarithm of the odds is lower than that of what's seen."""
        return min(math.log(self._missed / _LOST_FRAMES), _MOST_DOUBT) if self.doubts else 0.0

    def _falls(self, similarity: float, dt: float, elsewhere: bool) -> bool:
        """Tell whether the similarity has fallen abruptly, and not recovered since."""
        value = math.log(max(similarity, _LEAST_SIMILARITY))
        still = self._fallen and not elsewhere
        self._fallen = value < self._usual - (_RECOVERED if still else _FALL)
        if not self._fallen:
            self._frames += dt
            self._usual += latest_weight(_USUAL_RATE, dt, self._frames) * (value - self._usual)
        return self._fallen


def evidence(similarity: float, sharpness: float) -> float:
    """Return the logarithm of the odds that one frame gives for the target's presence."""
    return (_SHARPNESS_WEIGHT * math.log(max(sharpness, _LEAST_SHARPNESS))
            + _SIMILARITY_WEIGHT * math.log(max(similarity, _LEAST_SIMILARITY)) + _INTERCEPT)


def _averaged(before: float, latest: float) -> float:
    """Return the evidence after one more frame's."""
    before = min(max(before, -_CLEAR), _CLEAR)
    return before + _EVIDENCE_RATE * (latest - before)


def support_of(similarity: float) -> float:
    """Return what another model's similarity, at its place, adds to the evidence: 0 at most."""
    return min(math.log(max(similarity, _LEAST_SIMILARITY) / _UNLIKE), 0.0)


def logistic(value: float) -> float:
    """Return 1 / (1 + exp(-value)), without overflow."""
    return 0.5 + 0.5 * math.tanh(value / 2)


def state_after(frames: float) -> TrackState:
    """Return the state of a tracker that hasn't seen its target for so many frames."""
    if not frames:
        return TrackState.TRACKING
    return TrackState.LOST if frames > _LOST_FRAMES else TrackState.SEARCHING


def absent_error(frames: float) -> float:
    """Return the centre's standard deviation after so many frames out of sight, [mean sides]."""
    return _ABSENT_CENTER * math.sqrt(1 + frames / _WANDERING_FRAMES)


def unknown_covariance(
        center_error: float, size_error: float, area: float, frames: float) -> Array:
    """
    Return the covariance of what a filter doesn't know of: its cues' errors, and not seeing.

    Of (centre x, centre y, width, height), shape (4, 4), [px^2], for a target that hasn't been
    seen for so many frames. The errors, while it's seen, are shares of its mean side.
    """
    center, size = center_error**2, size_error**2
    if frames:
        center += absent_error(frames)**2
        size += _ABSENT_SIZE**2
    return np.diag((area * center, area * center, area * size, area * size))
