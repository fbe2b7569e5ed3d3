"""Ellipses as bandwidth matrices: forms, axes, bounds and roots agree with each other."""

import math

import numpy as np
import pytest

from vtrack_ros.geometry.ellipse import (
    axes_of_bandwidth, bounded, bounds_of_bandwidth, SIGMA, square_root, turned)

#: Geometric mean of the axes 10 and 5.
FIRST = math.sqrt(50)


def bandwidth_of_axes(major, minor, angle):
    """Return H of the ellipse whose border is sigma bandwidths away [Yin2013, eq. 8]."""
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return turn @ np.diag([major, minor]) ** 2 @ turn.T / SIGMA**2


@pytest.mark.parametrize('major, minor, angle', [
    (40.0, 10.0, 0.0), (40.0, 10.0, math.pi / 2), (25.0, 24.0, 0.3), (7.5, 2.5, -1.2)])
def test_axes_and_angle_come_back(major, minor, angle):
    """Equation 10 inverts the construction from axes and angle."""
    found = axes_of_bandwidth(bandwidth_of_axes(major, minor, angle))
    assert found[:2] == pytest.approx((major, minor))
    assert math.remainder(found[2] - angle, math.pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize('frame, mean, ratio', [
    (np.diag([20.0, 12.0]), math.sqrt(240), 5 / 3), (np.diag([200.0, 80.0]), 4 * FIRST, 2.5),
    (np.diag([1.0, 2.0]), FIRST / 2, 2.0), (np.array([[0.0, -1.0], [50.0, 0.0]]), FIRST, 4.0)])
def test_a_frame_stays_within_bounds_about_the_first_one(frame, mean, ratio):
    """The axes' geometric mean is 0.5 to 4 times the first's, their ratio up to twice that."""
    axes = np.linalg.svd(bounded(frame, np.diag([10.0, 5.0]), (0.5, 4.0), 2.0))[1]
    assert (math.sqrt(math.prod(axes)), axes[0] / axes[1]) == pytest.approx((mean, ratio))


def test_the_bound_of_an_upright_ellipse():
    """Its sides are the axes, and it lies about the centre."""
    box = bounds_of_bandwidth((100.0, 50.0), bandwidth_of_axes(30.0, 15.0, 0.0))
    assert box.as_array() == pytest.approx([70.0, 35.0, 60.0, 30.0])


def test_the_bound_touches_a_rotated_ellipse():
    """No point of the border is outside the bound, and its sides are touched."""
    bandwidth = bandwidth_of_axes(30.0, 10.0, 0.7)
    turns = np.linspace(0, 2 * np.pi, 2000)
    circle = np.stack([np.cos(turns), np.sin(turns)])
    border = SIGMA * np.linalg.cholesky(bandwidth) @ circle
    # the border is where (s - y)^T H^-1 (s - y) is sigma^2 [Yin2013, eq. 8]
    form = np.einsum('in,ij,jn->n', border, np.linalg.inv(bandwidth), border)
    assert form == pytest.approx(SIGMA**2)
    box = bounds_of_bandwidth((0.0, 0.0), bandwidth)
    assert 2 * np.abs(border).max(1) == pytest.approx([box.width, box.height], rel=1e-4)


def test_an_angle_is_taken_near_the_previous_one():
    """Half turns, which leave an ellipse as it is, are added, so that an angle can grow on."""
    assert turned(-1.5, 1.6) == pytest.approx(-1.5 + math.pi)
    assert turned(0.2, 6.3) == pytest.approx(0.2 + 2 * math.pi)
    assert turned(0.2, 0.1) == pytest.approx(0.2)


def test_the_square_root_squared_is_the_matrix():
    """The root is symmetric, positive definite, and its square is the matrix."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        factor = rng.normal(size=(2, 2))
        matrix = factor @ factor.T + 0.01 * np.eye(2)
        root = square_root(matrix)
        assert root @ root == pytest.approx(matrix)
        assert root == pytest.approx(root.T)
        assert np.linalg.eigvalsh(root).min() > 0
