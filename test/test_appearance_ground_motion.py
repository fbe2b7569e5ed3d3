"""By how much the ground about a target moved between two frames."""

import cv2
from drawn_video import texture
import numpy as np
import pytest

from vtrack_ros.appearance.image_motion import SparsePicture
from vtrack_ros.geometry import Box

SCENE = texture((800, 1000), [(40, 60, 80), (200, 190, 180), (120, 90, 160)], 25,
                np.random.default_rng(2))
NOWHERE = Box(-500, -500, 10, 10)


def view(x, y, width=320, height=240):
    """Return the image of a camera that is turned by (x, y) pixels."""
    return SCENE[160 + y:160 + height + y, 180 + x:180 + width + x]


def patch(width, height):
    """Return the texture of an object that isn't the ground."""
    return texture((height, width), [(10, 10, 10), (250, 250, 250)], 12, np.random.default_rng(4))


def pasted(background, thing, x, y):
    """Return the background with an object in front of it."""
    picture = background.copy()
    picture[y:y + thing.shape[0], x:x + thing.shape[1]] = thing
    return picture


def measured(first, second, target, far=False):
    """Return the ground's step from one picture to another."""
    return SparsePicture.of(first).ground_step(SparsePicture.of(second), target, far)


@pytest.mark.parametrize('x, y', [(0, 0), (3, 1), (12, -7), (-14, 12)])
@pytest.mark.parametrize('width, height', [(320, 240), (640, 480)])
@pytest.mark.parametrize('grey', [False, True])
def test_a_camera_that_turns_moves_the_ground(x, y, width, height, grey):
    """The step is right to 0.4 px, though only every second, or fifth, pixel is used."""
    first, second = view(0, 0, width, height), view(x, y, width, height)
    if grey:
        first, second = first[:, :, 0], second[:, :, 0]
    step = measured(first, second, NOWHERE)
    assert step == (pytest.approx(-x, abs=0.4), pytest.approx(-y, abs=0.4))


def test_it_is_measured_from_one_frame_to_the_next():
    """The step is that since the previous frame, not since the first one."""
    for turn in range(1, 5):
        step = measured(view(2 * (turn - 1), turn - 1), view(2 * turn, turn), NOWHERE)
        assert step == (pytest.approx(-2, abs=0.2), pytest.approx(-1, abs=0.2))


def test_what_moves_in_the_picture_is_not_the_ground():
    """While a third of the picture moves, a resting camera's step is 0 to a tenth of a pixel."""
    background, thing = view(0, 0), patch(160, 160)
    step = measured(
        pasted(background, thing, 60, 40), pasted(background, thing, 69, 36), NOWHERE)
    assert step == (pytest.approx(0, abs=0.1), pytest.approx(0, abs=0.1))


def test_the_target_is_not_the_ground_either():
    """The step isn't that of a target that fills half of the picture: it's 0, or unknown."""
    background, thing = view(0, 0), patch(230, 170)
    step = measured(pasted(background, thing, 40, 30), pasted(background, thing, 46, 33),
                    Box(40, 30, 230, 170))
    assert step is None or step == (pytest.approx(0, abs=0.1), pytest.approx(0, abs=0.1))


def test_a_smaller_target_leaves_the_ground_in_sight():
    """The step is that of points beside the target; those on it are ignored."""
    background, thing = view(0, 0), patch(150, 110)
    step = measured(
        pasted(background, thing, 80, 60), pasted(background, thing, 86, 63),
        Box(80, 60, 150, 110))
    assert step == (pytest.approx(0, abs=0.1), pytest.approx(0, abs=0.1))


def test_a_target_before_a_blank_wall_tells_nothing_of_the_ground():
    """Without texture beside the target the step is None."""
    blank, thing = np.full((240, 320, 3), 120, np.uint8), patch(60, 60)
    step = measured(
        pasted(blank, thing, 130, 90), pasted(blank, thing, 138, 90), Box(130, 90, 60, 60))
    assert step is None


def test_a_zoom_is_a_step_of_the_middle():
    """Points diverge, but the step is that of the picture's middle, to 1 px."""
    first = view(0, 0)
    matrix = cv2.getRotationMatrix2D((159.5, 119.5), 0, 1.01)
    matrix[:, 2] += 6, -4
    second = cv2.warpAffine(first, matrix, (320, 240), borderMode=cv2.BORDER_REFLECT)
    step = measured(first, second, NOWHERE)
    assert step == (pytest.approx(6, abs=1), pytest.approx(-4, abs=1))


def test_pictures_without_anything_in_common_say_nothing():
    """Unrelated pictures give None, not an arbitrary motion."""
    rng = np.random.default_rng(0)
    first, second = (rng.integers(256, size=(240, 320), dtype=np.uint8) for _ in range(2))
    assert measured(first, second, NOWHERE) is None


@pytest.mark.parametrize('shape', [(1, 1, 3), (1, 40, 3), (5, 300), (7, 2000, 3)])
def test_a_sliver_of_a_frame_says_nothing(shape):
    """A frame with too few rows or columns gives None."""
    frame = np.random.default_rng(0).integers(256, size=shape, dtype=np.uint8)
    assert measured(frame, frame, NOWHERE) is None


def test_nothing_is_left_beside_a_target_that_fills_the_frame():
    """Without points beside the target the step is None."""
    frame = view(0, 0)
    assert measured(frame, frame, Box(-10, -10, 500, 400)) is None


@pytest.mark.parametrize('x, y', [(105, 0), (0, -78), (-64, 48)])
@pytest.mark.parametrize('grey', [False, True])
def test_a_camera_that_is_jerked_moves_the_ground_as_far(x, y, grey):
    """With `far` set, steps of up to a third of the picture are measured."""
    first, second = view(0, 0), view(x, y)
    if grey:
        first, second = first[:, :, 0], second[:, :, 0]
    step = measured(first, second, NOWHERE, far=True)
    assert step == (pytest.approx(-x, abs=0.4), pytest.approx(-y, abs=0.4))


def test_a_target_that_jumps_does_not_move_the_ground_far():
    """With `far` set, too, a resting camera's step is 0 while the target jumps."""
    background, thing = view(0, 0), patch(110, 110)
    step = measured(pasted(background, thing, 20, 60), pasted(background, thing, 180, 60),
                    Box(20, 60, 110, 110), far=True)
    assert step == (pytest.approx(0, abs=0.1), pytest.approx(0, abs=0.1))


def test_the_whole_picture_tells_of_a_jump_where_few_points_are_left():
    """With few points beside the target, the step by phase correlation is returned, to 1.5 px."""
    step = measured(view(0, 0), view(40, 0), Box(10, -10, 300, 260), far=True)
    assert step == (pytest.approx(-40, abs=1.5), pytest.approx(0, abs=1.5))


def test_no_jump_is_seen_between_pictures_without_anything_in_common():
    """With `far` set, too, unrelated pictures give None."""
    rng = np.random.default_rng(0)
    first, second = (rng.integers(256, size=(240, 320), dtype=np.uint8) for _ in range(2))
    assert measured(first, second, NOWHERE, far=True) is None


@pytest.mark.parametrize('shape', [(1, 1, 3), (5, 300), (8, 8), (240, 320)])
def test_a_sliver_and_a_blank_picture_show_no_jump(shape):
    """The step is None or 0."""
    frame = np.full(shape, 90, np.uint8)
    step = measured(frame, frame, NOWHERE, far=True)
    assert step is None or step == pytest.approx((0, 0), abs=0.5)
