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
from vtrack_ros.frame import Frame, Point
from vtrack_ros.geometry import Box

#: Columns of the sparse grid of pixels that tells of the whole image, at most twice as many.
_COLUMNS = 64
#: A grid with fewer rows or columns shows nothing.
_SMALLEST = 8
#: Share of the energy in the correlation's peak below which nothing is known; on the finer grid.
_RELIABLE, _FAR_RELIABLE = 0.45, 0.15

#: Columns of the finer grid on which the ground's points are followed, at most twice as many.
_FINE_COLUMNS = 128
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


class CameraMotion:
    """
    Measures the shift of the background by phase correlation [Kuglin and Hines 1975].

    Of every so manieth pixel, so that it costs the same in any frame.
    """

    def __init__(self, frame: Frame) -> None:
        pixels, self._stride = sparsely(frame, _COLUMNS)
        self._latest = np.ascontiguousarray(pixels, np.float32)
        rows, columns = self._latest.shape
        self._taper = np.outer(np.hanning(rows), np.hanning(columns)).astype(np.float32)

    def update(self, frame: Frame) -> Point | None:
        """Return by how much the picture moved since the last frame, in pixels, or None."""
        before = self._latest
        self._latest = np.ascontiguousarray(sparsely(frame, _COLUMNS)[0], np.float32)
        if min(before.shape) < _SMALLEST:
            return None
        (x, y), reliability = cv2.phaseCorrelate(before, self._latest, self._taper)
        if reliability < _RELIABLE:
            return None
        return x * self._stride, y * self._stride


class GroundMotion:
    """
    Measures to a part of a pixel how the ground about a target moved, or says nothing.

    Phase correlation is off by several pixels where much moves in the picture. Here points beside
    the target are followed [Lucas and Kanade 1981], the ground's where enough of them agree.
    """

    def __init__(self, frame: Frame) -> None:
        pixels, self._stride = sparsely(frame, _FINE_COLUMNS)
        self._before = self._latest = np.ascontiguousarray(pixels)
        rows, columns = self._latest.shape
        x, y = ((np.arange(points) + 0.5) / points * side
                for points, side in ((_ACROSS, columns), (_DOWN, rows)))
        self._taper = np.sqrt(np.outer(*(
            np.sin((np.arange(side) + 0.5) / side * np.pi) for side in (rows, columns))))
        self._points = np.stack(np.meshgrid(x, y), axis=-1).astype(np.float32).reshape(-1, 1, 2)

    def see(self, frame: Frame) -> None:
        """Take the next frame."""
        self._before = self._latest
        self._latest = np.ascontiguousarray(sparsely(frame, _FINE_COLUMNS)[0])

    def step(self, target: Box, far: bool = False) -> Point | None:
        """
        Return the ground's step between the last two frames, in pixels.

        The target was in that box of the former. Points are followed for an eighth of the picture;
        `far` beyond it, from where phase correlation of the whole picture says, which is believed
        alone if too few of them are still seen.
        """
        if min(self._before.shape) < _SMALLEST:
            return None
        stride = self._stride
        x, y = (place / stride for place in target.center)
        width, height = (_TARGETS * side / stride for side in (target.width, target.height))
        away = np.abs(self._points[:, 0] - np.array((x, y), np.float32))
        points = self._points[(away[:, 0] > width) | (away[:, 1] > height)]
        step = self._agreed(points, (0.0, 0.0))
        if step is not None or not far:
            return step
        (x, y), reliability = cv2.phaseCorrelate(
            self._alone(self._before), self._alone(self._latest))
        whole = (x * stride, y * stride) if reliability >= _FAR_RELIABLE else None
        return self._agreed(points, (x, y)) or whole

    def _alone(self, picture: Frame) -> NDArray[np.float32]:
        """Return a picture with as much of nothing beside it, so that a shift leads out of it."""
        rows, columns = picture.shape
        alone = np.zeros((2 * rows, 2 * columns), np.float32)
        alone[:rows, :columns] = (picture - picture.mean()) * self._taper
        return alone

    def _agreed(self, points: NDArray[np.float32], about: Point) -> Point | None:
        """Return the step that points agree on, [px]; it's looked for about one in samples."""
        if len(points) < _LEAST_POINTS:
            return None
        there, found = _followed(self._before, self._latest, points, _TEXTURE, about)
        steps = (there - points)[found, 0]
        count = len(steps)
        if count < _LEAST_POINTS:
            return None
        # their median: NumPy's own takes as long as all else here
        order = np.sort(steps, axis=0)
        apart = np.abs(steps - (order[(count - 1) // 2] + order[count // 2]) / 2)
        alike = steps[(apart[:, 0] < _ALIKE) & (apart[:, 1] < _ALIKE)]
        if len(alike) < max(_LEAST_POINTS, _SHARE * count):
            return None
        x, y = (alike.sum(axis=0) * (self._stride / len(alike))).tolist()
        return x, y


def sparsely(frame: Frame, columns: int) -> tuple[Frame, int]:
    """Return every so manieth pixel of a frame, at least so many columns, and the stride."""
    stride = max(1, frame.shape[1] // columns)
    pixels = frame[::stride, ::stride]
    return pixels[:, :, 1] if pixels.ndim == 3 else pixels, stride


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
        turned = (after[second] - after[first]) / (before[second] - before[first])
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
