"""What a particle filter over boxes sees of a frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.fusion import FUSION_RULES, reliability
from vtrack_ros.appearance.histogram import Boxes, ColourHistogram
from vtrack_ros.appearance.motion_edge import MotionEdge
from vtrack_ros.estimation import spread_about
from vtrack_ros.frame import Frame

Array = NDArray[np.float64]

_SEARCHING_BELOW = 0.5
#: A place is measured on so many places a side of a grid, so far apart in sides of the target.
_PLACES, _SPACING = 7, 0.15
#: How far the likest place is from the true one, in sides, on the rendered scenes.
_CUE_ERROR = 0.1
#: How far the size may be from the first one.
_SMALLEST, _LARGEST = 0.2, 5.0
_STEPS = _SPACING * (np.arange(_PLACES) - (_PLACES - 1) / 2)
_GRID = np.array([(x, y) for x in _STEPS for y in _STEPS])


@dataclass(frozen=True)
class Measurement:
    """
    A measured centre.

    Parameters
    ----------
    center : ndarray, shape (2,), [px]
        The centre.
    covariance : ndarray, shape (2, 2), [px^2]

    """

    center: Array
    covariance: Array


@dataclass(frozen=True)
class Conclusion:
    """
    Where the target is taken to be, after the particles have been weighted.

    Parameters
    ----------
    box : ndarray, shape (4,), [px]
        (centre x, centre y, width, height).
    confidence : float
        In [0, 1].
    unseen_frames : float
        For so many frames the target wasn't seen; 0 if it was in this one.
    jumped : bool
        Whether it was found elsewhere, so that the particles have to follow.

    """

    box: Array
    confidence: float
    unseen_frames: float = 0.0
    jumped: bool = False


class Observation(ABC):
    """A frame's evidence, looked at in three steps: measure, score the particles, conclude."""

    #: Whether the particles have sizes of their own.
    sized: bool
    #: Standard deviations of the centre and the size that the particles don't know of, as shares
    #: of the target's mean side.
    errors: tuple[float, float]

    @abstractmethod
    def start(self, frame: Frame, box: Array) -> None:
        """Begin on a box, shape (4,)."""

    @abstractmethod
    def look(self, frame: Frame, box: Array, predicted: Array) -> Measurement | None:
        """
        Look at a frame.

        Parameters
        ----------
        frame : ndarray of uint8
            The image.
        box, predicted : ndarray, shape (4,), [px]
            The box in the last frame, and where it should be now.

        Returns
        -------
        Measurement or None
            For proposals that use one; None where nothing can be measured.

        """

    @abstractmethod
    def log_likelihood(self, boxes: Boxes) -> Array:
        """Return log p(frame | box) up to a constant for boxes (N, 4), shape (N,)."""

    @abstractmethod
    def conclude(self, frame: Frame, box: Array, dt: float) -> Conclusion:
        """Learn from the frame, given the particles' mean box, and say what came out."""


class CueObservation(Observation):
    """
    The papers' cues: a colour histogram, and moving edges beside it.

    The papers don't say what their filters measure in video. Here it's the mean of the places
    about the prediction, weighted with the likelihood of all cues fused, and its covariance is
    theirs: wide where the cues say little, or like two places. To it comes the error of the cues.

    Parameters
    ----------
    cues : str
        ``'colour'`` or ``'colour+motion_edge'``.
    fusion : str
        A name in `FUSION_RULES`.
    sigma : float
        Of the likelihood exp(-(1 - rho) / (2 sigma^2)).
    kernel : str
        Of the colour histogram.
    measuring : bool
        Whether anybody asks for the measured centre.

    """

    sized = True
    errors = 0.33, 0.3

    def __init__(self, cues: str, fusion: str, sigma: float, kernel: str,
                 measuring: bool) -> None:
        self.fusion, self.sigma = fusion, sigma
        self._measuring = measuring
        self._colour = ColourHistogram(kernel=kernel)
        self._edges = MotionEdge() if 'motion_edge' in cues else None

    def start(self, frame: Frame, box: Array) -> None:
        """Take the box's histogram for the reference."""
        self._first = box.copy()
        self._frame = frame
        self._reference = self._colour.reference(frame, box)
        shifts = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y])
        around = np.tile(box, (len(shifts), 1))
        around[:, :2] += 1.2 * shifts * box[2:]
        self._floor = float(np.median(
            self._colour.coefficients(frame, around, self._reference)))
        self._floor = min(self._floor, 0.9)
        self._unseen_frames = 0.0
        self._look_at_edges(frame, box)

    def look(self, frame: Frame, box: Array, predicted: Array) -> Measurement | None:
        """Measure the mean place about the prediction, if anybody asks for it."""
        self._frame = frame
        self._look_at_edges(frame, predicted)
        if not self._measuring:
            return None
        side = float(np.sqrt(box[2] * box[3]))
        boxes = np.tile(predicted, (len(_GRID), 1))
        boxes[:, :2] += side * _GRID
        exponents = self.log_likelihood(boxes)
        weights = np.exp(exponents - exponents.max())
        weights /= weights.sum()
        places = boxes[:, :2]
        center = weights @ places
        covariance = spread_about(center, places, weights)
        return Measurement(center, covariance + (_CUE_ERROR * side)**2 * np.eye(2))

    def log_likelihood(self, boxes: Boxes) -> Array:
        """Score colour, and moving edges beside it, fused by the chosen rule."""
        scored = self._bounded(boxes)
        excess = ((boxes - scored) / (0.1 * scored))[:, 2:]
        rho = self._colour.coefficients(self._frame, scored, self._reference)
        exponent = (rho - 1) / (2 * self.sigma**2)
        if self._edges is None:
            result = exponent
        else:
            likelihoods = np.stack([np.exp(exponent - exponent.max()),
                                    self._edges.likelihoods(scored, self.sigma)])
            best = np.nanmax(likelihoods[1]) if np.isfinite(likelihoods[1]).any() else 1.0
            likelihoods[1] /= best
            result = FUSION_RULES[self.fusion](likelihoods, reliability(likelihoods))
        result -= (excess**2).sum(axis=1)
        # nothing is seen outside: what has gone there must not wander off for ever
        edge = np.array(self._frame.shape[1::-1])
        beyond = (boxes[:, :2] - np.clip(boxes[:, :2], 0, edge)) / self._first[2:]
        result -= (beyond**2).sum(axis=1)
        return result

    def conclude(self, frame: Frame, box: Array, dt: float) -> Conclusion:
        """Compare the mean box with the reference."""
        box = self._bounded(box[None])[0]
        rho = float(self._colour.coefficients(frame, box[None], self._reference)[0])
        likeness = (rho - self._floor) / (1 - self._floor)
        confidence = float(1 / (1 + np.exp(-(likeness - 0.45) / 0.1)))
        if self._edges is not None:
            self._edges.learn(box)
        self._unseen_frames = self._unseen_frames + dt if confidence < _SEARCHING_BELOW else 0.0
        return Conclusion(box, confidence, self._unseen_frames)

    def _bounded(self, boxes: Boxes) -> Boxes:
        """Bound sizes to a range about the first one."""
        bounded = boxes.copy()
        np.clip(boxes[:, 2:], _SMALLEST * self._first[2:], _LARGEST * self._first[2:],
                out=bounded[:, 2:])
        return bounded

    def _look_at_edges(self, frame: Frame, box: Array) -> None:
        if self._edges is None:
            return
        height, width = frame.shape[:2]
        low, high = box[:2] - 1.5 * box[2:], box[:2] + 1.5 * box[2:]
        left, top = int(np.clip(low[0], 0, width - 1)), int(np.clip(low[1], 0, height - 1))
        right = int(np.clip(high[0], left + 1, width))
        bottom = int(np.clip(high[1], top + 1, height))
        self._edges.advance(frame, (left, top, right, bottom))
