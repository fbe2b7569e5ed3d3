"""
The figures of merit of a tracked sequence, from boxes alone.

Boxes are arrays of shape (n, 4): x, y, width, height in pixels, (x, y) the top-left corner. A row
of the truth that is NaN or has no area means that the target is absent: such a frame has no
overlap and no centre error, and counts only in the figures of loss. The first frame, whose box is
given, counts as in the one-pass evaluation of OTB [Wu2013].
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vtrack_ros.frame import Array
from vtrack_ros.geometry import Box

BoolArray = NDArray[np.bool_]

#: The thresholds of the success plot, [intersection over union].
OVERLAP_THRESHOLDS: Array = np.linspace(0.0, 1.0, 21)
#: The thresholds of the precision plot, [px].
PRECISION_THRESHOLDS: Array = np.arange(51.0)
#: The thresholds of the normalised precision plot, as fractions of the target's size.
NORMALISED_THRESHOLDS: Array = np.linspace(0.0, 0.5, 51)
#: A box whose overlap is above this threshold is on the target.
ON_TARGET = 0.5
#: A box whose overlap is below this threshold is off the target; in between it's neither.
OFF_TARGET = 0.1


def truth_rows(boxes: Iterable[Box | None]) -> Array:
    """Return boxes as rows of an array, NaN for None."""
    rows = [np.full(4, np.nan) if box is None else box.as_array() for box in boxes]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def checked_boxes(boxes: ArrayLike, name: str = 'boxes') -> Array:
    """Return boxes as an array of shape (n, 4); ValueError for any other shape."""
    array = np.asarray(boxes, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 4:
        raise ValueError(f'{name} must have shape (n, 4), not {array.shape}')
    return array


def present(truth: ArrayLike) -> BoolArray:
    """Return, for each row of the truth, whether the target is there: finite and with area."""
    boxes = checked_boxes(truth, 'truth')
    with np.errstate(invalid='ignore'):
        return np.isfinite(boxes).all(axis=1) & (boxes[:, 2] > 0) & (boxes[:, 3] > 0)


def overlaps(boxes: ArrayLike, truth: ArrayLike) -> Array:
    """Return the intersection over union of each box with its truth; NaN where that is absent."""
    a, b = _pair(boxes, truth)
    extent = (np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:])
              - np.maximum(a[:, :2], b[:, :2]))
    shared = np.clip(extent, 0, None).prod(axis=1)
    union = a[:, 2:].prod(axis=1) + b[:, 2:].prod(axis=1) - shared
    result = np.full(len(a), np.nan)
    there = present(b)
    result[there] = shared[there] / union[there]
    return result


def center_offsets(boxes: ArrayLike, truth: ArrayLike) -> Array:
    """Return centre minus true centre, shape (n, 2), in pixels; NaN where the truth is absent."""
    a, b = _pair(boxes, truth)
    offset: Array = (a[:, :2] + a[:, 2:] / 2) - (b[:, :2] + b[:, 2:] / 2)
    offset[~present(b)] = np.nan
    return offset


def center_errors(boxes: ArrayLike, truth: ArrayLike) -> Array:
    """Return the distance of the centres in pixels; NaN where the truth is absent."""
    offset = center_offsets(boxes, truth)
    return np.hypot(offset[:, 0], offset[:, 1])


def normalised_errors(boxes: ArrayLike, truth: ArrayLike) -> Array:
    """Return the centre error, x / width and y / height of the truth [Fan2019]; NaN if absent."""
    size = checked_boxes(truth, 'truth')[:, 2:]
    there = present(truth)
    scaled = np.full(size.shape, np.nan)
    scaled[there] = center_offsets(boxes, truth)[there] / size[there]
    result: Array = np.hypot(scaled[:, 0], scaled[:, 1])
    return result


def success_curve(overlap: Array) -> Array:
    """Return the share of frames whose overlap is above each of `OVERLAP_THRESHOLDS`."""
    return _share(overlap, np.greater, OVERLAP_THRESHOLDS)


def success_auc(overlap: Array) -> float:
    """Return the area under the success curve: the mean over its 21 thresholds [Wu2013]."""
    return float(success_curve(overlap).mean())


def precision_curve(error: Array) -> Array:
    """Return the share of frames whose centre error is within `PRECISION_THRESHOLDS`."""
    return _share(error, np.less_equal, PRECISION_THRESHOLDS)


def precision_at(error: Array, threshold: float = 20.0) -> float:
    """Return the share of frames whose centre error is within `threshold` pixels."""
    return float(_share(error, np.less_equal, np.array([threshold]))[0])


def normalised_precision(normalised: Array) -> float:
    """Return the normalised precision, averaged over thresholds from 0 to 0.5 [Fan2019]."""
    return float(_share(normalised, np.less_equal, NORMALISED_THRESHOLDS).mean())


@dataclass(frozen=True)
class Failures:
    """
    The failures of a sequence.

    A failure begins when the overlap falls to 0 and ends when it rises above `OFF_TARGET` again
    (hysteresis); frames without the target are skipped, and aren't counted in its length.

    `recoveries` has the length, in frames, of each failure that ended.
    """

    count: int
    recoveries: tuple[int, ...]


def failures(overlap: Array) -> Failures:
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


def on_target(overlap: Array) -> BoolArray:
    """Return where the box is on the target."""
    return np.nan_to_num(overlap, nan=0.0) > ON_TARGET


def off_target(overlap: Array) -> BoolArray:
    """Return where the box is off the target, or the target absent."""
    return np.nan_to_num(overlap, nan=0.0) < OFF_TARGET


def true_runs(mask: BoolArray) -> list[tuple[int, int]]:
    """Return (begin, end), the end exclusive, of each run of consecutive true values."""
    edges = np.diff(np.concatenate([[0], np.asarray(mask).astype(np.int8), [0]]))
    return [(int(begin), int(end)) for begin, end in zip(
        np.flatnonzero(edges == 1), np.flatnonzero(edges == -1))]


def _pair(boxes: ArrayLike, truth: ArrayLike) -> tuple[Array, Array]:
    a, b = checked_boxes(boxes), checked_boxes(truth, 'truth')
    if a.shape != b.shape:
        raise ValueError(f'{len(a)} boxes but {len(b)} rows of truth')
    return a, b


def _share(values: Array, compare: np.ufunc, thresholds: Array) -> Array:
    """Return, for each threshold, the share of finite values with `compare(value, threshold)`."""
    valid = values[np.isfinite(values)]
    if not len(valid):
        return np.full(len(thresholds), np.nan)
    share: Array = compare(valid[:, None], thresholds).mean(axis=0)
    return share
