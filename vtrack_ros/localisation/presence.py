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

#: Similarity of the first frame to itself: the peak that the filter of the target alone is scaled
#: to, as it responds more to anything than one that sees the surroundings too.
_PART_PEAK = 0.75
#: Lower bound of that filter's peak response to its own example, which it's divided by: a target
#: with less can't be recognised, so its similarity has to stay low.
_LEAST_PART = 0.1
#: Exponent, in the similarity, of a place's share of the target's colours; lower bound of that
#: share, for a change of light can take all colours away.
_COLOUR_POWER, _LEAST_COLOUR = 0.25, 0.3

#: Rotation, [rad], from which on other angles are compared; the target is taken to be upright if
#: its similarity is then above this share of that at the present angle.
_ANCHORED, _UPRIGHT = 0.1, 0.9
#: Else: step to both neighbouring angles, [rad]; ratio of similarities above which one is taken.
_STEP, _ANGLE_RATIO = 0.1, 1.05

#: Tracking fails when the response falls below this share of the usual one; or the similarity
#: below the lower of a share of the usual one and a level that's good enough for every target.
_FAILED_RESPONSE = 0.7
_FAILED_SIMILARITY, ALWAYS_GOOD = 0.6, 0.15
#: Similarity to the initial template below which a place speaks against the target.
EVEN_SIMILARITY = 0.085
#: Logistic regression for presence, fitted to real videos, under stress too: weights of
#: log(sharpness) and log(similarity), the intercept; lower bounds of sharpness and similarity.
_SHARPNESS_WEIGHT, _SIMILARITY_WEIGHT, _INTERCEPT = 2.4, 1.9, 1.65
_LEAST_SHARPNESS, _LEAST_SIMILARITY = 0.1, 0.01
#: A target that turns changes gradually, one that's occluded abruptly. Hysteresis of a fall: it
#: begins where log(similarity) is more than the first value below its moving average, and ends
#: within the second; weight of the latest frame in the average; log-odds that a fall subtracts.
_FALL, _RECOVERED, _USUAL_RATE, _FALL_WEIGHT = 0.9, 0.45, 0.05, 1.0
#: Similarity of another model to its own initial template below which it's evidence against the
#: target: the logarithm of their ratio is added to the log-odds.
_OTHER_EVEN_SIMILARITY = 0.07
#: Log-odds of presence above which tracking hasn't failed, whatever response and similarity are.
_SURE = 1.0
#: Exponential smoothing of the evidence: weight of the latest frame, and the bound (+/-, log-odds)
#: that the smoothed evidence of earlier frames is clipped to.
_EVIDENCE_RATE, _CLEAR = 0.7, 3.0
#: Default of the parameter `confidence_threshold`, from which on the target is reported present.
DEFAULT_THRESHOLD = 0.45
#: Frames out of sight after which the state is LOST, and after which the target has to be
#: recognised: see `_MOST_DOUBT`.
_LOST_FRAMES = 30
#: Each further frame without the target is one more in which something else may look like it. So
#: the log-odds are lowered by log(missed frames / `_LOST_FRAMES`), at most by the first value,
#: until they exceed that penalty by the second: then the count of missed frames is reset.
_MOST_DOUBT, _RECOGNISED = 1.5, 1.0
#: Log-odds below which a frame is missed: those of the default threshold.
_SEEN = math.log(DEFAULT_THRESHOLD / (1 - DEFAULT_THRESHOLD))
#: Standard deviation of centre and size, as a share of the mean side, at even odds of presence.
_DOUBTED_ERROR = 0.3
#: Standard deviations of centre and size, [mean sides], added in the first frame out of sight: by
#: then a tracker often is on something else. On real videos, with and without painted occluders,
#: nine in ten true centres are within 2.2 sides then, and 2.1 to 3.6 later.
_ABSENT_CENTER, _ABSENT_SIZE = 1.0, 0.3
#: Frames out of sight in which the added variance of the centre grows by `_ABSENT_CENTER` squared.
_WANDERING_FRAMES = 30


@dataclass(frozen=True)
class InitialTemplate:
    """
    The target's appearance in the first frame, by which places are verified.

    The correlation filter of the first frame was learned against the surroundings, so it tells
    the target from them far better than a similarity of features does. But it was learned with
    them too: they still respond where the target was, when it has gone. So a place has to satisfy
    both the whole filter and the part of it that sees the target alone (`filters` is both in one),
    and to have the target's colours: `colour` is its mean foreground probability in that frame.
    """

    filters: CorrelationFilter
    colours: ColourModel
    colour: float

    @classmethod
    def of(cls, model: TargetModel, window: SearchWindow,
           shift: Point = (0.0, 0.0)) -> InitialTemplate:
        """Make the template of a model and the window it learned, the target at that shift."""
        whole = model.correlation
        part = whole.confined(*window.layout.target)
        own = float(part.response(window.spectrum).max())
        gain = _PART_PEAK / max(own, _LEAST_PART)
        both = np.stack([whole.numerator, np.complex64(gain) * part.numerator])
        colour = model.colours.mean_probability(window.colours, window.rectangle(shift))
        return cls(replace(whole, numerator=both), model.colours, colour)

    def similarity(self, window: SearchWindow, shift: Point = (0.0, 0.0)) -> float:
        """
        Return how similar a place is to the target in the first frame: 0.75 if it's the same.

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
        Return the rotation, [rad], of a target that was seen in a turned window.

        Its place is in pixels, `own` its similarity there. A sum of measured steps drifts, so
        neighbouring angles are compared; an upright target is about as similar at angle 0, too.
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
        return angle if best > _ANGLE_RATIO * own else window.angle


def has_failed(known: TargetSnapshot, similarity: float, peak: float) -> bool:
    """
    Tell whether tracking has failed, compared with the usual values before the frame.

    `similarity` is the place's to the initial template, `peak` the highest response about it.
    """
    least = min(_FAILED_SIMILARITY * known.usual_similarity, ALWAYS_GOOD)
    return peak < _FAILED_RESPONSE * known.usual_response or similarity < least


class PresenceDetector:
    """
    Judges from frame to frame whether the target is present; it is, at first.

    Similarity to the first frame isn't enough: the target turns, its light changes, and textures
    are a little similar to everything. Where the target is, the response of its live model is
    sharp as well, and both together tell more than either. An abrupt fall of the similarity is
    evidence against the target, a gradual one isn't.

    What is reported (`confidence`, `absent_frames`) counts motion and another model too; its
    `threshold` trades wrong boxes for frames without one. After a long absence the target must be
    recognised with a margin that grows with it, and by the first frame's model: the live one has
    learned something else by then, and responds to that as sharply. What a tracker does depends
    on the log-odds of appearance alone (`appearance_odds`; `unseen_frames` at even ones): to
    search elsewhere because the target rests loses more than it finds.
    """

    def __init__(self) -> None:
        self.appearance_odds = self._recognised = self._log_odds = _CLEAR
        self._frames, self._usual, self._fallen = 0.0, math.log(_LEAST_SIMILARITY), False
        self.threshold = DEFAULT_THRESHOLD
        """The least confidence at which the target is reported as present."""
        self.unseen_frames = 0.0
        """Time, [frames], for which appearance has been against the target; 0 if it's seen."""
        self.absent_frames = 0.0
        """Time, [frames], for which it's been reported as absent; 0 if it's present."""
        #: Number of frames below `_SEEN` since the target was last recognised.
        self._missed = 0

    @property
    def confidence(self) -> float:
        """Return the probability that the target is where it was localised, in [0, 1]."""
        return logistic(self._log_odds)

    def least_covariance(self, area: float, center_error: float, size_error: float) -> Array:
        """
        Return the lower bound of the covariance, shape (4, 4), [px^2], of a box of that area.

        It's what a filter doesn't model: the drift of the target model from the place that was
        selected, and the error while the target isn't seen (`unknown_covariance`). The errors, in
        mean sides, are lower bounds of the standard deviations, which are proportional to the root
        of the odds against the target, up to even ones.
        """
        doubted = _DOUBTED_ERROR * math.exp(-max(self._log_odds, 0.0) / 2)
        return unknown_covariance(max(center_error, doubted), max(size_error, doubted), area,
                                  self.absent_frames)

    @property
    def doubts(self) -> bool:
        """Tell whether more than `_LOST_FRAMES` were missed: the target must be recognised."""
        return self._missed > _LOST_FRAMES

    def judge(self, similarity: float, sharpness: float, dt: float, elsewhere: bool = False,
              support: float = 0.0, first_sharpness: float | None = None) -> None:
        """
        Update with one more frame's similarity to the initial template, and its sharpness.

        `support` is added to the log-odds; `first_sharpness` is that of the first frame's model,
        given where it `doubts`. `elsewhere` tells that the target was found at another place: then
        neither the evidence of earlier frames nor the support counts.
        """
        fallen = _FALL_WEIGHT * self._falls(similarity, dt, elsewhere)
        latest = evidence(similarity, sharpness) - fallen
        recognised = latest
        if first_sharpness is not None:
            recognised = evidence(similarity, first_sharpness) - fallen
        if not elsewhere:
            latest = _averaged(self.appearance_odds, latest)
            recognised = _averaged(self._recognised, recognised)
        self.appearance_odds, self._recognised = latest, recognised
        self._log_odds = recognised + (0.0 if elsewhere else support)
        doubt = min(math.log(self._missed / _LOST_FRAMES), _MOST_DOUBT) if self.doubts else 0.0
        if self._log_odds >= (doubt + _RECOGNISED if doubt else _SEEN):
            self._missed, doubt = 0, 0.0
        self._log_odds -= doubt
        if self._log_odds < _SEEN:
            self._missed += 1
        seen, present = self.appearance_odds >= 0.0, self.confidence >= self.threshold
        self.unseen_frames = 0.0 if seen else self.unseen_frames + dt
        self.absent_frames = 0.0 if present else self.absent_frames + dt

    def is_sure(self, similarity: float, sharpness: float) -> bool:
        """Tell whether the evidence, with these values for the next frame, exceeds `_SURE`."""
        return _averaged(self.appearance_odds, evidence(similarity, sharpness)) > _SURE

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
    """Return the log-odds of the target's presence by one frame alone."""
    return (_SHARPNESS_WEIGHT * math.log(max(sharpness, _LEAST_SHARPNESS))
            + _SIMILARITY_WEIGHT * math.log(max(similarity, _LEAST_SIMILARITY)) + _INTERCEPT)


def _averaged(before: float, latest: float) -> float:
    """Return the smoothed evidence after one more frame."""
    before = min(max(before, -_CLEAR), _CLEAR)
    return before + _EVIDENCE_RATE * (latest - before)


def support_of(similarity: float) -> float:
    """Return what another model's similarity, at its place, adds to the log-odds: 0 at most."""
    return min(math.log(max(similarity, _LEAST_SIMILARITY) / _OTHER_EVEN_SIMILARITY), 0.0)


def logistic(value: float) -> float:
    """Return 1 / (1 + exp(-value)), without overflow."""
    return 0.5 + 0.5 * math.tanh(value / 2)


def state_after(frames: float) -> TrackState:
    """Return the state of a tracker whose target has been out of sight for that time."""
    if not frames:
        return TrackState.TRACKING
    return TrackState.LOST if frames > _LOST_FRAMES else TrackState.SEARCHING


def absent_error(frames: float) -> float:
    """Return the centre's standard deviation after frames out of sight, [mean sides]."""
    return _ABSENT_CENTER * math.sqrt(1 + frames / _WANDERING_FRAMES)


def unknown_covariance(
        center_error: float, size_error: float, area: float, frames: float) -> Array:
    """
    Return the covariance that a filter doesn't model: errors of its cues, and being out of sight.

    Of (centre x, centre y, width, height), shape (4, 4), [px^2]. The errors are the standard
    deviations in sight, as shares of the mean side; `frames` is the time out of sight.
    """
    center, size = center_error**2, size_error**2
    if frames:
        center += absent_error(frames)**2
        size += _ABSENT_SIZE**2
    return np.diag((area * center, area * center, area * size, area * size))
