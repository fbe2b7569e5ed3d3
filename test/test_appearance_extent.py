"""The extent of the object at a point, such as a click."""

import numpy as np
import pytest

from vtrack_ros.appearance.extent import find_extent
from vtrack_ros.geometry import Box


def picture(box, height=240, width=320, seed=0):
    """Return a ground of noise with a box of another colour."""
    frame = np.random.default_rng(seed).integers(90, 120, (height, width, 3), np.uint8)
    x, y, w, h = (int(value) for value in box.as_array())
    frame[y:y + h, x:x + w] = (40, 60, 200)
    return frame


@pytest.mark.parametrize('width, height', [
    (40, 40), (24, 60), (80, 44), (16, 16), (110, 110), (200, 170), (110, 215)])
def test_thing_of_one_colour(width, height):
    """The extent of an object of a distinct colour is found, whatever its size and shape."""
    box = Box.from_center(150, 110, width, height)
    assert find_extent(picture(box), 150, 110).iou(box) > 0.6


def test_grey():
    """In a grey image an object is found by its lightness."""
    box = Box(100, 80, 50, 50)
    grey = picture(box)[..., 1]
    assert find_extent(grey, *box.center).iou(box) > 0.6


def test_same_answer_again():
    """The same input gives the same box: nothing is random."""
    box = Box(100, 80, 50, 30)
    assert find_extent(picture(box), 120, 90) == find_extent(picture(box), 120, 90)


def test_scales_with_the_image():
    """A picture of twice the size has a box of twice the size."""
    box = Box(100, 80, 50, 50)
    frame = picture(box)
    twice = frame.repeat(2, axis=0).repeat(2, axis=1)
    small, large = find_extent(frame, 125, 105), find_extent(twice, 250, 210)
    assert large.width == pytest.approx(2 * small.width, rel=0.35)


@pytest.mark.parametrize('x, y', [(0, 0), (320, 240), (319.5, 10), (0.2, 239)])
def test_at_the_border(x, y):
    """The box is inside the image, wherever the point is."""
    frame = np.random.default_rng(1).integers(0, 255, (240, 320, 3), np.uint8)
    box = find_extent(frame, x, y)
    assert box.clipped(320, 240) == box


@pytest.mark.parametrize('shape', [(1, 1), (1, 40, 3), (3, 5), (40, 2, 3), (600, 20),
                                   (6000, 2, 3), (3000, 1)])
def test_tiny_and_narrow_pictures(shape):
    """A picture of any shape gives a box with an area."""
    box = find_extent(np.zeros(shape, np.uint8), shape[1] / 2, shape[0] / 2)
    assert box.width > 0 and box.height > 0


@pytest.mark.parametrize('width, height', [(40, 40), (24, 60), (80, 44)])
def test_thing_of_its_surroundings_colours(width, height):
    """A textured object on a smooth background of the same grey levels is found."""
    rng = np.random.default_rng(2)
    levels = rng.integers(60, 180, (240, 320), np.uint8)
    # the same levels in order: a ground without an edge
    frame = np.sort(levels.ravel()).reshape(levels.shape)
    box = Box.from_center(150, 110, width, height)
    x, y, w, h = (int(value) for value in box.as_array())
    frame[y:y + h, x:x + w] = rng.choice(frame[:, x:x + w].ravel(), (h, w))
    assert find_extent(frame, 150, 110).iou(box) > 0.6


@pytest.mark.parametrize('side, height', [(24, 120), (16, 90), (40, 400)])
def test_check_in_noise(side, height):
    """An object of two colours is found as a whole, not a corner of it, in small pictures too."""
    rng = np.random.default_rng(5)
    frame = rng.integers(60, 110, (height, height, 3), np.uint8)
    check = np.kron(rng.integers(0, 2, (4, 4)), np.ones((side // 4, side // 4), int))
    colours = np.array([[20, 30, 220], [230, 220, 30]], np.uint8)
    box = Box(height // 3, height // 3, side, side)
    frame[height // 3:height // 3 + side, height // 3:height // 3 + side] = colours[check]
    assert find_extent(frame, *box.center).iou(box) > 0.6


@pytest.mark.parametrize('side', [10, 14, 20])
def test_small_thing_in_a_large_picture(side):
    """An object of about 1 to 2 % of the picture's height is found, as seen from a drone."""
    box = Box.from_center(640, 400, side, side)
    frame = picture(box, 1080, 1280)
    assert find_extent(frame, *box.center).iou(box) > 0.6


@pytest.mark.parametrize('x, y', [(140, 102), (160, 118), (158, 100), (142, 120)])
def test_click_beside_the_middle(x, y):
    """The box is centred at the object that was clicked on, not at the click."""
    box = Box.from_center(150, 110, 50, 40)
    found = find_extent(picture(box), x, y)
    assert found.iou(box) > 0.6
    assert np.hypot(*np.subtract(found.center, box.center)) < np.hypot(x - 150, y - 110) - 3
