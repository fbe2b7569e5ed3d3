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
        steps = _COVERED * ((np.arange(_POINTS) + 0.5) / _POINTS - 0.5)
        x = (center[0] - window.left + steps * size[0]) * self._columns / window.width - 0.5
        y = (center[1] - window.top + steps * size[1]) * self._rows / window.height - 0.5
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
        similarity, agreeing = cv2.estimateAffinePartial2D(
            points[followed], there[followed], method=cv2.RANSAC, ransacReprojThreshold=_AGREES)
        if similarity is None or agreeing.sum() < _AGREEING * len(points):
            return None
        growth = math.hypot(similarity[0, 0], similarity[1, 0])
        return growth if _LEAST < abs(math.log(max(growth, 1e-6))) < _LARGEST else None

    def _sampled(self, frame: Frame) -> Frame:
        pixels = self._window.sampled(frame, self._rows, self._columns)
        return cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels


def _followed(before: Frame, after: Frame, points: NDArray[np.float32],
              ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return where points, shape (N, 1, 2), of one picture are in another, and which are found."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, points, None, winSize=(_WINDOW, _WINDOW), maxLevel=_HALVINGS)
    return there, found[:, 0] > 0
