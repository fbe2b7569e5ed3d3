"""A target's step, growth and rotation between two frames, by optical flow of its points."""

import cv2
from drawn_video import DrawnVideo, region_at, SIZE, START, TARGET, texture
import numpy as np
import pytest

from vtrack_ros.appearance.image_motion import TargetFlow
from vtrack_ros.geometry import affine
from vtrack_ros.localisation.search_window import WindowLayout

VIDEO = DrawnVideo(seed=1)


def zoomed(factor, shift=(0.0, 0.0), turn=0.0):
    """Return the drawn frame, zoomed and turned about the target and moved, in pixels."""
    linear = factor * affine.rotation(np.asarray(turn))
    middle = np.subtract(START, 0.5)
    matrix = np.column_stack([linear, middle - linear @ middle + shift])
    return cv2.warpAffine(
        VIDEO.frame(START, noise=0.0), matrix, SIZE, borderMode=cv2.BORDER_REFLECT)


def motion(first, second, center=START, size=TARGET, angle=0.0):
    """Return the target's motion between two frames, measured in a model's window."""
    window = WindowLayout.around(*size).window(first, center, size, angle)
    return TargetFlow(window.grey, window.pixels, center, size).motion(second)


def growth(*arguments):
    """Return the measured growth of the target, or None."""
    return motion(*arguments).growth


@pytest.mark.parametrize('shift', [(0.0, 0.0), (7.3, -4.6)])
@pytest.mark.parametrize('factor', [0.93, 0.97, 1.03, 1.08])
@pytest.mark.parametrize('grey', [False, True])
def test_growth_is_told_wherever_the_target_went(factor, shift, grey):
    """The growth is right to 0.8 %, whatever the step, in colour and in grey frames."""
    first, second = zoomed(1.0), zoomed(factor, shift)
    if grey:
        first, second = first[:, :, 0], second[:, :, 0]
    assert growth(first, second) == pytest.approx(factor, abs=0.008)


@pytest.mark.parametrize('zoom', [0.25, 3.0])
def test_a_small_and_a_large_target_s_growth_is_told(zoom):
    """The growth of targets of 11 px and of 130 px is right to 1.5 %."""
    frames = [cv2.resize(zoomed(factor), None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA)
              for factor in (1.0, 1.05)]
    center, size = ([zoom * value for value in pair] for pair in (START, TARGET))
    assert growth(*frames, center, size) == pytest.approx(1.05, abs=0.015)


@pytest.mark.parametrize('size', [(150, 0.8), (0.8, 100)])
@pytest.mark.filterwarnings('error')
def test_points_of_a_line_that_fall_together_do_no_harm(size):
    """The growth of a target hundreds of times as long as wide is found by points that differ."""
    first, second = zoomed(1.0), zoomed(1.05)
    assert growth(first, first, START, size) is None
    assert growth(first, second, START, size) == pytest.approx(1.05, abs=0.015)


def test_a_target_that_only_moves_or_hardly_grows_has_no_growth():
    """A growth below 1 % can't be told from noise: it's None, and left to the regression."""
    assert growth(zoomed(1.0), zoomed(1.0, (6.0, 3.0))) is None
    assert growth(zoomed(1.0), zoomed(1.005)) is None
    assert growth(VIDEO.frame(START), VIDEO.frame(START)) is None


def test_what_is_behind_the_target_says_little():
    """A background that grows by 6 % about a constant target gives a growth below 3 %."""
    frame, grown = zoomed(1.0), zoomed(1.06)
    grown[region_at(START)] = frame[region_at(START)]
    assert (growth(frame, grown) or 1.0) < 1.03


def test_half_of_a_target_is_enough():
    """With a third of the target occluded, a growth of 6 % is measured as 2 to 7 %."""
    frame, grown = zoomed(1.0), zoomed(1.06)
    left, right = round(START[0] - TARGET[0]), round(START[0] - TARGET[0] / 6)
    frame[:, left:right] = grown[:, left:right] = texture(
        (SIZE[1], right - left), [(0, 0, 0), (90, 200, 90)], 5, np.random.default_rng(3))
    assert 1.02 < growth(frame, grown) < 1.07


def test_a_hidden_or_blank_target_has_no_growth():
    """An absent or blank target, or one that grew by 30 %, gives None, not an arbitrary growth."""
    assert growth(zoomed(1.0), DrawnVideo(seed=5).frame(None)) is None
    blank = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    assert growth(blank, blank) is None
    assert motion(blank, blank).step is None
    assert growth(zoomed(1.0), zoomed(1.3)) is None


@pytest.mark.parametrize('factor', [0.97, 1.0, 1.05])
@pytest.mark.parametrize('shift', [(0.0, 0.0), (7.3, -4.6), (-12.0, 9.0)])
def test_where_a_target_went_is_told_while_it_grows(shift, factor):
    """The step is right to half a pixel, for a target of 48 x 40 px."""
    step = motion(zoomed(1.0), zoomed(factor, shift)).step
    assert step == pytest.approx(shift, abs=0.5)


@pytest.mark.parametrize('angle', [0.0, 0.7, -1.3])
@pytest.mark.parametrize('shift', [(0.0, 0.0), (7.3, -4.6)])
@pytest.mark.parametrize('turn', [0.03, -0.1, 0.13])
def test_how_a_target_turned_is_told_wherever_it_went(turn, shift, angle):
    """Rotation (to 12 %), growth and step are right, for targets that were turned already, too."""
    found = motion(zoomed(1.0, (0.0, 0.0), angle), zoomed(1.03, shift, angle + turn), angle=angle)
    assert found.turn == pytest.approx(turn, rel=0.12)
    assert found.growth == pytest.approx(1.03, abs=0.008)
    assert found.step == pytest.approx(shift, abs=0.5)


def test_a_target_that_does_not_turn_has_no_rotation():
    """The rotation is None without a turn, for a blank target, and for a turn by 0.7 rad."""
    assert motion(zoomed(1.0), zoomed(1.04, (6.0, 3.0))).turn is None
    blank = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    assert motion(blank, blank).turn is None
    assert motion(zoomed(1.0), zoomed(1.0, (0.0, 0.0), 0.7)).turn is None


def test_no_step_is_told_where_the_points_part():
    """The step is None where half of the target moves on, and the other half stays."""
    first, second = zoomed(1.0), zoomed(1.0, (9.0, 0.0))
    second[:, :round(START[0])] = first[:, :round(START[0])]
    assert motion(first, second).step is None


def test_a_few_points_say_nothing_though_they_agree():
    """With two thirds of the target blank, the points of the rest give no motion."""
    first, second = zoomed(1.0), zoomed(1.0, (6.0, 0.0))
    for frame in (first, second):
        frame[:, :round(START[0] + TARGET[0] / 6 + 3)] = 90
    found = motion(first, second)
    assert found.step is None and found.growth is None and found.turn is None


@pytest.mark.parametrize('angle', [0.0, 1.0, -1.3])
def test_the_points_are_the_target_s_wherever_it_is_in_the_window(angle):
    """The step of a target off the window's middle, before a static ground, is right to 0.3 px."""
    about = START[0] + 16, START[1] - 4
    window = WindowLayout.around(*TARGET).window(VIDEO.frame(START, 0.0), about, TARGET, angle)
    flow = TargetFlow(window.grey, window.pixels, START, TARGET)
    step = flow.motion(VIDEO.frame((START[0] + 3, START[1] + 2), 0.0)).step
    assert step == pytest.approx((3, 2), abs=0.3)


@pytest.mark.parametrize('shape', [(1, 1), (1, 40, 3), (240, 320, 3)])
@pytest.mark.parametrize('center', [(0.0, 0.0), (-300.0, 5.0), (1e4, 1e4)])
def test_a_target_beyond_the_frame_says_nothing_and_does_no_harm(shape, center):
    """It has no growth, and no step or step 0; nor has a target of a single pixel."""
    frame = np.random.default_rng(0).integers(256, size=shape, dtype=np.uint8)
    for size in (TARGET, (1.0, 1.0)):
        assert growth(frame, frame, center, size) is None
        assert motion(frame, frame, center, size).step in (None, (0.0, 0.0))
