"""A response map: its maximum, its local maxima, and dominated places."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vtrack_ros.localisation import ResponseMap
from vtrack_ros.localisation.search_window import Grid

ROWS, COLUMNS, CELL = 20, 24, (5.0, 4.0)
CENTER = 300.0, 200.0


def hill(x, y, height):
    """Return a paraboloid with its top at a place in cells from the middle, 0 at its foot."""
    across = np.arange(COLUMNS)[None, :] - COLUMNS // 2 - x
    down = np.arange(ROWS)[:, None] - ROWS // 2 - y
    return np.maximum(height - 0.05 * (across**2 + down**2), 0).astype(np.float32)


def place(x, y):
    """Return a place in pixels, from its cells from the middle."""
    return CENTER[0] + x * CELL[0], CENTER[1] + y * CELL[1]


def response(values, angle=0.0):
    """Return a map of these values; it doesn't depend on the window's content."""
    return ResponseMap(Grid(CENTER, CELL, angle), values)


@pytest.mark.parametrize('x, y', [(0.0, 0.0), (3.3, -2.2), (-5.4, 4.4)])
def test_the_highest_is_between_the_cells(x, y):
    """The maximum of a paraboloid is found to 1e-4 px; `peak` is the highest cell's value."""
    found = response(hill(x, y, 1.0))
    assert found.peak == found.values.max()
    assert found.center == pytest.approx(place(x, y), abs=1e-4)


@pytest.mark.parametrize('start', [(5.0, 0.0), (7.0, 1.0), (3.3, -2.2), (5.2, -4.1), (2.0, 1.0)])
def test_uphill_leads_to_the_highest_from_its_own_hill(start):
    """From anywhere on the highest hill the local maximum is exactly the map's maximum."""
    found = response(np.maximum(hill(3.3, -2.2, 1.0), hill(-6.2, 4.1, 0.8)))
    assert found.local_maximum(place(*start)) == found.center


def test_uphill_leads_to_a_lesser_top_from_its_hill_unless_it_is_dominated():
    """The climb stays on the lower hill; its top is dominated if the other one is much higher."""
    for height, believed in ((0.98, True), (0.8, False)):
        found = response(np.maximum(hill(3.0, -2.0, 1.0), hill(-6.0, 4.0, height)))
        lesser = found.local_maximum(place(-5.0, 5.0))
        assert lesser == (pytest.approx(place(-6.0, 4.0)[0]), pytest.approx(place(-6.0, 4.0)[1]))
        assert found.unless_dominated(lesser, found.center) == (
            lesser if believed else found.center)
    assert found.unless_dominated(found.center, lesser) == found.center


def test_the_highest_at_the_border_is_at_its_cell():
    """A maximum at the border isn't refined."""
    values = np.zeros((ROWS, COLUMNS), np.float32)
    values[0, 5] = 1
    found = response(values)
    assert (found.peak, found.center) == (1.0, place(5 - COLUMNS // 2, -ROWS // 2))


def test_sharpness_is_the_peak_to_sidelobe_ratio():
    """It's the peak minus the mean of the cells away from it, in their standard deviations."""
    values = np.random.default_rng(1).normal(0.1, 0.05, (ROWS, COLUMNS)).astype(np.float32)
    values[6:11, :4] = 0.8
    values[8, 1] = 0.9
    away = np.ones(values.shape, bool)
    away[5:12, :5] = False
    sidelobe = values[away].astype(float)
    assert response(values).sharpness == pytest.approx(
        (0.9 - sidelobe.mean()) / sidelobe.std(), rel=1e-4)
    assert response(np.zeros_like(values)).sharpness == 0


@pytest.mark.parametrize('angle', [0.0, 0.6, -2.5])
def test_places_of_a_turned_window_turn_with_it(angle):
    """Cells and places convert both ways; one cell to the right is a step along the angle."""
    found = response(hill(3.3, -2.2, 1.0), angle)
    along = found.window.at((1.0, 0.0))
    assert along == pytest.approx((CENTER[0] + CELL[0] * math.cos(angle),
                                   CENTER[1] + CELL[0] * math.sin(angle)))
    assert found.center == pytest.approx(found.window.at((3.3, -2.2)), abs=1e-4)
    places = CENTER + np.random.default_rng(0).uniform(-30, 30, (20, 2))
    for place_, cells, value in zip(places, found.cells(places), found.sample(places)):
        shift = found.window.shift(place_)
        assert found.window.at(shift) == pytest.approx(place_)
        assert cells - (COLUMNS // 2, ROWS // 2) == pytest.approx(shift)
        assert found.place(cells) == pytest.approx(place_)
        assert found.sample_one(place_) == pytest.approx(value, abs=1e-6)
