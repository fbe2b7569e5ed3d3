"""The exemplar, a picture of the target at its selection, and images made from it."""

import cv2
import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.session.exemplar import Exemplar


def smooth(rows, columns, colour=True):
    """Return an image of smooth blobs."""
    noise = np.random.default_rng(0).normal(size=(rows, columns, 3 if colour else 1))
    blobs = cv2.GaussianBlur(noise, (0, 0), 6).reshape(rows, columns, -1)
    image = (128 + 40 * blobs / blobs.std()).clip(0, 255).astype(np.uint8)
    return image if colour else image[:, :, 0]


@pytest.mark.parametrize('colour', [True, False])
def test_in_its_own_place_it_is_what_was_seen(colour):
    """It's four of the target's sides wide; placed in its own box it equals the frame."""
    frame, box = smooth(240, 320, colour), Box(130, 90, 40, 30)
    exemplar = Exemplar.of(frame, box)
    assert exemplar.picture.shape[:2] == (160, 160) and exemplar.box == Box(60, 65, 40, 30)
    placed = exemplar.placed(box, frame.shape)
    np.testing.assert_array_equal(placed[30:180, 75:225], frame[30:180, 75:225])
    assert placed.shape == frame.shape


def test_it_fills_another_box():
    """It's moved and scaled with its surroundings: a ramp becomes one of another slope."""
    x = np.arange(200) + 0.5
    exemplar = Exemplar.of(np.tile(x, (150, 1)).astype(np.uint8), Box(80, 50, 40, 40))
    placed = exemplar.placed(Box(30.5, 60.25, 60, 20), (120, 160))
    columns = 80 + (np.arange(160) + 0.5 - 30.5) * 40 / 60
    np.testing.assert_allclose(placed[65:75, 10:110], np.tile(columns[10:110], (10, 1)), atol=1.5)


@pytest.mark.parametrize('colour', [True, False])
def test_it_turns_clockwise_about_the_box(colour):
    """By a quarter turn, what was to the right of the target is below it."""
    frame, box = smooth(240, 320, colour), Box(130, 90, 40, 40)
    placed = Exemplar.of(frame, box).placed(box, frame.shape, np.pi / 2)
    difference = placed[40:180, 80:220].astype(int) - np.rot90(frame[40:180, 80:220], -1)
    assert np.abs(difference).max() <= 1


def test_a_large_one_is_kept_small():
    """It's scaled down to 256 pixels, and placed in its original size again."""
    frame, box = smooth(1200, 1600), Box(500, 400, 300, 240)
    exemplar = Exemplar.of(frame, box)
    assert max(exemplar.picture.shape) == 256
    difference = np.abs(exemplar.placed(box, frame.shape)[400:640, 500:800].astype(int)
                        - frame[400:640, 500:800])
    assert difference.mean() < 5


def test_it_does_not_change_with_the_frame():
    """It's a copy, for a driver may write the next image into the same memory."""
    frame = smooth(240, 320)
    exemplar = Exemplar.of(frame, Box(130, 90, 40, 30))
    before = exemplar.picture.copy()
    frame[:] = 0
    np.testing.assert_array_equal(exemplar.picture, before)


def test_over_the_border_it_is_what_there_is():
    """The picture ends at the frame's border, and the box keeps its place in it."""
    frame, box = smooth(240, 320), Box(-10, 200, 40, 60)
    exemplar = Exemplar.of(frame, box)
    assert exemplar.box.x == -10
    np.testing.assert_array_equal(
        exemplar.placed(box, frame.shape)[150:, :60], frame[150:, :60])
