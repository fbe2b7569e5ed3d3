"""A target told from its surroundings: localised, doubted, searched for and found again."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.first_look import FirstLook
from vtrack_ros.appearance.foreground import box_mean, colour_index
from vtrack_ros.appearance.target import Point, TargetModel
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.tracker import Estimate
from vtrack_ros.trackers.out_of_sight import (
    EVEN_LIKENESS, Sight, state_after, unknown_covariance)
from vtrack_ros.trackers.sighting import Hypothesis, look_for, Sighting

#: Trouble is when the evidence falls below this share of its running mean, or the likeness below
#: its share (or below a level that is trusted in every target).
_EVIDENCE_TROUBLE = 0.7
_LIKENESS_TROUBLE, _ALWAYS_GOOD = 0.6, 0.15
#: The running means are slow, or they would get used to an occluder.
_MEAN_RATE = 0.03
#: Likeness that ends the trouble, or justifies a jump: the lower of a share and a level, but never
#: one that speaks against the target.
_TRUSTED_SHARE, _TRUSTED = 0.6, 0.13
#: Likeness that leaves the present place plausible, likewise.
_PLAUSIBLE_SHARE, _PLAUSIBLE = 0.35, 0.09
#: Frames of trusted likeness that end the trouble.
_TRUSTED_FRAMES = 5
#: Looks after which a target that looks different, but is seen well, is taken for changed.
_ACCEPTED_LOOKS, _ACCEPTED = 40, 0.12
#: A jump needs this much more likeness, and that often while the present place is plausible.
_JUMP_GAIN_SHARE, _JUMP_GAIN = 0.1, 0.05
_JUMP_FRAMES = 3
#: A place is worth verifying where the evidence has this share of its mean.
_WORTH_VERIFYING = 0.5
#: The scale changes slowly: it's looked at and learned in every fourth frame, and in the frame
#: after one in which it changed by this logarithm; colours in every second one.
_SCALE_EVERY, _GROWING, _COLOURS_EVERY = 4, 0.04, 2
#: A target that's beyond question is verified in every second frame too; it's questionable where
#: the evidence is below this share of its mean, or where it wasn't always good enough before.
_VERIFIED_EVERY, _EVIDENCE_QUESTIONABLE = 2, 0.85
#: The target is looked for on its straight way on for that long.
_EXTRAPOLATED_FRAMES = 60
#: Standard deviations of centre and size that no filter knows of, as shares of the mean side.
ERRORS = 0.07, 0.10
_SMALLEST, _LARGEST = 0.2, 5.0
#: By which factor a doubtful target's size may change.
_DRIFT = 1.5


class DiscriminativeTarget:
    """
    Keeps the live belief, notices when it's doubtful, and searches with the belief before that.

    Learning never stops, since a change of appearance looks like an occlusion. When trouble
    starts, a snapshot of the belief is kept instead; it searches beside the live belief, which it
    replaces once it has found a place that is verifiably more like the target.

    Parameters
    ----------
    rng : numpy.random.Generator
        Where the search draws its places.
    searches : int
        Windows searched in each doubtful frame.

    """

    def __init__(self, rng: np.random.Generator, searches: int = 2) -> None:
        self._rng = rng
        self._searches = searches

    def start(self, frame: Frame, center: Point, size: Point) -> None:
        """Begin on a target of that centre and size, in pixels."""
        model = TargetModel.create(frame, center, size)
        self._first = FirstLook.of(model, model.view(frame, center, size))
        self.live = Hypothesis(model, center, size, 1.0, 1.0)
        self._first_size = size
        self._snapshot: Hypothesis | None = None
        self._velocity = 0.0, 0.0
        self._frames = 0
        self._growing = False
        self._doubtful_looks = self._trusted_frames = self._jump_frames = 0
        self._doubtful_frames = 0.0
        self._latest_step: tuple[Point, float] | None = None
        self.likeness = 1.0
        self.sight = Sight()

    def estimate(self, covariance: NDArray[np.float64], angle: float = 0.0,
                 particles: NDArray[np.float64] | None = None,
                 affine: NDArray[np.float64] | None = None, box: Box | None = None) -> Estimate:
        """
        Return the estimate that the live belief makes.

        Parameters
        ----------
        covariance : ndarray, shape (4, 4), [px^2]
            The filter's own, of (centre x, centre y, width, height); what no filter knows (the
            error of the model itself) is added.
        angle : float, [rad]
            The rotation.
        particles : ndarray, shape (N, 4), [px], optional
            The filter's own, to be drawn.
        affine : ndarray, shape (3, 3), optional
            The affine frame.
        box : Box, optional
            The box, where it isn't the live belief's own.

        """
        if box is None:
            box = Box.from_center(*self.live.center, *self.live.size)
        unseen = self.sight.unseen_frames
        return Estimate(
            box=box, angle=angle,
            covariance=covariance + unknown_covariance(*ERRORS, box.area, unseen),
            confidence=self.sight.confidence, state=state_after(unseen), particles=particles,
            affine=affine)

    @property
    def doubtful(self) -> bool:
        """Tell whether the live belief is in trouble."""
        return self._snapshot is not None

    def look(self, frame: Frame, center: Point) -> Sighting:
        """Look for the target about a place, in pixels, with the live model."""
        return look_for(self.live, frame, center)

    def settle(self, frame: Frame, sighting: Sighting, center: Point, dt: float) -> bool:
        """
        Take a place for the target's, learn from it, and judge it.

        Parameters
        ----------
        frame : ndarray of uint8
            The image.
        sighting : Sighting
            Of `look`.
        center : tuple of float, [px]
            The place that the tracker decided for.
        dt : float, [frames]
            The time since the last frame.

        Returns
        -------
        bool
            Whether the target was found again elsewhere. Where it wasn't, `live.center` is
            `center`, or next to it: near the window's border a place is looked at twice.

        """
        before = self.live
        center = _inside(center, frame)
        self.live = self._learn(frame, sighting, center)
        if self._snapshot is None:
            self._judge(before, sighting.peak, dt)
            found = False
        else:
            found = self._search(frame, sighting.peak, dt)
        usual = (self._snapshot or self.live).likeness_mean
        self.sight.judge(self.likeness, usual, dt, found)
        return found

    def _learn(self, frame: Frame, sighting: Sighting, center: Point) -> Hypothesis:
        live = self.live
        if not live.model.is_centred(sighting.shift(center)):
            # the taper distorts what is near the border, and some of the target may be beyond it
            sighting = self.look(frame, center)
            center = _inside(sighting.climb(center), frame)
        view, spectrum, shift = sighting.view, sighting.spectrum, sighting.shift(center)
        model, size = live.model, live.size
        self._frames += 1
        if self._frames % _SCALE_EVERY == 0 or self._growing:
            growth = model.growth(view, shift)
            self._growing = abs(math.log(growth)) > _GROWING
            size = self._bounded((view.size[0] * growth, view.size[1] * growth))
            model = model.learned_scale(view, shift, growth)
        if self._frames % _COLOURS_EVERY == 1:
            model = model.learned_colours(view, shift)
        model = model.learned(spectrum, shift)
        if self._frames % _VERIFIED_EVERY == 0 or self._questionable(sighting.peak):
            self.likeness = self._first.likeness(view, spectrum, shift)
        return Hypothesis(model, center, size, live.evidence_mean, live.likeness_mean)

    def _questionable(self, peak: float) -> bool:
        """Tell whether a place has to be verified that was found with such a peak."""
        return (self._snapshot is not None or self.likeness < _ALWAYS_GOOD
                or peak < _EVIDENCE_QUESTIONABLE * self.live.evidence_mean)

    def _bounded(self, size: Point) -> Point:
        """Bound a size, of the first one's aspect: who is out of sight may not drift far."""
        width, height = self._first_size
        factor = min(max(size[0] / width, _SMALLEST), _LARGEST)
        if self._snapshot is not None:
            known = self._snapshot.size[0] / width
            factor = min(max(factor, known / _DRIFT), known * _DRIFT)
        return factor * width, factor * height

    def _judge(self, before: Hypothesis, peak: float, dt: float) -> None:
        """Follow the usual evidence and likeness, or keep a snapshot when they break down."""
        if self._frames == 1:
            self.live = before = replace(
                self.live, evidence_mean=peak, likeness_mean=self.likeness)
        if self._latest_step is not None:
            # one step late: a tracker that turns the frame has put the centre right meanwhile
            start, duration = self._latest_step
            x, y = (0.7 * velocity + 0.3 * (now - then) / duration for velocity, now, then in zip(
                self._velocity, before.center, start))
            self._velocity = x, y
        evidence, likeness = before.evidence_mean, before.likeness_mean
        if peak < _EVIDENCE_TROUBLE * evidence or (
                self.likeness < min(_LIKENESS_TROUBLE * likeness, _ALWAYS_GOOD)):
            self._snapshot = before
            self._doubtful_looks = self._trusted_frames = self._jump_frames = 0
            self._doubtful_frames = dt
            self._latest_step = None
            return
        live = self.live
        self._latest_step = before.center, dt
        self.live = Hypothesis(
            live.model, live.center, live.size, evidence + _MEAN_RATE * (peak - evidence),
            likeness + _MEAN_RATE * (self.likeness - likeness))

    def _search(self, frame: Frame, peak: float, dt: float) -> bool:
        """Search with the snapshot; return whether it found the target elsewhere."""
        snapshot = self._snapshot
        assert snapshot is not None
        usual = self.live.evidence_mean
        self.live = replace(self.live, evidence_mean=usual + _MEAN_RATE * (peak - usual))
        self._doubtful_looks += 1
        self._doubtful_frames += dt
        level = snapshot.likeness_mean
        trusted = max(min(_TRUSTED_SHARE * level, _TRUSTED), EVEN_LIKENESS)
        plausible = self.likeness >= min(_PLAUSIBLE_SHARE * level, _PLAUSIBLE)
        self._trusted_frames = self._trusted_frames + 1 if self.likeness > trusted else 0
        changed = (self._doubtful_looks > _ACCEPTED_LOOKS and self.likeness > _ACCEPTED
                   and peak > 0.8 * usual)
        if self._trusted_frames >= _TRUSTED_FRAMES or changed:
            self._snapshot = None
            mean = self.likeness if changed else level
            self.live = replace(self.live, likeness_mean=mean)
            return False
        found = self._best_place(frame, snapshot)
        if found is None or found[0] < max(
                trusted, self.likeness + min(_JUMP_GAIN_SHARE * level, _JUMP_GAIN)):
            return False
        self._jump_frames += 1
        if plausible and self._jump_frames < _JUMP_FRAMES:
            return False
        self.likeness, center = found
        self.live = replace(snapshot, center=center)
        self._snapshot = None
        return True

    def _best_place(self, frame: Frame, snapshot: Hypothesis) -> tuple[float, Point] | None:
        """Return the likeness and the centre of the best verified place, if there is one."""
        best: tuple[float, Point] | None = None
        for place in self._places(frame, snapshot):
            sighting = look_for(snapshot, frame, place)
            if sighting.peak < _WORTH_VERIFYING * snapshot.evidence_mean:
                continue
            center = _inside(sighting.center, frame)
            away = np.abs(np.subtract(center, self.live.center)) > 0.3 * np.array(snapshot.size)
            if not away.any():
                continue
            view = snapshot.model.view(frame, center, snapshot.size)
            likeness = self._first.likeness(view, snapshot.model.transform(view))
            if best is None or likeness > best[0]:
                best = likeness, center
        return best

    def _places(self, frame: Frame, snapshot: Hypothesis) -> list[Point]:
        """Return the places to search in this frame."""
        looks, age = self._doubtful_looks, self._doubtful_frames
        places = []
        for turn in range(looks * self._searches, (looks + 1) * self._searches):
            if turn % 4 == 0:
                place = snapshot.center
            elif turn % 2 == 0:
                place = self._extrapolated(snapshot.center, min(age, _EXTRAPOLATED_FRAMES))
            elif looks > 8 and self._rng.random() < 0.5:
                place = self._coloured_place(frame, snapshot)
            else:
                spread = np.sqrt(snapshot.size[0] * snapshot.size[1]) * (0.5 + 0.15 * age)
                spread = min(spread, 0.5 * max(frame.shape[:2]))
                x, y = np.array(snapshot.center) + spread * self._rng.standard_normal(2)
                place = (x, y)
            places.append(_inside(place, frame))
        return places

    def _extrapolated(self, center: Point, frames: float) -> Point:
        return center[0] + frames * self._velocity[0], center[1] + frames * self._velocity[1]

    def _coloured_place(self, frame: Frame, snapshot: Hypothesis) -> Point:
        """Return a place anywhere in the frame that has the target's colours."""
        width, height = snapshot.size
        stride = max(1, int(min(width, height) / 6))
        colours = colour_index(np.ascontiguousarray(frame[::stride, ::stride]))
        probability = snapshot.model.foreground.probability(colours)
        colour = box_mean(probability, (max(1, int(width / stride)), max(1, int(height / stride))))
        # random weights, or one blob of the same colour would be searched again and again
        colour *= self._rng.uniform(0.7, 1.0, colour.shape).astype(np.float32)
        row, column = divmod(int(colour.argmax()), colour.shape[1])
        return float(column * stride), float(row * stride)


def _inside(center: Point, frame: Frame) -> Point:
    height, width = frame.shape[:2]
    return (float(min(max(center[0], 0.0), width - 1.0)),
            float(min(max(center[1], 0.0), height - 1.0)))
