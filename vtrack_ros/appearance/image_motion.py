"""How the whole image moved from one frame to the next, and how the target did."""

from __future__ import annotations

import cmath
from dataclasses import dataclass
from functools import cached_property, lru_cache
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.sampling import PixelWindow, turned
from vtrack_ros.frame import Array, Frame, Point
from vtrack_ros.geometry import Box

#: Columns of a sparse picture, and of the coarser one in it; at most twice as many.
_COLUMNS, _COARSE_COLUMNS = 128, 64
#: A picture with fewer rows or columns shows nothing.
_SMALLEST = 8
#: Share of the energy in the correlation's peak below which nothing is known; where it's far.
_RELIABLE, _FAR_RELIABLE = 0.45, 0.15

#: Points of the ground, across and down the image, and those about the target that may be parts of
#: it: as near as that to its middle, in sides.
_ACROSS, _DOWN, _TARGETS = 6, 5, 0.65
#: One of the ground shows nothing where its surroundings have less texture than that.
_TEXTURE = 1e-3
#: They agree where so many, and this share of those followed, went as near as that to their median
#: step, in samples.
_LEAST_POINTS, _SHARE, _ALIKE = 6, 0.4, 1.0

#: Points along each side of the target, and which share of it they cover.
_POINTS, _COVERED = 6, 0.9
_STEPS = _COVERED * ((np.arange(_POINTS) + 0.5) / _POINTS - 0.5)
#: The points, shape (N, 1, 2), from the target's centre, in sides.
_GRID = np.stack(np.meshgrid(_STEPS, _STEPS), axis=-1).reshape(-1, 1, 2)
#: Side of what is compared about a point, in samples, and halvings of the picture beside itself.
_WINDOW, _HALVINGS = 9, 2
#: A point is looked for in so many steps, or until one is so short, in samples.
_UNTIL = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 8, 0.03)
#: The least texture about a point [Shi and Tomasi 1994].
_LEAST_TEXTURE = 1e-4
#: A point is followed if it comes back as near as that to where it began, in samples.
_CAME_BACK = 1.0
#: A point moves with the target if it's as near as that to where the others say, in samples.
_AGREES = 0.5
#: Which share of all points has to be followed, and to agree about the growth.
_AGREEING = 0.5
#: By which logarithm a target grows in a frame, at least, to be told from noise, and at most.
_LEAST, _LARGEST = 0.01, 0.1
#: By which angle a target turns in a frame, likewise, [rad].
_LEAST_TURN, _LARGEST_TURN = 0.005, 0.5
#: They went together if of those followed this share is within that distance of their median
#: step, in sides.
_TOGETHER, _NEAR = 0.9, 0.1


@dataclass(frozen=True, eq=False)
class SparsePicture:
    """
    Every so manieth pixel of a frame, which tells how the whole image moved.

    Neighbours in `pixels` are `stride` pixels apart in the frame: large ones cost no more.
    """

    pixels: Frame
    stride: int

    @classmethod
    def of(cls, frame: Frame) -> SparsePicture:
        """Copy some of a frame's pixels; of colours the green."""
        stride = max(1, frame.shape[1] // _COLUMNS)
        pixels = frame[::stride, ::stride]
        return cls(np.ascontiguousarray(pixels[:, :, 1] if pixels.ndim == 3 else pixels), stride)

    def camera_step(self, later: SparsePicture) -> Point | None:
        """Return the background's step, [px], by phase correlation [Kuglin and Hines 1975]."""
        (before, stride), (after, _) = self._coarse, later._coarse
        if min(before.shape) < _SMALLEST:
            return None
        (x, y), reliability = cv2.phaseCorrelate(before, after, _hanning(*before.shape))
        return (x * stride, y * stride) if reliability >= _RELIABLE else None

    def ground_step(self, later: SparsePicture, target: Box, far: bool = False) -> Point | None:
        """
        Return the ground's step about a target until another picture, in pixels, or None.

        To a part of a pixel: points beside the target, which was in that box of the frame, are
        followed [Lucas and Kanade 1981], and the ground's are those where enough of them agree.
        They are for an eighth of the picture; `far` beyond it, from where phase correlation of the
        whole picture says, which is believed alone if too few of them are still seen.
        """
        if min(self.pixels.shape) < _SMALLEST:
            return None
        x, y = (place / self.stride for place in target.center)
        width, height = (_TARGETS * side / self.stride for side in (target.width, target.height))
        grid = _ground_points(*self.pixels.shape)
        away = np.abs(grid[:, 0] - np.array((x, y), np.float32))
        points = grid[(away[:, 0] > width) | (away[:, 1] > height)]
        step = self._agreed(later, points, (0.0, 0.0))
        if step is not None or not far:
            return step
        (x, y), reliability = cv2.phaseCorrelate(self._alone, later._alone)
        whole = (x * self.stride, y * self.stride) if reliability >= _FAR_RELIABLE else None
        return self._agreed(later, points, (x, y)) or whole

    @cached_property
    def _coarse(self) -> tuple[NDArray[np.float32], int]:
        """Return every so manieth of the pixels, and the stride in the frame."""
        every = max(1, self.pixels.shape[1] // _COARSE_COLUMNS)
        coarse = np.ascontiguousarray(self.pixels[::every, ::every], np.float32)
        return coarse, every * self.stride

    @property
    def _alone(self) -> NDArray[np.float32]:
        """Return the picture with as much of nothing beside it: a shift leads out of it."""
        rows, columns = self.pixels.shape
        alone = np.zeros((2 * rows, 2 * columns), np.float32)
        alone[:rows, :columns] = (self.pixels - self.pixels.mean()) * _half_sines(rows, columns)
        return alone

    def _agreed(self, later: SparsePicture, points: NDArray[np.float32],
                about: Point) -> Point | None:
        """Return the step that points agree on, [px]; it's looked for about one in samples."""
        if len(points) < _LEAST_POINTS:
            return None
        there, found = _followed(self.pixels, later.pixels, points, _TEXTURE, about)
        steps = (there - points)[found, 0]
        if (count := len(steps)) < _LEAST_POINTS:
            return None
        # their median: NumPy's own takes as long as all else here
        order = np.sort(steps, axis=0)
        apart = np.abs(steps - (order[(count - 1) // 2] + order[count // 2]) / 2)
        alike = steps[(apart[:, 0] < _ALIKE) & (apart[:, 1] < _ALIKE)]
        if len(alike) < max(_LEAST_POINTS, _SHARE * count):
            return None
        x, y = (alike.sum(axis=0) * (self.stride / len(alike))).tolist()
        return x, y


@lru_cache(maxsize=8)
def _hanning(rows: int, columns: int) -> NDArray[np.float32]:
    return np.outer(np.hanning(rows), np.hanning(columns)).astype(np.float32)


@lru_cache(maxsize=8)
def _half_sines(rows: int, columns: int) -> Array:
    across, down = (np.sin((np.arange(side) + 0.5) / side * np.pi) for side in (columns, rows))
    root: Array = np.sqrt(np.outer(down, across))
    return root


@lru_cache(maxsize=8)
def _ground_points(rows: int, columns: int) -> NDArray[np.float32]:
    """Return points all over a picture, in samples, shape (N, 1, 2)."""
    x, y = ((np.arange(points) + 0.5) / points * side
            for points, side in ((_ACROSS, columns), (_DOWN, rows)))
    return np.stack(np.meshgrid(x, y), axis=-1).astype(np.float32).reshape(-1, 1, 2)


@dataclass(frozen=True)
class TargetMotion:
    """
    What those of a target's points did that were followed from one frame to another.

    `before` and `after`, shape (N,), are where they were and are, in pixels, as complex numbers
    whose real part is x, of `points` all together. The target had that `side`, and the picture so
    many `samples` a pixel. The window that they are from was turned by that `angle`, [rad].
    """

    before: NDArray[np.complex128]
    after: NDArray[np.complex128]
    points: int
    side: float
    samples: float
    angle: float

    @cached_property
    def step(self) -> Point | None:
        """Return where the target went, in pixels, if nearly all of its points went together."""
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
        growth = None if self._similarity is None else abs(self._similarity)
        return growth if growth and _LEAST < abs(math.log(growth)) < _LARGEST else None

    @property
    def turn(self) -> float | None:
        """Return by which angle, [rad], the target turned, or None where that can't be told."""
        turn = None if self._similarity is None else cmath.phase(self._similarity)
        return turn if turn and _LEAST_TURN < abs(turn) < _LARGEST_TURN else None

    @cached_property
    def _similarity(self) -> complex | None:
        """
        Return the factor and the rotation, as one number, of how the target moved.

        Of the similarity transform that most points agree on: a consensus over pairs of
        points that are far apart on the grid, always the same ones [Fischler and Bolles 1981], and
        a least-squares fit to those that agree. OpenCV's own differs between its versions.
        """
        if self._few:
            return None
        before, after = self.before, self.after
        first, second = _pairs(len(before))
        between = before[second] - before[first]
        # points of a narrow target may fall together: such a pair says that it hasn't grown
        turned = np.divide(after[second] - after[first], between, out=np.ones_like(between),
                           where=between != 0)
        moved = after[first] - turned * before[first]
        away = np.abs(turned[:, None] * before + moved[:, None] - after)
        agree = away < _AGREES / self.samples
        agrees = agree[int(agree.sum(axis=1).argmax())]
        if agrees.sum() < _AGREEING * self.points:
            return None
        own, its = (places[agrees] - places[agrees].mean() for places in (before, after))
        return complex(np.vdot(own, its) / np.vdot(own, own).real)

    @property
    def _few(self) -> bool:
        return len(self.before) < _AGREEING * self.points


@dataclass(frozen=True)
class TargetFlow:
    """
    Tells how a target moved between two frames, from how its own points did.

    The filters know what a target looks like, but only where it is in a noisy picture of it, and
    its size in one frame of a few. Optical flow knows nothing of looks and sizes, but tells a
    change of place and size from frame to frame. Points on a grid over the target are followed
    [Lucas and Kanade 1981], there and back [Kalal et al. 2010]. Where most of them went the same
    way, so did the target; and the similarity transform that most of them agree on tells its
    growth. Where fewer than half are followed, nothing is known.

    It's made of what was seen in the first of the two: a grey picture of a part of the frame, and
    which part; in it the target, whose centre and size are in pixels of the frame.
    """

    picture: Frame
    window: PixelWindow
    center: Point
    size: Point

    def motion(self, frame: Frame) -> TargetMotion:
        """Return how the target moved until another frame."""
        rows, columns = self.picture.shape
        window = self.window
        samples = columns / window.width, rows / window.height
        # to a quarter of a sample: places that differ by rounding alone have the same flow
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
        followed = found & returned & (away < _CAME_BACK)
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


def _followed(before: Frame, after: Frame, points: NDArray[np.float32],
              least_texture: float = _LEAST_TEXTURE, about: Point = (0.0, 0.0),
              ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return where points, shape (N, 1, 2), of a picture are in another, and which are found."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, points, points + np.array(about, np.float32), winSize=(_WINDOW, _WINDOW),
        maxLevel=_HALVINGS, criteria=_UNTIL, minEigThreshold=least_texture,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW)
    return there, found[:, 0] > 0
