"""Mean shift on a map, and its fusion with particles."""

from __future__ import annotations

import numpy as np
import pytest

from vtrack_ros.localisation.mean_shift import climb, climbing_weights, fuse


@pytest.mark.parametrize('zeta, best, expected', [
    (0.9, (1.0, 0.0), (0.1, 0.0)),     # eq. 13: they agree, weighted by the similarity
    (0.9, (10.0, 0.0), (0.0, 0.0)),    # eq. 13: mean shift where they're compatible
    (0.9, (30.0, 0.0), None),          # eq. 13: they contradict each other
    (0.6, (10.0, 0.0), (10.0, 0.0)),   # eq. 14: the particles where the target changed
    (0.6, (30.0, 0.0), None),
    (0.5, (30.0, 0.0), (30.0, 0.0)),   # eq. 15: hidden, the particles alone
])
def test_fusion_is_that_of_equations_13_to_15(zeta, best, expected):
    """Every case of the fusion rule."""
    place = fuse(zeta, (0.0, 0.0), best, 2.5, 20.0, 0.8, 0.5)
    assert place == (None if expected is None else pytest.approx(expected))


def test_a_climb_on_a_map_ends_on_its_nearest_hill():
    """Between two hills the nearer one is climbed, to a fraction of a cell."""
    y, x = np.mgrid[:30, :40].astype(np.float64)
    hills = np.exp(-((x - 10.3)**2 + (y - 12.6)**2) / 8) + np.exp(
        -((x - 30)**2 + (y - 20)**2) / 8)
    found = climb(hills, np.array([12.0, 10.0]), np.array([1.5, 1.5]), 50)
    assert found == pytest.approx([10.3, 12.6], abs=0.05)
    assert climb(hills, np.array([28.0, 18.0]), np.array([1.5, 1.5]), 50) == pytest.approx(
        [30, 20], abs=0.05)


def test_weights_are_what_is_above_the_background():
    """They're the cube of the response's excess over its mean, and 0 below the mean."""
    response = np.array([[0.0, 0.0, 0.0, 0.3, 0.5, -0.2]], np.float32)
    np.testing.assert_allclose(
        climbing_weights(response), [[0, 0, 0, 0.2**3, 0.4**3, 0]], atol=1e-7)
