"""Localises a target upright, however it has turned: for models that know one orientation."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import affine
from vtrack_ros.localisation.hypotheses import Hypotheses
from vtrack_ros.localisation.search_window import inside, ResponseMap

#: When the response falls short of this share of the usual one, another rotation is tried if it
#: differs by that, [rad], and taken if the response is so much higher in it.
_SHORT = 0.9
_WORTH_TURNING = 0.06
_GAIN = 1.05
#: The part of the frame that's turned, in units of the search window.
_REACH = 1.3
#: Targets larger than this, [px], are sampled from a subset of the pixels anyway.
_FINE = 100.0


@dataclass(frozen=True)
class Turn:
    """A rotation by an angle, [rad], about a place in the frame, shape (2,), [px]."""

    pivot: Array
    angle: float

    @cached_property
    def matrix(self) -> Array:
        """Return the rotation from upright into the frame, shape (2, 2)."""
        return affine.rotation(np.asarray(self.angle))

    def into_frame(self, points: Array) -> Array:
        """Return where points (..., 2) of the upright frame are in the frame."""
        return self.pivot + (points - self.pivot) @ self.matrix.T

    def into_upright(self, points: Array) -> Array:
        """Return where points (..., 2) of the frame are in the upright frame."""
        return self.pivot + (points - self.pivot) @ self.matrix


@dataclass(frozen=True)
class UprightResponse:
    """The response over a frame whose part about the target is turned back; in its places."""

    turn: Turn
    upright: Frame
    response: ResponseMap

    @property
    def peak(self) -> float:
        """Return the highest response."""
        return self.response.peak

    @cached_property
    def center(self) -> Array:
        """Return where the highest response is, shape (2,), in pixels."""
        return self.turn.into_frame(np.array(self.response.center))

    def sample(self, points: Array) -> Array:
        """Return the response at points, shape (N, 2) in pixels; 0 beyond the window."""
        return self.response.sample(self.turn.into_upright(points))


class UprightSearch:
    """
    Shows a localiser the frame turned back by the target's own rotation, as it stood at the start.

    Correlation filters know a target in one orientation. Only the part about the target is turned;
    places go through that rotation on the way in and out.
    """

    def __init__(self, localiser: Hypotheses) -> None:
        self._localiser = localiser
        self.angle = 0.0
        """The rotation that was undone in the last frame, in radians."""

    def localise(self, frame: Frame, angle: float) -> UprightResponse:
        """
        Return the response about the target's last place.

        Where the last frame's rotation brings too low a response, another angle is tried, by which
        the target may have turned since the start.
        """
        found = self._localised(frame, self.angle)
        usual = self._localiser.usual_response
        if found.peak < _SHORT * usual and abs(angle - self.angle) > _WORTH_TURNING:
            other = self._localised(frame, angle)
            if other.peak >= _GAIN * found.peak:
                found = other
        self.angle = found.turn.angle
        return found

    def update(self, found: UprightResponse, center: Array, dt: float) -> bool:
        """
        Do as `Hypotheses.update` with a place in the frame, shape (2,), and what `localise` found.

        A target that was found again beyond the part that was turned is taken to be upright.
        """
        localiser, turn = self._localiser, found.turn
        x, y = turn.into_upright(center)
        elsewhere = localiser.update(found.upright, found.response, (float(x), float(y)), dt)
        within = np.abs(np.array(localiser.center) - turn.pivot) < self._half_sides()
        if turn.angle and within.all():
            x, y = turn.into_frame(np.array(localiser.center))
            localiser.move_to(inside((float(x), float(y)), found.upright))
        elif elsewhere:
            self.angle = 0.0
        return elsewhere

    def _localised(self, frame: Frame, angle: float) -> UprightResponse:
        center = self._localiser.center
        turn = Turn(np.array(center), angle)
        upright = self._turned_back(frame, turn) if angle else frame
        return UprightResponse(turn, upright, self._localiser.localise(upright, center))

    def _half_sides(self) -> Array:
        """Return half the sides of the part that's turned, shape (2,), in pixels."""
        return _REACH / 2 * np.array(self._localiser.size) * self._localiser.reach

    def _turned_back(self, frame: Frame, turn: Turn) -> Frame:
        """Return a frame of the same shape whose part about the target is turned back."""
        limit = np.array(frame.shape[1::-1])
        half = self._half_sides()
        left, top = np.clip(np.floor(turn.pivot - half), 0, limit - 1).astype(int)
        right, bottom = np.clip(
            np.ceil(turn.pivot + half), (left + 1, top + 1), limit).astype(int)
        matrix = np.empty((2, 3))
        matrix[:, :2] = turn.matrix
        # OpenCV counts from the centre of a pixel, boxes from its outer corner
        matrix[:, 2] = turn.into_frame(np.array([left + 0.5, top + 0.5])) - 0.5
        # re-detection searches anywhere in the frame, localisation in the turned part alone
        upright = frame.copy() if self._localiser.uncertain else np.zeros_like(frame)
        width, height = self._localiser.size
        how = cv2.INTER_NEAREST if np.sqrt(width * height) > _FINE else cv2.INTER_LINEAR
        upright[top:bottom, left:right] = cv2.warpAffine(
            frame, matrix, (int(right - left), int(bottom - top)),
            flags=how | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE)
        return upright
