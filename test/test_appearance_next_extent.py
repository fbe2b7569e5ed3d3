"""The next larger or smaller extent about a box."""

import numpy as np
import pytest

from vtrack_ros.appearance.extent import find_extent, next_extent
from vtrack_ros.geometry import Box

#: A figure of two colours, in pixels: the whole, and the upper of its two parts.
WHOLE, PART = Box(130, 60, 60, 120), Box(130, 60, 60, 60)


def figure():
    """Return noise with a figure that has an upper part of one colour, a lower one of another."""
    frame = np.random.default_rng(0).integers(90, 120, (240, 320, 3), np.uint8)
    frame[60:120, 130:190] = (40, 60, 200)
    frame[120:180, 130:190] = (190, 70, 40)
    return frame


def test_from_the_part_to_the_whole():
    """A click on a part finds that; the next larger extent is the whole."""
    part = find_extent(figure(), *PART.center)
    assert part.iou(PART) > 0.6
    assert next_extent(figure(), part, larger=True).iou(WHOLE) > 0.6


def test_from_the_whole_to_the_part():
    """The next smaller extent than that of a thing with its surroundings is the thing."""
    thing = Box(140, 90, 40, 40)
    frame = np.random.default_rng(0).integers(90, 120, (240, 320, 3), np.uint8)
    frame[90:130, 140:180] = (40, 60, 200)
    assert next_extent(frame, Box(120, 70, 80, 80), larger=False).iou(thing) > 0.6


@pytest.mark.parametrize('kind', ['colour', 'grey'])
@pytest.mark.parametrize('center', [(160, 120), (3, 40), (319, 239), (-5, 100)])
@pytest.mark.parametrize('larger', [True, False])
def test_step_by_step_to_the_end(kind, center, larger):
    """Each extent differs in area by a factor of 1.5, is inside, and the last one is said."""
    frame = figure() if kind == 'colour' else figure()[..., 0].copy()
    box = Box.from_center(*center, 30, 40)
    with pytest.raises(ValueError, match='found no extent of .* in the image of 320 x 240'):
        for _ in range(30):
            found = next_extent(frame, box, larger)
            assert found.clipped(320, 240) == found
            ratio = found.area / box.area
            assert ratio >= 1.5 - 1e-9 if larger else ratio <= 1 / 1.5 + 1e-9
            box = found


def test_same_answer_again():
    """It's deterministic."""
    box = Box(140, 80, 30, 40)
    assert next_extent(figure(), box, True) == next_extent(figure(), box, True)


@pytest.mark.parametrize('shape', [(1, 1), (1, 40, 3), (40, 2, 3)])
def test_tiny_pictures(shape):
    """Where there's no room for another extent, that is said."""
    frame = np.zeros(shape, np.uint8)
    with pytest.raises(ValueError, match='found no extent'):
        next_extent(frame, Box(0, 0, shape[1], shape[0]), larger=True)
