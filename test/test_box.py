"""Boxes: which values are accepted, and which are refused."""

from fractions import Fraction

import numpy as np
import pytest

from vtrack_ros.geometry import Box


@pytest.mark.parametrize('number', [3, 3.0, np.float32(3), np.int64(3), np.array(3), Fraction(3)])
def test_real_numbers(number):
    """Real numbers of any type are accepted, and become floats."""
    box = Box(number, number, number, number)
    assert box == Box(3.0, 3.0, 3.0, 3.0)
    assert {type(value) for value in vars(box).values()} == {float}


@pytest.mark.parametrize('value', ['3', b'3', None, 3j, [3], np.array([3, 4])])
def test_what_is_no_number(value):
    """It's a TypeError that names the value, even if `float` would accept it."""
    with pytest.raises(TypeError, match='box width must be a number'):
        Box(1, 2, value, 4)


@pytest.mark.parametrize('size, words', [
    (0, 'positive'), (-1, 'positive'), (np.nan, 'finite'), (np.inf, 'finite'),
    pytest.param(10**400, 'finite', id='larger than any float')])
def test_what_is_no_size(size, words):
    """A size that isn't positive and finite is refused."""
    with pytest.raises(ValueError, match=words):
        Box(1, 2, 3, size)


@pytest.mark.parametrize('side', [1e-200, 1.0, 1e200])
def test_the_overlap_does_not_depend_on_the_unit(side):
    """Also where an area is no float: half of one box is a quarter of the other."""
    box, other = Box(0, 0, side, 2 * side), Box(0, side, 2 * side, 2 * side)
    assert box.iou(other) == other.iou(box) == pytest.approx(1 / 5)
    assert box.iou(box) == 1


@pytest.mark.parametrize('angle', [0.0, 0.4, -1.0, np.pi / 2, 3.0])
def test_the_box_around_a_turned_ellipse(angle):
    """It touches the ellipse on all sides: the extremes of its points."""
    around = np.linspace(0, 2 * np.pi, 10001)
    x, y = 20 * np.cos(around), 7 * np.sin(around)
    xs, ys = np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y
    box = Box.around_ellipse((100.0, 80.0), (40.0, 14.0), angle)
    assert box.center == pytest.approx((100, 80))
    assert (box.width, box.height) == pytest.approx((np.ptp(xs), np.ptp(ys)), abs=1e-4)
