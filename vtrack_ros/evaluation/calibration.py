"""Calibration of a tracker's confidence, state and covariance against the truth."""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike

from vtrack_ros.evaluation.metrics import BoolArray, center_offsets, off_target, on_target
from vtrack_ros.frame import Array


def auroc(positive: ArrayLike, negative: ArrayLike) -> float:
    """
    Return the probability that a positive scores above a negative, a tie counting one half.

    This is the area under the receiver operating characteristic, by the rank-sum statistic; NaN
    if there are no positives or no negatives.
    """
    high = np.asarray(positive, dtype=np.float64)
    low = np.sort(np.asarray(negative, dtype=np.float64))
    if not len(high) or not len(low):
        return math.nan
    below = np.searchsorted(low, high, side='left')
    up_to = np.searchsorted(low, high, side='right')
    return float((below + up_to).mean() / (2 * len(low)))


@dataclass(frozen=True)
class Losses:
    """
    The losses of the target and the delays with which a tracker reported them.

    A loss begins with the first frame off the target after one on it (the start counts as on) and
    ends with the next frame on it.

    `delays` has, for each loss that the tracker reported, the number of frames from its begin to
    the report: 0 if its first frame was reported.
    """

    count: int
    delays: tuple[int, ...]


def losses(overlap: Array, reported: BoolArray) -> Losses:
    """Return the losses; `reported` is for each frame whether the tracker reported a loss."""
    on, off = on_target(overlap), off_target(overlap)
    count, began = 0, -1
    delays = []
    lost = said = False
    for index in range(len(overlap)):
        if not lost and off[index]:
            count, began, lost, said = count + 1, index, True, False
        elif on[index]:
            lost = False
        if lost and not said and reported[index]:
            delays.append(index - began)
            said = True
    return Losses(count, tuple(delays))


def return_delays(overlap: Array) -> tuple[float, ...]:
    """
    Return the number of frames until re-detection, for each time the absent target returned.

    It is counted from the frame of the return to the first one with the box on the target: 0 if
    they are the same, inf if the target left again or the sequence ended before.
    """
    delays = []
    returned = -1
    absent = np.isnan(overlap)
    on = on_target(overlap)
    for index in range(1, len(overlap)):
        if absent[index] and returned >= 0:
            delays.append(math.inf)
            returned = -1
        elif absent[index - 1] and not absent[index]:
            returned = index
        if returned >= 0 and on[index]:
            delays.append(float(index - returned))
            returned = -1
    if returned >= 0:
        delays.append(math.inf)
    return tuple(delays)


def inside_ellipse(boxes: ArrayLike, covariances: ArrayLike, truth: ArrayLike,
                   probability: float) -> Array:
    """
    Return 1 where the true centre is inside the ellipse of the covariance, 0 where it's outside.

    The ellipse of the centre's covariances, shape (n, 2, 2) in px^2, contains `probability` of a
    normal distribution: its squared Mahalanobis radius is -2 log(1 - probability). NaN where the
    truth is absent or the covariance not finite; 0 where the covariance is singular.
    """
    offset = center_offsets(boxes, truth)
    covariance = np.asarray(covariances, dtype=np.float64)
    if covariance.shape != (len(offset), 2, 2):
        raise ValueError(
            f'covariances must have shape ({len(offset)}, 2, 2), not {covariance.shape}')
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    dx, dy = offset[:, 0], offset[:, 1]
    determinant = xx * yy - xy * xy
    # Squared Mahalanobis distance times determinant: a singular covariance divides by no zero.
    distance = yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy
    inside = (determinant > 0) & (distance <= -2 * math.log1p(-probability) * determinant)
    result: Array = inside.astype(np.float64)
    result[~(np.isfinite(distance) & np.isfinite(determinant))] = np.nan
    return result
