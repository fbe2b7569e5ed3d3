"""A discriminative target that's shown to its model upright, however it has turned."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import affine
from vtrack_ros.trackers.discriminative import DiscriminativeTarget
from vtrack_ros.trackers.sighting import Sighting

Array = NDArray[np.float64]

#: When the evidence falls short of this share of the usual, another rotation is tried if it
#: differs by that, [rad], and taken if there's so much more evidence in it.
_WORTH_TURNING = 0.06
_GAIN = 1.05
_SHORT = 0.9
#: The part of the frame that's turned, in units of the window that the model looks at.
_REACH = 1.3
#: Targets larger than this, [px], are sampled from a subset of the pixels anyway.
_FINE = 100.0


class UprightTarget:
    """
    Looks for a target in a frame that is turned back by the target's own rotation.

    Correlation filters know a target in one orientation. The part of the frame about the target
    is turned so that the target stands as it did at the start; places go through that rotation on
    the way in and out.

    Parameters
    ----------
    rng : numpy.random.Generator
        Where the search draws its places.

    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.target = DiscriminativeTarget(rng)

    def start(self, frame: Frame, center: tuple[float, float], size: tuple[float, float]) -> None:
        """Begin on a target of that centre and size, in pixels."""
        self.target.start(frame, center, size)
        self._sighting: Sighting | None = None
        self._upright = frame
        self._angle = 0.0

    def look(self, frame: Frame, angle: float) -> Array:
        """
        Look for the target about its last place.

        Parameters
        ----------
        frame : ndarray of uint8
            The frame.
        angle : float, [rad]
            How far the target has turned since the start.

        Returns
        -------
        ndarray, shape (2,), [px]
            Where there's most evidence.

        """
        self._pivot = np.array(self.target.live.center)
        former = self._angle
        self._look(frame, former)
        kept = self._upright, self._sighting
        assert kept[1] is not None
        short = kept[1].peak < _SHORT * self.target.live.evidence_mean
        if short and abs(angle - former) > _WORTH_TURNING:
            self._look(frame, angle)
            assert self._sighting is not None
            if self._sighting.peak < _GAIN * kept[1].peak:
                self._turn_by(former)
                self._upright, self._sighting = kept
        assert self._sighting is not None
        return self._into_frame(np.array(self._sighting.center))

    def _look(self, frame: Frame, angle: float) -> None:
        self._turn_by(angle)
        self._upright = self._turned(frame) if angle else frame
        self._sighting = self.target.look(self._upright, self.target.live.center)

    def _turn_by(self, angle: float) -> None:
        self._angle = angle
        self._turn = affine.rotation(np.asarray(angle))

    def log_likelihood(self, points: Array, temperature: float) -> Array:
        """
        Return the evidence at points, less the highest, in units of a share of the usual one.

        Parameters
        ----------
        points : ndarray, shape (N, 2), [px]
            In the frame.
        temperature : float
            The share of the usual evidence that makes a factor of e.

        """
        assert self._sighting is not None
        usual = max(self.target.live.evidence_mean, 1e-6)
        evidence = self._sighting.at(self._into_upright(points))
        result: Array = (evidence - self._sighting.peak) / (temperature * usual)
        return result

    def settle(self, center: Array, dt: float) -> bool:
        """
        Take a place in the frame, in pixels, for the target's; learn from it and judge it.

        Returns
        -------
        bool
            Whether the target was found again elsewhere; it's taken to be upright there if it's
            beyond the part that was turned.

        """
        assert self._sighting is not None
        x, y = self._into_upright(center)
        found = self.target.settle(self._upright, self._sighting, (float(x), float(y)), dt)
        live = self.target.live
        within = np.abs(np.array(live.center) - self._pivot) < self._half_sides()
        if self._angle and within.all():
            x, y = self._into_frame(np.array(live.center))
            self.target.live = replace(live, center=(float(x), float(y)))
        elif found:
            self._angle = 0.0
        return found

    @property
    def angle(self) -> float:
        """Return the rotation, [rad], that the last look undid."""
        return self._angle

    def _half_sides(self) -> Array:
        live = self.target.live
        result: Array = _REACH / 2 * np.array(live.size) * live.model.layout.reach
        return result

    def _into_frame(self, points: Array) -> Array:
        result: Array = self._pivot + (points - self._pivot) @ self._turn.T
        return result

    def _into_upright(self, points: Array) -> Array:
        result: Array = self._pivot + (points - self._pivot) @ self._turn
        return result

    def _turned(self, frame: Frame) -> Frame:
        """Return a frame of the same shape whose part about the target is turned back."""
        limit = np.array(frame.shape[1::-1])
        half = self._half_sides()
        left, top = np.clip(np.floor(self._pivot - half), 0, limit - 1).astype(int)
        right, bottom = np.clip(
            np.ceil(self._pivot + half), (left + 1, top + 1), limit).astype(int)
        matrix = np.empty((2, 3))
        matrix[:, :2] = self._turn
        # OpenCV counts from the centre of a pixel, boxes from its outer corner
        matrix[:, 2] = self._into_frame(np.array([left + 0.5, top + 0.5])) - 0.5
        # a search looks at places anywhere in the frame, a look only into the turned part
        upright = frame.copy() if self.target.doubtful else np.zeros_like(frame)
        side = np.sqrt(self.target.live.size[0] * self.target.live.size[1])
        how = cv2.INTER_NEAREST if side > _FINE else cv2.INTER_LINEAR
        upright[top:bottom, left:right] = cv2.warpAffine(
            frame, matrix, (int(right - left), int(bottom - top)),
            flags=how | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE)
        return upright
