"""A target told from its surroundings: localised, doubted, searched for and found again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.correlation import Spectrum, subcell_offset, subcell_peak
from vtrack_ros.appearance.foreground import box_mean
from vtrack_ros.appearance.target import Point, TargetModel, View
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.trackers.base import Estimate, TrackState

#: Trouble is when the evidence or the likeness falls below these shares of their running means.
_EVIDENCE_TROUBLE = 0.7
_LIKENESS_TROUBLE = 0.6
#: The running means are slow, or they would get used to an occluder.
_MEAN_RATE = 0.03
#: Likeness, as a share of its mean before the trouble: implausible below, trusted above.
_IMPLAUSIBLE = 0.35
_TRUSTED = 0.6
#: Frames of trusted likeness that end the trouble.
_TRUSTED_FRAMES = 5
#: Frames after which a target that looks different, but is seen well, is taken for changed.
_ACCEPTED_FRAMES = 40
#: A jump needs this much more likeness, and that often while the present place is plausible.
_JUMP_GAIN = 0.1
_JUMP_FRAMES = 3
#: A place is worth verifying where the evidence has this share of its mean.
_WORTH_VERIFYING = 0.5
#: The scale changes slowly: it's looked at in every second frame.
_SCALE_EVERY = 2
#: Likeness at which on and off the target are even, and the width of the transition. On the target
#: 95 % of all likenesses are above 0.10, off it 90 % are below 0.09.
_EVEN_LIKENESS, _LIKENESS_SPREAD = 0.09, 0.02
_LOST_FRAMES = 30
#: Standard deviations of centre and size that no filter knows of, as shares of the mean side.
_CENTER_ERROR, _SIZE_ERROR = 0.06, 0.09
_SMALLEST, _LARGEST = 0.2, 5.0


@dataclass(frozen=True)
class Hypothesis:
    """
    One belief about the target; a snapshot of it is the object itself.

    Parameters
    ----------
    model : TargetModel
        The model.
    center, size : tuple of float, [px]
        The centre and the size.
    evidence_mean, likeness_mean : float
        What's usual for this target.

    """

    model: TargetModel
    center: Point
    size: Point
    evidence_mean: float
    likeness_mean: float


@dataclass(frozen=True)
class Sighting:
    """
    What a window of a frame says about the target's place.

    Parameters
    ----------
    view : View
        The window that was looked at.
    spectrum : ndarray of complex64
        Of the example.
    evidence : ndarray of float32, shape (rows, columns)
        The view's centre is at [rows // 2, columns // 2].
    peak : float
        The highest evidence.
    center : tuple of float, [px]
        Where it is.
    cell : tuple of float, [px]
        A cell's size.

    """

    view: View
    spectrum: Spectrum
    evidence: NDArray[np.float32]
    peak: float
    center: Point
    cell: Point

    def cells(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points, shape (N, 2) in pixels, in cells of the evidence map."""
        rows, columns = self.evidence.shape
        result: NDArray[np.float64] = (points - self.view.center) / self.cell + (
            columns // 2, rows // 2)
        return result

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the evidence at points, shape (N, 2) in pixels; 0 beyond the window."""
        cells = self.cells(points).astype(np.float32)
        values = cv2.remap(self.evidence, cells[None, :, 0], cells[None, :, 1],
                           cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        result: NDArray[np.float64] = values[0].astype(np.float64)
        return result

    def climb(self, start: Point) -> Point:
        """Return the local maximum of the evidence that is uphill from a place, in pixels."""
        rows, columns = self.evidence.shape
        x, y = self.cells(np.array([start]))[0]
        column, row = (int(min(max(round(value), 0), size - 1))
                       for value, size in ((x, columns), (y, rows)))
        while True:
            top, left = max(0, row - 2), max(0, column - 2)
            near = self.evidence[top:row + 3, left:column + 3]
            up, across = divmod(int(near.argmax()), near.shape[1])
            if (top + up, left + across) == (row, column):
                break
            row, column = top + up, left + across
        x, y = subcell_offset(self.evidence, row, column)
        return (self.view.center[0] + (column + x - columns // 2) * self.cell[0],
                self.view.center[1] + (row + y - rows // 2) * self.cell[1])


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
        self._first = model
        self.live = Hypothesis(model, center, size, 1.0, 1.0)
        self._first_size = size
        self._snapshot: Hypothesis | None = None
        self._velocity = np.zeros(2)
        self._frames = 0
        self._doubtful_frames = self._trusted_frames = self._jump_frames = 0
        self.out_of_sight_frames = 0
        self.likeness = 1.0

    @property
    def state(self) -> TrackState:
        """Whether the target is in sight."""
        if self.lost:
            return TrackState.LOST
        return TrackState.SEARCHING if self.out_of_sight_frames else TrackState.TRACKING

    @property
    def confidence(self) -> float:
        """How sure it is that the live place is the target's, in [0, 1]."""
        return float(1 / (1 + np.exp(-(self.likeness - _EVEN_LIKENESS) / _LIKENESS_SPREAD)))

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
        side = np.sqrt(box.area)
        growth = 1 + self.out_of_sight_frames
        floor = np.array([_CENTER_ERROR, _CENTER_ERROR, _SIZE_ERROR, _SIZE_ERROR]) * side
        return Estimate(
            box=box, angle=angle, covariance=covariance + growth * np.diag(floor**2),
            confidence=self.confidence, state=self.state, particles=particles, affine=affine)

    @property
    def doubtful(self) -> bool:
        """Tell whether the live belief is in trouble."""
        return self._snapshot is not None

    @property
    def lost(self) -> bool:
        """Tell whether the target is out of sight for long."""
        return self.out_of_sight_frames > _LOST_FRAMES

    def look(self, frame: Frame, center: Point) -> Sighting:
        """Look for the target about a place, in pixels, with the live model."""
        return _sighting(self.live, frame, center)

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
            Whether the target was found again elsewhere: `live.center` is not `center` then.

        """
        before = self.live
        center = _inside(center, frame)
        self.live = self._learn(frame, sighting, center)
        if self._snapshot is None:
            self._judge(before, sighting.peak, dt)
            found = False
        else:
            found = self._search(frame, sighting.peak, dt)
        seen = self.likeness >= _EVEN_LIKENESS
        self.out_of_sight_frames = 0 if seen else self.out_of_sight_frames + 1
        return found

    def _learn(self, frame: Frame, sighting: Sighting, center: Point) -> Hypothesis:
        live, view, spectrum = self.live, sighting.view, sighting.spectrum
        model = live.model
        shift = ((center[0] - view.center[0]) / sighting.cell[0],
                 (center[1] - view.center[1]) / sighting.cell[1])
        size = live.size
        self._frames += 1
        if self._frames % _SCALE_EVERY == 0:
            factor, steps, scales = model.growth(view, shift)
            size = _bounded((view.size[0] * factor, view.size[1] * factor), self._first_size)
            model = model.learned_scale(scales, steps)
        if not model.is_centred(shift):
            view = model.view(frame, center, size)
            spectrum, shift = model.transform(view), (0.0, 0.0)
        model = model.learned(view, spectrum, shift)
        self.likeness = self._first.likeness(spectrum, shift)
        return replace(live, model=model, center=center, size=size)

    def _judge(self, before: Hypothesis, peak: float, dt: float) -> None:
        """Follow the usual evidence and likeness, or keep a snapshot when they break down."""
        if self._frames == 1:
            self.live = before = replace(
                self.live, evidence_mean=peak, likeness_mean=self.likeness)
        evidence, likeness = before.evidence_mean, before.likeness_mean
        if peak < _EVIDENCE_TROUBLE * evidence or self.likeness < _LIKENESS_TROUBLE * likeness:
            self._snapshot = before
            self._doubtful_frames = self._trusted_frames = self._jump_frames = 0
            return
        step = np.subtract(self.live.center, before.center) / dt
        self._velocity = 0.7 * self._velocity + 0.3 * step
        self.live = replace(
            self.live, evidence_mean=evidence + _MEAN_RATE * (peak - evidence),
            likeness_mean=likeness + _MEAN_RATE * (self.likeness - likeness))

    def _search(self, frame: Frame, peak: float, dt: float) -> bool:
        """Search with the snapshot; return whether it found the target elsewhere."""
        snapshot = self._snapshot
        assert snapshot is not None
        usual = self.live.evidence_mean
        self.live = replace(self.live, evidence_mean=usual + _MEAN_RATE * (peak - usual))
        self._doubtful_frames += 1
        relative = self.likeness / snapshot.likeness_mean
        self._trusted_frames = self._trusted_frames + 1 if relative > _TRUSTED else 0
        changed = (self._doubtful_frames > _ACCEPTED_FRAMES and relative >= _IMPLAUSIBLE
                   and peak > 0.8 * usual)
        if self._trusted_frames >= _TRUSTED_FRAMES or changed:
            self._snapshot = None
            mean = self.likeness if changed else snapshot.likeness_mean
            self.live = replace(self.live, likeness_mean=mean)
            return False
        found = self._best_place(frame, snapshot)
        if found is None or found[0] < max(
                _TRUSTED * snapshot.likeness_mean,
                self.likeness + _JUMP_GAIN * snapshot.likeness_mean):
            return False
        self._jump_frames += 1
        if relative >= _IMPLAUSIBLE and self._jump_frames < _JUMP_FRAMES:
            return False
        self.likeness, center = found
        self.live = replace(snapshot, center=center)
        self._snapshot = None
        return True

    def _best_place(self, frame: Frame, snapshot: Hypothesis) -> tuple[float, Point] | None:
        """Return the likeness and the centre of the best verified place, if there is one."""
        best: tuple[float, Point] | None = None
        for place in self._places(frame, snapshot):
            sighting = _sighting(snapshot, frame, place)
            if sighting.peak < _WORTH_VERIFYING * snapshot.evidence_mean:
                continue
            center = _inside(sighting.center, frame)
            away = np.abs(np.subtract(center, self.live.center)) > 0.3 * np.array(snapshot.size)
            if not away.any():
                continue
            view = snapshot.model.view(frame, center, snapshot.size)
            likeness = self._first.likeness(snapshot.model.transform(view))
            if best is None or likeness > best[0]:
                best = likeness, center
        return best

    def _places(self, frame: Frame, snapshot: Hypothesis) -> list[Point]:
        """Return the places to search in this frame."""
        age = self._doubtful_frames
        places = []
        for turn in range(age * self._searches, (age + 1) * self._searches):
            if turn % 2 == 0:
                drift = 0.5 * min(age, 10) * self._velocity
                place = (snapshot.center[0] + drift[0], snapshot.center[1] + drift[1])
            elif age > 8 and self._rng.random() < 0.5:
                place = self._coloured_place(frame, snapshot)
            else:
                spread = np.sqrt(snapshot.size[0] * snapshot.size[1]) * (0.5 + 0.15 * age)
                spread = min(spread, 0.5 * max(frame.shape[:2]))
                x, y = np.array(snapshot.center) + spread * self._rng.standard_normal(2)
                place = (x, y)
            places.append(_inside(place, frame))
        return places

    def _coloured_place(self, frame: Frame, snapshot: Hypothesis) -> Point:
        """Return a place anywhere in the frame that has the target's colours."""
        width, height = snapshot.size
        stride = max(1, int(min(width, height) / 6))
        pixels = np.ascontiguousarray(frame[::stride, ::stride])
        probability = snapshot.model.foreground.probability(pixels)
        colour = box_mean(probability, (max(1, int(width / stride)), max(1, int(height / stride))))
        # random weights, or one blob of the same colour would be searched again and again
        colour *= self._rng.uniform(0.7, 1.0, colour.shape).astype(np.float32)
        row, column = divmod(int(colour.argmax()), colour.shape[1])
        return float(column * stride), float(row * stride)


def _sighting(hypothesis: Hypothesis, frame: Frame, center: Point) -> Sighting:
    model = hypothesis.model
    view = model.view(frame, center, hypothesis.size)
    spectrum = model.transform(view)
    evidence = model.evidence(view, spectrum)
    peak, x, y = subcell_peak(evidence)
    cell = model.layout.cell(view.size)
    place = (view.center[0] + (x - model.layout.columns // 2) * cell[0],
             view.center[1] + (y - model.layout.rows // 2) * cell[1])
    return Sighting(view, spectrum, evidence, peak, place, cell)


def _inside(center: Point, frame: Frame) -> Point:
    height, width = frame.shape[:2]
    return (float(min(max(center[0], 0.0), width - 1.0)),
            float(min(max(center[1], 0.0), height - 1.0)))


def _bounded(size: Point, first: Point) -> Point:
    """Bound a size to a range about the first size; the aspect is the first one's."""
    factor = min(max(size[0] / first[0], _SMALLEST), _LARGEST)
    return factor * first[0], factor * first[1]
