"""The affine group: exponential, logarithm, mean, bounds."""

from hypothesis import given, settings, strategies as st
import numpy as np
from numpy.testing import assert_allclose
import pytest
import scipy.linalg

from vtrack_ros.geometry import affine

_SMALL = st.lists(st.floats(-0.6, 0.6), min_size=6, max_size=6).map(np.array)


def _random(spread, count=200, seed=0):
    return np.random.default_rng(seed).standard_normal((count, 6)) * spread


@pytest.mark.parametrize('spread', [0.0, 1e-9, 1e-6, 1e-5, 1e-3, 0.1, 1.0, 3.0])
def test_exponential_is_the_matrix_exponential(spread):
    elements = affine.from_coordinates(_random(spread))
    expected = np.array([scipy.linalg.expm(element) for element in elements])
    assert_allclose(affine.exponential(elements), expected, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize('coordinates', [
    (0, 0.3, 0.3, 0, 1, 2),  # nilpotent: equal eigenvalues, but no multiple of the identity
    (0.2, 0, 0, 0, 1, -1), (0, 0, 1.5, 0, 3, 4), (0, 0.7, 0, 0.1, -2, 1), (0, 0, 0, 0, 5, -7)])
def test_exponential_of_special_elements(coordinates):
    element = affine.from_coordinates(np.array(coordinates, float))
    assert_allclose(affine.exponential(element), scipy.linalg.expm(element), atol=1e-9)


@given(_SMALL)
@settings(max_examples=60, deadline=None)
def test_logarithm_inverts_the_exponential(coordinates):
    element = affine.from_coordinates(coordinates)
    assert_allclose(affine.logarithm(affine.exponential(element)), element, atol=1e-8)


@pytest.mark.parametrize('size', [1e-6, 1e-3, 1e3, 1e6])
def test_logarithm_of_a_map_by_any_scale(size):
    uniform = np.diag([size, size, 1.0])
    assert_allclose(affine.logarithm(uniform), np.log(size) * np.diag([1.0, 1.0, 0.0]), atol=1e-9)
    element = affine.from_coordinates([np.log(size), 0.02, 0.3, -0.01, 0.0, 0.0])
    assert_allclose(affine.logarithm(scipy.linalg.expm(element)), element, atol=1e-8)


def test_logarithm_is_undefined_from_half_a_turn_and_for_mirror_images():
    half_turn, mirrored = np.diag([-1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0])
    assert np.isnan(affine.logarithm(np.array([half_turn, mirrored]))).all()


def test_coordinates_are_what_their_names_say():
    scale, aspect, turn, skew, x, _ = affine.exponential(
        affine.from_coordinates(0.1 * np.eye(6)))
    assert_allclose(scale[:2, :2], np.exp(0.1) * np.eye(2))
    assert_allclose(aspect[:2, :2], np.diag([np.exp(0.1), np.exp(-0.1)]))
    # clockwise on a screen whose y points down: the x axis turns towards y
    assert_allclose(turn[:2, 0], (np.cos(0.1), np.sin(0.1)))
    assert_allclose(skew[:2, :2], [[np.cosh(0.1), np.sinh(0.1)], [np.sinh(0.1), np.cosh(0.1)]])
    assert_allclose(x, [[1, 0, 0.1], [0, 1, 0], [0, 0, 1]])


def test_inverse():
    transformations = affine.exponential(affine.from_coordinates(_random(0.5)))
    product = transformations @ affine.inverse(transformations)
    assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-9)


def test_group_mean_of_symmetric_noise_is_its_middle():
    middle = affine.exponential(affine.from_coordinates(
        np.array([0.3, 0.1, 0.8, -0.1, 20.0, -5.0])))
    noise = _random(0.02, 500, seed=3)
    pairs = np.concatenate([noise, -noise])
    # heaviest in the middle, where symmetric noise stays symmetric
    steps = affine.exponential(affine.from_coordinates(np.concatenate([np.zeros((1, 6)), pairs])))
    weights = np.concatenate([[2.0], np.ones(len(pairs))])
    mean = affine.group_mean(middle @ steps, weights)
    assert_allclose(mean, middle, atol=2e-3)


def test_group_mean_averages_rotations_not_matrices():
    turns = np.array([-0.5, 0.0, 0.5])
    states = np.repeat(np.eye(3)[None], 3, 0)
    states[:, :2, :2] = affine.rotation(turns)
    mean = affine.group_mean(states, np.array([1.0, 1.1, 1.0]))
    assert_allclose(mean, np.eye(3), atol=1e-12)  # the arithmetic mean would shrink


def test_group_mean_weighs_translations_arithmetically():
    states = np.repeat(np.eye(3)[None], 2, 0)
    states[1, :2, 2] = 8.0, -4.0
    assert_allclose(affine.group_mean(states, np.array([3.0, 1.0]))[:2, 2], (2.0, -1.0))


def test_group_mean_survives_a_particle_that_is_half_a_turn_away():
    states = np.array([np.eye(3), np.eye(3), np.diag([-1.0, -1.0, 1.0])])
    assert_allclose(affine.group_mean(states, np.array([2.0, 1.0, 1.0])), np.eye(3), atol=1e-12)


def test_angle_scale_and_stretch():
    vector = np.array([np.log(3.0), np.log(1.2), 0.7, 0.0, 5.0, 6.0])
    state = affine.from_vector(vector)
    assert affine.angle(state) == pytest.approx(0.7)
    assert affine.scale(state) == pytest.approx(3.0)
    assert affine.stretch(state) == pytest.approx(1.2**2)
    assert_allclose(state[:2, 2], (5, 6))


def test_the_direction_of_the_stretch_is_counted_against_the_rotation():
    """What lies in that direction is stretched, and what is across it compressed."""
    linear = affine.from_vector(np.array([0.0, np.log(2.0), 0.0, 0.5, 0.0, 0.0]))[:2, :2]
    along, across = affine.rotation(np.asarray(-0.5)).T
    assert_allclose(linear @ along, 2 * along)
    assert_allclose(linear @ across, across / 2)


def test_bounds_of_a_turned_rectangle():
    state = np.eye(3)
    state[:2, :2] = affine.rotation(np.asarray(np.pi / 2))
    state[:2, 2] = 10, 20
    assert_allclose(affine.bounds(state, (4.0, 2.0)), (10, 20, 2, 4), atol=1e-12)
    state[:2, :2] = affine.rotation(np.asarray(np.pi / 4))
    corners = np.array([[2, 1], [2, -1], [-2, 1], [-2, -1]]) @ state[:2, :2].T
    assert_allclose(affine.bounds(state, (4.0, 2.0))[2:], 2 * corners.max(0))


@pytest.mark.parametrize('turn', [0.0, 0.4, np.pi / 2])
def test_ellipse_bounds_touch_the_turned_ellipse(turn):
    state = _turned(turn)
    circle = np.linspace(0, 2 * np.pi, 4000)
    border = np.stack([2.0 * np.cos(circle), np.sin(circle)], 1) @ state[:2, :2].T
    x, y, width, height = affine.ellipse_bounds(state, (4.0, 2.0))
    assert (x, y) == (10, 20)
    assert_allclose((width, height), 2 * border.max(0), rtol=1e-5)
    assert_allclose(affine.ellipse_bounds(state, (3.0, 3.0))[2:], 3.0)  # a round one stays


def _turned(turn):
    state = np.eye(3)
    state[:2, :2] = affine.rotation(np.asarray(turn))
    state[:2, 2] = 10, 20
    return state


def test_a_turned_rectangle_is_the_image_of_the_unit_square():
    """A positive angle turns clockwise as one looks at the image: x right, y down."""
    matrix = affine.transformation((30.0, 20.0), (10.0, 4.0), np.pi / 2)
    assert matrix @ (0.5, 0, 1) == pytest.approx([30, 25, 1])
    assert matrix @ (0, 0.5, 1) == pytest.approx([28, 20, 1])
