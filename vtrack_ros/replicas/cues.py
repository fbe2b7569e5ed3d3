"""The cues that the papers' particle filters weight boxes with: colour, and moving edges."""

import numpy as np

from vtrack_ros.appearance.histogram import Boxes, ColourHistogram
from vtrack_ros.estimation import spread_about
from vtrack_ros.frame import Array, Frame
from vtrack_ros.localisation.presence import logistic
from vtrack_ros.replicas.fusion import FusionRule, product, reliability
from vtrack_ros.replicas.motion_edge import MotionEdge

#: Grid of places for measuring the centre: number along each axis, and spacing in target sides.
_PLACES, _SPACING = 7, 0.15
#: Error of the most likely place on the rendered scenes, in sides: the standard deviation that is
#: added to a measured centre's covariance.
_CUE_ERROR = 0.1
#: Range of the size relative to the first one (minimum, maximum).
_SMALLEST, _LARGEST = 0.2, 5.0
#: Similarity at which the confidence is 0.5, and the width of its logistic function.
_EVEN, _WIDTH = 0.45, 0.1
_STEPS = _SPACING * (np.arange(_PLACES) - (_PLACES - 1) / 2)
_GRID = np.array([(x, y) for x in _STEPS for y in _STEPS])


class BoxCues:
    """
    The likelihood of boxes, from a colour histogram and, optionally, moving edges.

    Colour is compared by Bhattacharyya's coefficient, p(z|x) = exp(-(1 - rho) / (2 sigma^2))
    [Zhu2012, sec. 4, step 3; Qi2012, eqs 4-8], moving edges likewise [Qi2012, eqs 9-15].

    The papers don't say what their filters measure in video. Here it's the mean of a grid of
    places about the prediction, weighted with the fused likelihood of all cues. Its covariance is
    the weighted spread of these places, which is wide where the likelihood is flat or has two
    peaks, plus the error of the cues.

    The papers don't bound boxes. Here a penalty keeps sizes in a range about the first one, and
    centres inside the image, outside of which nothing is seen.

    Boxes are rows (centre x, centre y, width, height), in px; the colours have `kernel`, `grid`.
    """

    def __init__(self, edges: bool, kernel: str, grid: int = 12) -> None:
        self._colour = ColourHistogram(kernel=kernel, grid=grid)
        self._edges = MotionEdge() if edges else None
        self.sigma = 0.1
        self.fusion: FusionRule = product

    def start(self, frame: Frame, box: Array) -> None:
        """Learn the reference histogram from a box, shape (4,)."""
        self._first = box.copy()
        self._reference = self._colour.reference(frame, box)
        shifts = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y])
        around = np.tile(box, (len(shifts), 1))
        around[:, :2] += 1.2 * shifts * box[2:]
        self._floor = min(0.9, float(np.median(
            self._colour.coefficients(frame, around, self._reference))))
        self.observe(frame, box)

    def observe(self, frame: Frame, predicted: Array) -> None:
        """Take the next frame, in which the target is predicted at a box, shape (4,)."""
        self._frame = frame
        if self._edges is None:
            return
        height, width = frame.shape[:2]
        low = predicted[:2] - 1.5 * predicted[2:]
        high = predicted[:2] + 1.5 * predicted[2:]
        left, top = int(np.clip(low[0], 0, width - 1)), int(np.clip(low[1], 0, height - 1))
        right = int(np.clip(high[0], left + 1, width))
        bottom = int(np.clip(high[1], top + 1, height))
        self._edges.advance(frame, (left, top, right, bottom))

    def measure(self, predicted: Array, side: float) -> tuple[Array, Array]:
        """Measure a centre, and its covariance, about a predicted box; all in px."""
        boxes = np.tile(predicted, (len(_GRID), 1))
        boxes[:, :2] += side * _GRID
        exponents = self.log_likelihood(boxes)
        peak = exponents.max()
        # where the cues exclude each other's places, none is possible: that tells nothing
        weights = np.exp(exponents - peak) if np.isfinite(peak) else np.ones(len(boxes))
        weights /= weights.sum()
        places = boxes[:, :2]
        center = weights @ places
        covariance = spread_about(center, places, weights)
        return center, covariance + (_CUE_ERROR * side)**2 * np.eye(2)

    def log_likelihood(self, boxes: Boxes) -> Array:
        """Return log p(frame | box) up to a constant for boxes (N, 4), shape (N,)."""
        scored = self.bounded(boxes)
        excess = ((boxes - scored) / (0.1 * scored))[:, 2:]
        rho = self._colour.coefficients(self._frame, scored, self._reference)
        exponent = (rho - 1) / (2 * self.sigma**2)
        if self._edges is None:
            result = exponent
        else:
            likelihoods = np.stack([np.exp(exponent - exponent.max()),
                                    self._edges.likelihoods(scored, self.sigma)])
            # the edges abstain where none moves, and where no box has any like the target's
            best = likelihoods[1].max()
            likelihoods[1] = likelihoods[1] / best if best > 0 else np.nan
            result = self.fusion(likelihoods, reliability(likelihoods))
        result -= (excess**2).sum(axis=1)
        # nothing is seen outside the image: the penalty keeps boxes from drifting away there
        edge = np.array(self._frame.shape[1::-1])
        beyond = (boxes[:, :2] - np.clip(boxes[:, :2], 0, edge)) / self._first[2:]
        result -= (beyond**2).sum(axis=1)
        return result

    def bounded(self, boxes: Boxes) -> Boxes:
        """Return boxes, shape (N, 4), with sizes clamped to a range about the first one."""
        bounded = boxes.copy()
        np.clip(boxes[:, 2:], _SMALLEST * self._first[2:], _LARGEST * self._first[2:],
                out=bounded[:, 2:])
        return bounded

    def confidence(self, box: Array) -> float:
        """Return the confidence, in [0, 1], that the target is in a box, shape (4,)."""
        rho = float(self._colour.coefficients(self._frame, box[None], self._reference)[0])
        similarity = (rho - self._floor) / (1 - self._floor)
        return logistic((similarity - _EVEN) / _WIDTH)

    def update(self, box: Array) -> None:
        """Update the reference of the moving edges from a box, shape (4,)."""
        if self._edges is not None:
            self._edges.update(box)
