"""By which factor a target grew from one frame to the next: by the optical flow of its points."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.features import PixelWindow
from vtrack_ros.frame import Frame, Point

#: Side of the target in the picture that is compared, in samples, at most, and how much is about
#: it on all sides together, in sides: points may move that far.
_SIDE, _AROUND = 48, 1.5
#: A picture has so many samples along a side at least.
_SMALLEST = 16
#: Points along each side of the target, and which share of it they cover.
_POINTS, _COVERED = 8, 0.9
#: Side of what is compared about a point, in samples, and halvings of the picture beside itself.
_WINDOW, _HALVINGS = 9, 2
#: A point is followed if it comes back as near as that to where it began, in samples.
_CAME_BACK = 1.0
#: A point moves with the target if it's as near as that to where the others say, in samples.
_AGREES = 0.5
#: Which share of all points has to.
_AGREEING = 0.5
#: By which logarithm a target grows in a frame, at least, to be told from noise, and at most.
_LEAST, _LARGEST = 0.01, 0.1


class TargetFlow:
    """
    Tells by how much a target grew between two frames, from how its own points moved apart.

    The scale regression knows how large a target is, but from noisy pictures of it, one in a few
    frames. Optical flow knows nothing of sizes, but tells a change of size from frame to frame,
    and so follows what grows quickly. Points on a grid over the target are followed
    [Lucas and Kanade 1981], there and back [Kalal et al. 2010], and the similarity transform that
    most of them agree on is the target's motion. Where fewer than half do, it's nothing that
    moved as a whole, and nothing is known.
    """

    def __init__(self, frame: Frame, center: Point, size: Point) -> None:
        self.remember(frame, center, size)

    def remember(self, frame: Frame, center: Point, size: Point) -> None:
        """Keep a picture of the target, its centre and (width, height) in pixels."""
        side = math.sqrt(math.prod(size))
        around = _AROUND * side
        window = PixelWindow.about(center, (size[0] + around, size[1] + around))
        zoom = min(1.0, _SIDE / side)
        self._window = window
        self._rows, self._columns = (
            max(_SMALLEST, round(zoom * length)) for length in (window.height, window.width))
        self._picture = self._sampled(frame)
        # about the picture's middle, to a quarter of a sample: places that differ by rounding
        # alone have the same flow
        steps = _COVERED * ((np.arange(_POINTS) + 0.5) / _POINTS - 0.5)
        x, y = (np.rint(4 * samples * (0.5 + steps * length / (length + around))) / 4 - 0.5
                for samples, length in zip((self._columns, self._rows), size))
        self._points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 1, 2).astype(np.float32)

    def growth(self, frame: Frame) -> float | None:
        """Return by which factor the target is larger than remembered; None if it can't tell."""
        now, points = self._sampled(frame), self._points
        there, found = _followed(self._picture, now, points)
        back, returned = _followed(now, self._picture, there)
        away = np.hypot(*(back - points)[:, 0].T)
        followed = found & returned & (away < _CAME_BACK)
        if followed.mean() < _AGREEING:
            return None
        growth, agreeing = _scale(_complex(points[followed]), _complex(there[followed]))
        if agreeing < _AGREEING * len(points):
            return None
        return growth if _LEAST < abs(math.log(max(growth, 1e-6))) < _LARGEST else None

    def _sampled(self, frame: Frame) -> Frame:
        pixels = self._window.sampled(frame, self._rows, self._columns)
        return cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels


def _complex(points: NDArray[np.float32]) -> NDArray[np.complex128]:
    """Return points, shape (N, 1, 2), as complex numbers, shape (N,): x is the real part."""
    return points.astype(np.float64).view(np.complex128).reshape(-1)


def _scale(before: NDArray[np.complex128], after: NDArray[np.complex128]) -> tuple[float, int]:
    """
    Return the scale of the similarity transform that most points agree on, and how many do.

    A consensus over pairs of points that are far apart on the grid, always the same ones [Fischler
    and Bolles 1981], and a least-squares fit to those that agree. OpenCV's own differs between
    its versions.
    """
    count = len(before)
    first, second = np.concatenate([
        np.stack([np.arange(count - step), np.arange(step, count)])
        for step in (count // 4, count // 3, count // 2)], axis=1)
    turned = (after[second] - after[first]) / (before[second] - before[first])
    moved = after[first] - turned * before[first]
    agree = np.abs(turned[:, None] * before + moved[:, None] - after) < _AGREES
    agrees = agree[int(agree.sum(axis=1).argmax())]
    own, its = (points[agrees] - points[agrees].mean() for points in (before, after))
    return float(abs(np.vdot(own, its)) / np.vdot(own, own).real), int(agrees.sum())


def _followed(before: Frame, after: Frame, points: NDArray[np.float32],
              ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return where points, shape (N, 1, 2), of one picture are in another, and which are found."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, points, None, winSize=(_WINDOW, _WINDOW), maxLevel=_HALVINGS)
    return there, found[:, 0] > 0
