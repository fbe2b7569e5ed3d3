"""The worst moments of a sequence, as pictures with everybody's box in them."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from itertools import chain, zip_longest

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.evaluation import metrics
from vtrack_ros.evaluation.running import Run
from vtrack_ros.evaluation.sequences import Sequence
from vtrack_ros.frame import Frame


@dataclass(frozen=True)
class Moment:
    """
    A frame in which a tracker is at its worst.

    Parameters
    ----------
    index : int
        The frame, from 0.
    tracker : str
        Whose worst moment it is.
    overlap : float
        That tracker's overlap with the truth; NaN where the target is absent.

    """

    index: int
    tracker: str
    overlap: float


def worst_moments(
        runs: Mapping[str, Run], truth: NDArray[np.float64], limit: int = 3,
        apart: int = 8) -> list[Moment]:
    """
    Return the worst moments of a sequence's runs.

    Those of a tracker are where its stretches off the target begin, the longest first, and then
    the frames of its least overlap. Every tracker has its turn, the worst one first; moments that
    are closer to one another than `apart` frames count as one.

    Returns
    -------
    moments : list of Moment
        At most `limit`, in the order of time.

    """
    overlaps = {label: metrics.overlaps(run.boxes, truth) for label, run in runs.items()}
    worst_first = sorted(overlaps, key=lambda label: float(np.nanmean(overlaps[label])))
    turns = zip_longest(*(
        [(label, index) for index in _candidates(overlaps[label])] for label in worst_first))
    chosen: list[Moment] = []
    for candidate in chain.from_iterable(turns):
        if candidate is None or len(chosen) == limit:
            continue
        label, index = candidate
        if all(abs(index - other.index) >= apart for other in chosen):
            chosen.append(Moment(index, label, float(overlaps[label][index])))
    return sorted(chosen, key=lambda moment: moment.index)


def moment_figure(
        moment: Moment, frame: Frame, sequence: Sequence, runs: Mapping[str, Run],
        colors: Mapping[str, str], width: int = 306) -> str:
    """Return a moment as an HTML figure: the picture, the boxes over it and what one sees."""
    high, wide = frame.shape[:2]
    scale = min(1.0, 2 * width / wide)
    small = cv2.resize(frame, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    encoded = cv2.imencode('.jpg', small, (cv2.IMWRITE_JPEG_QUALITY, 75))[1]
    picture = base64.b64encode(encoded.tobytes()).decode()
    stroke = wide / width * 2
    boxes = []
    truth = sequence.truth[moment.index]
    if np.isfinite(truth).all():
        boxes.append(_rectangle(truth, 'truth', '#000', stroke * 1.8))
        boxes.append(_rectangle(truth, 'truth', '#fff', stroke, dashed=True))
    boxes.extend(_rectangle(run.boxes[moment.index], label, colors[label], stroke)
                 for label, run in runs.items())
    where = ('the target is absent' if np.isnan(moment.overlap)
             else f'overlap {moment.overlap:.2f}')
    return (
        f'<figure><svg viewBox="0 0 {wide} {high}" width="{width}" '
        f'height="{round(width * high / wide)}" role="img">'
        f'<image href="data:image/jpeg;base64,{picture}" width="{wide}" height="{high}"/>'
        f'{"".join(boxes)}</svg><figcaption>frame {moment.index}: '
        f'{escape(moment.tracker)}, {where}</figcaption></figure>')


def _candidates(overlap: NDArray[np.float64]) -> list[int]:
    known = np.nan_to_num(overlap, nan=1.0)
    losses = sorted(metrics.stretches(known < metrics.OFF_TARGET),
                    key=lambda stretch: stretch[0] - stretch[1])
    least = np.argsort(known, kind='stable')
    return [begin for begin, _ in losses] + [int(index) for index in least]


def _rectangle(
        box: NDArray[np.float64], label: str, color: str, stroke: float,
        dashed: bool = False) -> str:
    x, y, width, height = box
    dash = f' stroke-dasharray="{3 * stroke:.1f} {2 * stroke:.1f}"' if dashed else ''
    return (f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" fill="none" '
            f'stroke="{color}" stroke-width="{stroke:.1f}"{dash}><title>{escape(label)}</title>'
            '</rect>')
