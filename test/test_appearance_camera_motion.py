"""The camera's motion between two frames."""

from drawn_video import texture
import numpy as np
import pytest

from vtrack_ros.appearance.image_motion import SparsePicture

SCENE = texture((400, 520), [(40, 60, 80), (200, 190, 180), (120, 90, 160)], 25,
                np.random.default_rng(2))


def measured(first, second):
    """Return the camera's step from one picture to another."""
    return SparsePicture.of(first).camera_step(SparsePicture.of(second))


def view(x, y):
    """Return the image of a camera that is turned by (x, y) pixels."""
    return SCENE[60 + y:300 + y, 80 + x:400 + x]


@pytest.mark.parametrize('x, y', [(0, 0), (12, -7), (-30, 20), (45, 0)])
@pytest.mark.parametrize('grey', [False, True])
def test_a_turn_moves_the_picture(x, y, grey):
    """The measured step is the image's, to 2.5 px: only every fourth pixel is used."""
    first, second = view(0, 0), view(x, y)
    if grey:
        first, second = first[:, :, 0], second[:, :, 0]
    shift = measured(first, second)
    assert shift == (pytest.approx(-x, abs=2.5), pytest.approx(-y, abs=2.5))


@pytest.mark.parametrize('shape', [(20000, 100), (20000, 300), (4000, 120), (100, 20000)])
def test_a_picture_of_any_shape_is_small(shape):
    """It has less than 2 x 128 columns, and 2 x 1024 rows."""
    picture = SparsePicture.of(np.zeros(shape, np.uint8))
    assert picture.pixels.shape[0] < 2048 and picture.pixels.shape[1] < 256


def test_pictures_without_anything_in_common_say_nothing():
    """Unrelated pictures give None, not an arbitrary motion."""
    rng = np.random.default_rng(0)
    first, second = (rng.integers(256, size=(240, 320), dtype=np.uint8) for _ in range(2))
    assert measured(first, second) is None


@pytest.mark.parametrize('shape', [(1, 1, 3), (1, 40, 3), (5, 300)])
def test_a_sliver_of_a_frame_says_nothing(shape):
    """A frame with too few rows or columns gives None."""
    frame = np.zeros(shape, np.uint8)
    assert measured(frame, frame) is None
