"""Neighbouring windows that are described together equal windows that are described alone."""

from __future__ import annotations

import math

import cv2
from drawn_video import COLOURS, texture
import numpy as np
import pytest

from vtrack_ros.localisation.search_window import SAMPLES, WindowLayout

# a window has as many pixels as samples: nothing is resampled
LAYOUT = WindowLayout.around(40, 40)
SIDE = LAYOUT.columns * SAMPLES
SIZE = (SIDE / LAYOUT.reach[0], SIDE / LAYOUT.reach[1])
HERE = (200.0, 160.0)
AROUND = [(right, down) for right in (-1, 0, 1) for down in (-1, 0, 1)]
FRAME = texture((320, 400), COLOURS, 12, np.random.default_rng(3))


@pytest.mark.parametrize('channels', [3, 1])
def test_windows_described_together_are_those_described_alone(channels):
    """Image and colours are identical, and the features nearly so: they differ near the border."""
    frame = FRAME if channels == 3 else cv2.cvtColor(FRAME, cv2.COLOR_BGR2GRAY)
    beside = LAYOUT.windows_beside(frame, HERE, SIZE, 0.0, AROUND)
    for (right, down), found in zip(AROUND, beside, strict=True):
        center = HERE[0] + right * SIDE / 2, HERE[1] + down * SIDE / 2
        alone = LAYOUT.window(frame, center, SIZE)
        assert (found.center, found.cell) == (alone.center, alone.cell)
        assert found.size == pytest.approx(alone.size)
        np.testing.assert_array_equal(found.grey, alone.grey)
        np.testing.assert_array_equal(found.colours, alone.colours)
        error = np.linalg.norm(found.spectrum - alone.spectrum)
        assert error < 0.02 * np.linalg.norm(alone.spectrum)


@pytest.mark.parametrize('side', [16.0, 17.0, 33.0, 40.7])
def test_windows_beside_are_of_whole_pixels(side):
    """Each is the part of the frame that it says it is, whatever the target's size."""
    layout = WindowLayout.around(side, side)
    for found in layout.windows_beside(FRAME, HERE, (side, side), 0.0, AROUND):
        width, height = found.cell[0] * layout.columns, found.cell[1] * layout.rows
        assert (found.pixels.width, found.pixels.height) == (width, height)
        assert found.pixels.center == found.center


@pytest.mark.parametrize('angle', [0.5, -2.0])
def test_windows_beside_a_turned_one_are_turned_with_it(angle):
    """Their centres are half a window along its own sides, and they show what is there."""
    beside = LAYOUT.windows_beside(FRAME, HERE, SIZE, angle, [(1, 0), (0, 1)])
    sides = (math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))
    for found, (x, y) in zip(beside, sides, strict=True):
        center = HERE[0] + SIDE / 2 * x, HERE[1] + SIDE / 2 * y
        assert found.center == pytest.approx(center)
        assert found.angle == angle
        alone = LAYOUT.window(FRAME, center, SIZE, angle)
        # a window alone is moved to whole pixels
        assert np.corrcoef(found.grey.ravel(), alone.grey.ravel())[0, 1] > 0.97
