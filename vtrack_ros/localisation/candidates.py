"""Candidates for the target's place: the maxima of response maps, and a search's result."""

from dataclasses import dataclass
import math
from typing import TypeAlias

import cv2
import numpy as np

from vtrack_ros.frame import Point
from vtrack_ros.localisation.response_map import ResponseMap

#: Largest number of distinct maxima: a flat response has thousands.
_MOST = 50
#: A cell and its eight neighbours.
_NEIGHBOURS = np.ones((3, 3), np.uint8)

#: A maximum of a response: its place, in pixels, the response, and its value there.
Maximum: TypeAlias = tuple[Point, ResponseMap, float]


@dataclass(frozen=True)
class Found:
    """
    The result of a search: the response in the best window, and the target's place, in pixels.

    The `distractors` are the places, in pixels, of those so near that only motion tells which one
    is the target; `hidden` tells that one of them hides the target, so that the place is only the
    expected one. The `rival` is the highest maximum that was not chosen, in pixels. `motion` is
    what the target's motion to its place adds to the log-odds of its presence.
    """

    response: ResponseMap
    place: Point
    distractors: tuple[Point, ...] = ()
    hidden: bool = False
    rival: Point | None = None
    motion: float = 0.0


def strong(every: list[Maximum], share: float) -> list[Maximum]:
    """Return the maxima, sorted from the highest, with at least that share of the highest."""
    least = share_of(every[0][2], share)
    return [each for each in every if each[2] >= least]


def distinct(every: list[Maximum], apart: float) -> list[Maximum]:
    """Return the maxima, sorted from the highest, further than `apart` from all higher ones."""
    found: list[Maximum] = []
    for each in every:
        # a generator in `all` takes twice as long
        for higher in found:
            if math.dist(each[0], higher[0]) <= apart:
                break
        else:
            found.append(each)
            if len(found) == _MOST:
                break
    return found


def maxima(response: ResponseMap, share: float) -> list[tuple[Point, float]]:
    """Return the local maxima, in pixels, and their values, down to a share of the highest."""
    values = response.values
    highest = cv2.dilate(values, _NEIGHBOURS)
    least = share_of(response.peak, share)
    rows, columns = np.nonzero((values >= highest) & (values >= least))
    return [(response.maximum((column, row)), values.item(row, column))
            for row, column in zip(rows.tolist(), columns.tolist())]


def share_of(highest: float, share: float) -> float:
    """Return that share of the highest value; the value itself where it's below 0."""
    return min(share * highest, highest)
