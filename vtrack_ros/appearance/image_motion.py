"""Motion of the ground and of the target between two frames: phase correlation, optical flow."""

from __future__ import annotations

import cmath
from dataclasses import dataclass
from functools import cached_property, lru_cache
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.sampling import PixelWindow, turned
from vtrack_ros.frame import Array, Array32, Frame, Point
from vtrack_ros.geometry import Box

#: Columns and rows of a sparse picture, and of the coarse one made of it: at most twice as many.
_COLUMNS, _COARSE_COLUMNS = 128, 64
_ROWS, _COARSE_ROWS = 1024, 512
#: Least rows and columns of a picture; in a smaller one no motion is measured.
_SMALLEST = 8
#: Least share of energy in the phase correlation's peak: in `camera_step`, in `ground_step`.
_RELIABLE, _FAR_RELIABLE = 0.45, 0.15

#: Grid of ground points: columns, rows; and half the size, in target sides, of the area about the
#: target's centre whose points are left out, as they may be on the target.
_ACROSS, _DOWN, _TARGET_REACH = 6, 5, 0.65
#: Lower bound of the texture (least eigenvalue) about a ground point.
_TEXTURE = 1e-3
#: Consensus of the ground points: least number of inliers, least share of inliers among the points
#: followed, and an inlier's largest deviation from their median step in x and y, in samples.
_LEAST_POINTS, _GROUND_SHARE, _GROUND_INLIER = 6, 0.4, 1.0

#: Grid of target points: number along each side, and the share of the side that its cells cover.
_POINTS, _COVERED = 6, 0.9
_STEPS = _COVERED * ((np.arange(_POINTS) + 0.5) / _POINTS - 0.5)
#: The points, shape (N, 1, 2), from the target's centre, in sides.
_GRID = np.stack(np.meshgrid(_STEPS, _STEPS), axis=-1).reshape(-1, 1, 2)
#: Lucas-Kanade: side of the window about a point, in samples; pyramid levels above the picture.
_WINDOW, _HALVINGS = 9, 2
#: Termination of Lucas-Kanade: iterations, and step, in samples, below which it has converged.
_UNTIL = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 8, 0.03)
#: Lower bound of the texture (least eigenvalue) about a target point [Shi and Tomasi 1994].
_LEAST_TEXTURE = 1e-4
#: Upper bound of the forward-backward error of a point that counts as followed, in samples.
_RETURN_ERROR = 1.0
#: Upper bound of an inlier's distance from its place by the similarity transform, in samples;
#: least share of all target points that have to be followed, and to be inliers.
_INLIER_DISTANCE, _LEAST_AGREEING = 0.5, 0.5
#: Bounds of |log growth| in a frame: less can't be told from noise, more isn't believed.
_LEAST_GROWTH, _LARGEST_GROWTH = 0.01, 0.1
#: Bounds of |rotation| in a frame, likewise, [rad].
_LEAST_TURN, _LARGEST_TURN = 0.005, 0.5
#: Target points moved together if at least this share of those followed is within this distance,
#: in target sides, of their median step.
_TOGETHER, _NEAR = 0.9, 0.1


@dataclass(frozen=True, eq=False)
class SparsePicture:
    """
    A frame subsampled to every `stride`-th pixel, to measure how the whole image moved.

    The cost doesn't grow with the size of the frame.
    """

    pixels: Frame
    stride: int

    @classmethod
    def of(cls, frame: Frame) -> SparsePicture:
        """Subsample a frame into an array of its own; of a colour frame only the green channel."""
        stride = max(1, frame.shape[1] // _COLUMNS, frame.shape[0] // _ROWS)
        pixels = frame[::stride, ::stride]
        return cls(np.array(pixels[:, :, 1] if pixels.ndim == 3 else pixels, order='C'), stride)

    def camera_step(self, later: SparsePicture) -> Point | None:
        """Return the background's step, [px], by phase correlation [Kuglin and Hines 1975]."""
        (before, stride), (after, _) = self._coarse, later._coarse
        if min(before.shape) < _SMALLEST:
            return None
        (x, y), reliability = cv2.phaseCorrelate(before, after, _hanning(*before.shape))
        return (x * stride, y * stride) if reliability >= _RELIABLE else None

    def ground_step(self, later: SparsePicture, target: Box, far: bool = False) -> Point | None:
        """
        Return the ground's step about a target to a later picture, [px], or None if unknown.

        Points beside `target`, its box in this frame, are followed with subpixel accuracy [Lucas
        and Kanade 1981]; the step is the mean of those that agree. That works up to an eighth of
        the picture. If too few agree and `far` is set, they are followed again from the step by
        phase correlation of the whole picture; if too few agree again, that step is returned.
        """
        if min(self.pixels.shape) < _SMALLEST:
            return None
        x, y = (place / self.stride for place in target.center)
        width, height = (_TARGET_REACH * side / self.stride
                         for side in (target.width, target.height))
        grid = _ground_points(*self.pixels.shape)
        away = np.abs(grid[:, 0] - np.array((x, y), np.float32))
        points = grid[(away[:, 0] > width) | (away[:, 1] > height)]
        step = self._agreed(later, points, (0.0, 0.0))
        if step is not None or not far:
            return step
        (x, y), reliability = cv2.phaseCorrelate(self._padded, later._padded)
        whole = (x * self.stride, y * self.stride) if reliability >= _FAR_RELIABLE else None
        return self._agreed(later, points, (x, y)) or whole

    @cached_property
    def _coarse(self) -> tuple[Array32, int]:
        """Return the pixels, subsampled again, and their stride; OpenCV may change them."""
        rows, columns = self.pixels.shape
        every = max(1, columns // _COARSE_COLUMNS, rows // _COARSE_ROWS)
        coarse = np.ascontiguousarray(self.pixels[::every, ::every], np.float32)
        return coarse, every * self.stride

    @property
    def _padded(self) -> Array32:
        """Return the windowed picture, zero-padded to twice its sides: no shift wraps around."""
        rows, columns = self.pixels.shape
        padded = np.zeros((2 * rows, 2 * columns), np.float32)
        padded[:rows, :columns] = (self.pixels - self.pixels.mean()) * _half_sines(rows, columns)
        return padded

    def _agreed(self, later: SparsePicture, points: Array32, about: Point) -> Point | None:
        """Return the step that points agree on, [px]; `about` is its first guess, in samples."""
        if len(points) < _LEAST_POINTS:
            return None
        there, found = _followed(self.pixels, later.pixels, points, _TEXTURE, about)
        steps = (there - points)[found, 0]
        if (count := len(steps)) < _LEAST_POINTS:
            return None
        # the median by hand: NumPy's function takes as long as all the rest here
        order = np.sort(steps, axis=0)
        apart = np.abs(steps - (order[(count - 1) // 2] + order[count // 2]) / 2)
        alike = steps[(apart[:, 0] < _GROUND_INLIER) & (apart[:, 1] < _GROUND_INLIER)]
        if len(alike) < max(_LEAST_POINTS, _GROUND_SHARE * count):
            return None
        x, y = (alike.sum(axis=0) * (self.stride / len(alike))).tolist()
        return x, y


@lru_cache(maxsize=8)
def _hanning(rows: int, columns: int) -> Array32:
    return np.outer(np.hanning(rows), np.hanning(columns)).astype(np.float32)


@lru_cache(maxsize=8)
def _half_sines(rows: int, columns: int) -> Array:
    across, down = (np.sin((np.arange(side) + 0.5) / side * np.pi) for side in (columns, rows))
    root: Array = np.sqrt(np.outer(down, across))
    return root


@lru_cache(maxsize=8)
def _ground_points(rows: int, columns: int) -> Array32:
    """Return points all over a picture, in samples, shape (N, 1, 2)."""
    x, y = ((np.arange(points) + 0.5) / points * side
            for points, side in ((_ACROSS, columns), (_DOWN, rows)))
    return np.stack(np.meshgrid(x, y), axis=-1).astype(np.float32).reshape(-1, 1, 2)


@dataclass(frozen=True)
class TargetMotion:
    """
    The motion of those points of a target that were followed from one frame to another.

    `before` and `after`, shape (N,), are their places in the window, [px], as complex numbers with
    x as the real part; `points` is the number tried. `side` is the target's mean side, [px],
    `samples` the picture's samples per pixel, `angle` the window's rotation, [rad].
    """

    before: NDArray[np.complex128]
    after: NDArray[np.complex128]
    points: int
    side: float
    samples: float
    angle: float

    @cached_property
    def step(self) -> Point | None:
        """Return the target's step, in pixels, if nearly all of its points moved together."""
        if self._few:
            return None
        steps = self.after - self.before
        middle = complex(np.median(steps.real), np.median(steps.imag))
        near = np.abs(steps - middle) < _NEAR * self.side
        if near.mean() < _TOGETHER:
            return None
        mean = cmath.rect(1.0, self.angle) * complex(steps[near].mean())
        return mean.real, mean.imag

    @property
    def growth(self) -> float | None:
        """Return by which factor the target grew, or None where that can't be told."""
        scale = None if self._similarity is None else abs(self._similarity)
        return scale if scale and _LEAST_GROWTH < abs(math.log(scale)) < _LARGEST_GROWTH else None

    @property
    def turn(self) -> float | None:
        """Return by which angle, [rad], the target turned, or None where that can't be told."""
        turn = None if self._similarity is None else cmath.phase(self._similarity)
        return turn if turn and _LEAST_TURN < abs(turn) < _LARGEST_TURN else None

    @cached_property
    def _similarity(self) -> complex | None:
        """
        Return the target's scale factor and rotation as one complex number, or None.

        They are those of the similarity transform that most points agree on: a consensus [Fischler
        and Bolles 1981] over a fixed set of pairs of points that are far apart on the grid, and a
        least-squares fit to the inliers. OpenCV's own estimator differs between its versions.
        """
        if self._few:
            return None
        before, after = self.before, self.after
        first, second = _pairs(len(before))
        between = before[second] - before[first]
        # points of a narrow target may coincide: such a pair counts as no growth, no rotation
        turned = np.divide(after[second] - after[first], between, out=np.ones_like(between),
                           where=between != 0)
        moved = after[first] - turned * before[first]
        away = np.abs(turned[:, None] * before + moved[:, None] - after)
        agree = away < _INLIER_DISTANCE / self.samples
        agrees = agree[int(agree.sum(axis=1).argmax())]
        if agrees.sum() < _LEAST_AGREEING * self.points:
            return None
        own, its = (places[agrees] - places[agrees].mean() for places in (before, after))
        return complex(np.vdot(own, its) / np.vdot(own, own).real)

    @property
    def _few(self) -> bool:
        return len(self.before) < _LEAST_AGREEING * self.points


@dataclass(frozen=True)
class TargetFlow:
    """
    Measures a target's motion between two frames by optical flow of points on it.

    The filters know a target's appearance, but measure its place with noise, and its size only in
    one frame of a few. Optical flow knows nothing of appearance, but measures changes of place and
    size from frame to frame. Points on a grid over the target are followed [Lucas and Kanade 1981]
    forward and backward [Kalal et al. 2010]. Where nearly all of them made the same step, so did
    the target; the similarity transform that most of them agree on gives its growth and rotation.
    Where fewer than half are followed, nothing is known.

    `picture` is a grey image of the part `window` of the first frame; `center` and `size` are the
    target's there, in pixels of the frame.
    """

    picture: Frame
    window: PixelWindow
    center: Point
    size: Point

    def motion(self, frame: Frame) -> TargetMotion:
        """Return the target's motion from the first frame to this one."""
        rows, columns = self.picture.shape
        window = self.window
        samples = columns / window.width, rows / window.height
        # rounded to a quarter of a sample, so that rounding errors of places don't change the flow
        x, y = turned((self.center[0] - window.center[0], self.center[1] - window.center[1]),
                      -window.angle)
        middle = np.array([x + window.width / 2, y + window.height / 2])
        points = np.rint(4 * (middle + _GRID * self.size) * samples) / 4 - 0.5
        before = points.astype(np.float32)
        pixels = window.sampled(frame, rows, columns)
        now = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels
        there, found = _followed(self.picture, now, before)
        back, returned = _followed(now, self.picture, there)
        away = np.abs(_complex(back - before))
        followed = found & returned & (away < _RETURN_ERROR)
        then, after = (_complex(places[followed] / samples) for places in (before, there))
        return TargetMotion(then, after, len(points), math.sqrt(math.prod(self.size)),
                            math.sqrt(math.prod(samples)), window.angle)


def _complex(points: NDArray[np.floating]) -> NDArray[np.complex128]:
    """Return points, shape (N, 1, 2), as complex numbers, shape (N,): x is the real part."""
    return np.ascontiguousarray(points, np.float64).view(np.complex128).reshape(-1)


@lru_cache(maxsize=64)
def _pairs(count: int) -> NDArray[np.intp]:
    """Return pairs of points that are far apart on the grid, shape (2, pairs)."""
    return np.concatenate([
        np.stack([np.arange(count - step), np.arange(step, count)])
        for step in (count // 4, count // 3, count // 2)], axis=1)


def _followed(before: Frame, after: Frame, points: Array32, least_texture: float = _LEAST_TEXTURE,
              about: Point = (0.0, 0.0)) -> tuple[Array32, NDArray[np.bool_]]:
    """Return the places in `after` of points, shape (N, 1, 2), in `before`; which are found."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, points, points + np.array(about, np.float32), winSize=(_WINDOW, _WINDOW),
        maxLevel=_HALVINGS, criteria=_UNTIL, minEigThreshold=least_texture,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
    return there, found[:, 0] > 0
