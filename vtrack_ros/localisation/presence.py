"""Whether a target is present, and what a tracker doesn't know of one that isn't."""

from __future__ import annotations

import math

import numpy as np

from vtrack_ros.frame import Array
from vtrack_ros.tracker import TrackState

#: Similarity to the initial template at which on and off the target are even.
EVEN_SIMILARITY = 0.085
#: The same as a share of what's usual, for a target that's plain to see: it's told from textures
#: that are a little similar to everything. And the width of the transition.
_EVEN_SHARE, _SIMILARITY_SPREAD = 0.2, 0.02
#: The margin to the even similarity is averaged over frames, with that weight of the latest; by
#: so much a case is clear, and not any clearer.
_MARGIN_RATE, _CLEAR = 0.5, 0.1
#: A target is lost after more frames out of sight than that.
_LOST_FRAMES = 30
#: Standard deviations of centre and size, as shares of the target's mean side, in the first frame
#: out of sight: by then a tracker often is on something else. On real videos, with and without
#: painted occluders, nine in ten true centres are within 2.2 sides then, and 2.1 to 3.6 later.
_CENTER_ERROR, _SIZE_ERROR = 1.0, 0.3
#: The variance of the centre grows by as much again in that many frames.
_WANDERING_FRAMES = 30


class PresenceDetector:
    """
    Judges from the similarity in a few frames whether the target is present.

    It is, at first.
    """

    def __init__(self) -> None:
        self._margin = _CLEAR
        self.unseen_frames = 0.0
        """For so many frames the target hasn't been seen; 0 if it was in the last one."""

    @property
    def confidence(self) -> float:
        """Return how sure it is that the target is where it was localised, in [0, 1]."""
        return logistic(self._margin / _SIMILARITY_SPREAD)

    def judge(self, similarity: float, usual: float, dt: float, elsewhere: bool = False) -> None:
        """
        Take one more frame into account.

        Parameters
        ----------
        similarity : float
            To the initial template.
        usual : float
            What's usual for this target.
        dt : float, [frames]
            The time since the last frame.
        elsewhere : bool
            Whether it's the similarity of another place, to which the last ones mean nothing.

        """
        even = max(EVEN_SIMILARITY, _EVEN_SHARE * usual)
        margin = min(max(similarity - even, -_CLEAR), _CLEAR)
        self._margin += (1 if elsewhere else _MARGIN_RATE) * (margin - self._margin)
        self.unseen_frames = 0.0 if self._margin >= 0 else self.unseen_frames + dt


def logistic(value: float) -> float:
    """Return 1 / (1 + exp(-value)), without overflow."""
    return 0.5 + 0.5 * math.tanh(value / 2)


def state_after(frames: float) -> TrackState:
    """Return the state of a tracker that hasn't seen its target for so many frames."""
    if not frames:
        return TrackState.TRACKING
    return TrackState.LOST if frames > _LOST_FRAMES else TrackState.SEARCHING


def unknown_covariance(
        center_error: float, size_error: float, area: float, frames: float) -> Array:
    """
    Return the covariance of what a filter doesn't know of: its cues' errors, and not seeing.

    Parameters
    ----------
    center_error, size_error : float
        Standard deviations of the centre and the size while the target is seen, as shares of its
        mean side.
    area : float, [px^2]
        The target's.
    frames : float
        For so many frames it hasn't been seen; 0 if it was seen in this one.

    Returns
    -------
    ndarray, shape (4, 4), [px^2]
        Of (centre x, centre y, width, height).

    """
    center, size = center_error**2, size_error**2
    if frames:
        center += _CENTER_ERROR**2 * (1 + frames / _WANDERING_FRAMES)
        size += _SIZE_ERROR**2
    covariance = np.zeros((4, 4))
    covariance.flat[::5] = area * center, area * center, area * size, area * size
    return covariance
