"""
The figures of merit of a tracked sequence, from boxes alone.

Boxes are arrays of shape (n, 4): x, y, width, height in pixels, (x, y) the top-left corner. A row
of the truth that is NaN or has no area means that the target is absent: such a frame takes part in
no overlap and no centre error, only in the figures of loss. The first frame, whose box is given,
counts as in the one-pass evaluation of OTB [Wu2013].
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: The thresholds of the success plot, [intersection over union].
OVERLAP_THRESHOLDS: FloatArray = np.linspace(0.0, 1.0, 21)
#: The thresholds of the precision plot, [px].
PRECISION_THRESHOLDS: FloatArray = np.arange(51.0)
#: The thresholds of the normalised precision plot, in sizes of the target.
NORMALISED_THRESHOLDS: FloatArray = np.linspace(0.0, 0.5, 51)
#: An overlap above this is on the target.
ON_TARGET = 0.5
#: An overlap below this is off the target.
OFF_TARGET = 0.1


def checked_boxes(boxes: ArrayLike, name: str = 'boxes') -> FloatArray:
    """
    Return boxes as an array of shape (n, 4).

    Raises
    ------
    ValueError
        If the shape is another one.

    """
    array = np.asarray(boxes, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 4:
        raise ValueError(f'{name} must have shape (n, 4), not {array.shape}')
    return array


def present(truth: ArrayLike) -> BoolArray:
    """Return, for each row of the truth, whether the target is there: finite and with area."""
    boxes = checked_boxes(truth, 'truth')
    with np.errstate(invalid='ignore'):
        return np.isfinite(boxes).all(axis=1) & (boxes[:, 2] > 0) & (boxes[:, 3] > 0)


def overlaps(boxes: ArrayLike, truth: ArrayLike) -> FloatArray:
    """
    Return the intersection over union of each box with its truth; NaN where that is absent.

    Parameters
    ----------
    boxes, truth : ndarray, shape (n, 4), [px]
        Row by row of the same frames.

    Raises
    ------
    ValueError
        If the shapes are wrong or differ.

    """
    a, b = _pair(boxes, truth)
    extent = (np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:])
              - np.maximum(a[:, :2], b[:, :2]))
    shared = np.clip(extent, 0, None).prod(axis=1)
    union = a[:, 2:].prod(axis=1) + b[:, 2:].prod(axis=1) - shared
    result = np.full(len(a), np.nan)
    there = present(b)
    result[there] = shared[there] / union[there]
    return result


def center_errors(boxes: ArrayLike, truth: ArrayLike) -> FloatArray:
    """Return the distance of the centres in pixels; NaN where the truth is absent."""
    offset = _center_offsets(boxes, truth)
    result: FloatArray = np.hypot(offset[:, 0], offset[:, 1])
    return result


def normalised_errors(boxes: ArrayLike, truth: ArrayLike) -> FloatArray:
    """Return the distance of the centres in sizes of the truth [Fan2019]; NaN where absent."""
    size = checked_boxes(truth, 'truth')[:, 2:]
    there = present(truth)
    scaled = np.full(size.shape, np.nan)
    scaled[there] = _center_offsets(boxes, truth)[there] / size[there]
    result: FloatArray = np.hypot(scaled[:, 0], scaled[:, 1])
    return result


def success_curve(overlap: FloatArray) -> FloatArray:
    """Return the share of frames whose overlap is above each of `OVERLAP_THRESHOLDS`."""
    valid = overlap[np.isfinite(overlap)]
    return _share(valid[:, None] > OVERLAP_THRESHOLDS)


def success_auc(overlap: FloatArray) -> float:
    """Return the area under the success curve: the mean over its 21 thresholds [Wu2013]."""
    return float(success_curve(overlap).mean())


def precision_curve(error: FloatArray) -> FloatArray:
    """Return the share of frames whose centre error is within `PRECISION_THRESHOLDS`."""
    valid = error[np.isfinite(error)]
    return _share(valid[:, None] <= PRECISION_THRESHOLDS)


def precision_at(error: FloatArray, threshold: float = 20.0) -> float:
    """Return the share of frames whose centre error is within `threshold` pixels."""
    valid = error[np.isfinite(error)]
    return float(_share(valid[:, None] <= np.array([threshold]))[0])


def normalised_precision(normalised: FloatArray) -> float:
    """Return the area under the normalised precision curve, the mean over 0 to 0.5 [Fan2019]."""
    valid = normalised[np.isfinite(normalised)]
    return float(_share(valid[:, None] <= NORMALISED_THRESHOLDS).mean())


@dataclass(frozen=True)
class Failures:
    """
    The failures of a sequence.

    A failure begins when the overlap falls to 0 and ends when it rises above `OFF_TARGET` again;
    frames without the target neither begin nor end one, and aren't counted in its length.

    Parameters
    ----------
    count : int
        How many there were.
    recoveries : tuple of int, [frames]
        How many frames each of those that ended had lasted.

    """

    count: int
    recoveries: tuple[int, ...]


def failures(overlap: FloatArray) -> Failures:
    """Return the failures of a sequence from its overlaps."""
    count, length = 0, 0
    recoveries = []
    for value in overlap[np.isfinite(overlap)]:
        if length and value > OFF_TARGET:
            recoveries.append(length)
            length = 0
        elif length:
            length += 1
        elif value == 0:
            count, length = count + 1, 1
    return Failures(count, tuple(recoveries))


def auroc(positive: ArrayLike, negative: ArrayLike) -> float:
    """
    Return the probability that a positive scores above a negative, ties counted by half.

    The area under the receiver operating characteristic, by the rank-sum statistic; NaN where
    there are no positives or no negatives.
    """
    high = np.asarray(positive, dtype=np.float64)
    low = np.sort(np.asarray(negative, dtype=np.float64))
    if not len(high) or not len(low):
        return math.nan
    below = np.searchsorted(low, high, side='left')
    up_to = np.searchsorted(low, high, side='right')
    return float((below + up_to).mean() / (2 * len(low)))


def on_target(overlap: FloatArray) -> BoolArray:
    """Return where the box is on the target."""
    return np.nan_to_num(overlap, nan=0.0) > ON_TARGET


def off_target(overlap: FloatArray) -> BoolArray:
    """Return where the box is off the target, or the target absent."""
    return np.nan_to_num(overlap, nan=0.0) < OFF_TARGET


@dataclass(frozen=True)
class Losses:
    """
    How a tracker reports that it lost the target.

    A loss begins with the first frame off the target after one on it (the start counts as on) and
    ends with the next frame on it.

    Parameters
    ----------
    count : int
        How many there were.
    delays : tuple of int, [frames]
        For each loss that the tracker reported: the frames that passed before it did, 0 where the
        first one was reported already.

    """

    count: int
    delays: tuple[int, ...]


def losses(overlap: FloatArray, reported: BoolArray) -> Losses:
    """
    Return how the losses of a sequence were reported.

    Parameters
    ----------
    overlap : ndarray, shape (n,)
        The overlaps, NaN where the target is absent.
    reported : ndarray of bool, shape (n,)
        Whether the tracker said in that frame that it doesn't see the target.

    """
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


def return_delays(overlap: FloatArray) -> tuple[float, ...]:
    """
    Return, for each absence of the target that ended, the frames from its return until on target.

    Inf for a target that was not found again before it went or the sequence ended, 0 where the
    box is on the target in the frame of its return.
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


def inside_ellipse(
        boxes: ArrayLike, covariances: ArrayLike, truth: ArrayLike,
        probability: float) -> FloatArray:
    """
    Return 1 where the true centre is inside the ellipse of the covariance, 0 where it's outside.

    Parameters
    ----------
    boxes, truth : ndarray, shape (n, 4), [px]
        Row by row of the same frames.
    covariances : ndarray, shape (n, 2, 2), [px^2]
        Of the centre.
    probability : float
        What share of a normal distribution the ellipse holds: its squared Mahalanobis radius is
        -2 log(1 - probability).

    Returns
    -------
    inside : ndarray, shape (n,)
        NaN where the truth is absent or the covariance not finite; a singular covariance holds
        nothing.

    """
    offset = _center_offsets(boxes, truth)
    covariance = np.asarray(covariances, dtype=np.float64)
    if covariance.shape != (len(offset), 2, 2):
        raise ValueError(
            f'covariances must have shape ({len(offset)}, 2, 2), not {covariance.shape}')
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    dx, dy = offset[:, 0], offset[:, 1]
    determinant = xx * yy - xy * xy
    # Multiplied by the determinant, so that a singular covariance divides nothing.
    distance = yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy
    inside = (determinant > 0) & (distance <= -2 * math.log1p(-probability) * determinant)
    result: FloatArray = inside.astype(np.float64)
    result[~(np.isfinite(distance) & np.isfinite(determinant))] = np.nan
    return result


def stretches(mask: BoolArray) -> list[tuple[int, int]]:
    """Return begin and end (the first one after it) of each run of true values."""
    edges = np.diff(np.concatenate([[0], np.asarray(mask).astype(np.int8), [0]]))
    return [(int(begin), int(end)) for begin, end in zip(
        np.flatnonzero(edges == 1), np.flatnonzero(edges == -1))]


def _pair(boxes: ArrayLike, truth: ArrayLike) -> tuple[FloatArray, FloatArray]:
    a, b = checked_boxes(boxes), checked_boxes(truth, 'truth')
    if a.shape != b.shape:
        raise ValueError(f'{len(a)} boxes but {len(b)} rows of truth')
    return a, b


def _center_offsets(boxes: ArrayLike, truth: ArrayLike) -> FloatArray:
    a, b = _pair(boxes, truth)
    offset: FloatArray = (a[:, :2] + a[:, 2:] / 2) - (b[:, :2] + b[:, 2:] / 2)
    offset[~present(b)] = np.nan
    return offset


def _share(hits: BoolArray) -> FloatArray:
    if not len(hits):
        return np.full(hits.shape[1], np.nan)
    result: FloatArray = hits.mean(axis=0)
    return result
