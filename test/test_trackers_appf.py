"""APPF: the terms of its likelihood, and drawn targets that turn and grow."""

import cv2
from drawn_card import card_texture, DrawnCard
import numpy as np
from numpy.testing import assert_allclose
import pytest

from vtrack_ros.appearance.affine_patches import AffinePatches
from vtrack_ros.geometry import affine, Box
from vtrack_ros.tracker import TrackState
from vtrack_ros.trackers import create_tracker


def _state(scale=30.0, turn=0.0, center=(0.0, 0.0)):
    return affine.from_vector(np.array([np.log(scale), 0, turn, 0, *center]))


def _path(index):
    return 100.0 + 2.0 * index, 110.0 + 12 * np.sin(index / 6)


def test_patches_follow_rotation_and_scale():
    drawn = DrawnCard(grey=True)
    side = float(np.sqrt(60 * 44))
    size = (60 / side, 44 / side)
    upright = AffinePatches(
        drawn.frame((100, 100)), _state(side, 0, (100.0, 100.0))[None], size).grey()[0]
    turned = AffinePatches(
        drawn.frame((150, 120), 0.7, 1.4),
        _state(1.4 * side, 0.7, (150.0, 120.0))[None], size).grey()[0]
    assert np.corrcoef(upright, turned)[0, 1] > 0.97
    missed = AffinePatches(
        drawn.frame((150, 120), 0.7, 1.4),
        _state(1.4 * side, 0.0, (150.0, 120.0))[None], size).grey()[0]
    assert np.corrcoef(upright, missed)[0, 1] < 0.7


def test_patches_of_a_large_target_equal_those_of_a_small_one():
    small = cv2.GaussianBlur(card_texture(80, 80, 3, 10), (5, 5), 1)
    large = cv2.resize(small, None, fx=7, fy=7, interpolation=cv2.INTER_CUBIC)
    one = AffinePatches(small, _state(40.0, 0.3, (40.0, 40.0))[None], (1.0, 1.0))
    other = AffinePatches(large, _state(280.0, 0.3, (280.0, 280.0))[None], (1.0, 1.0))
    assert np.abs(one.grey() - other.grey()).mean() < 0.02
    assert np.sqrt(one.colours() * other.colours()).sum() > 0.8


def test_colours_outside_the_frame_are_missing():
    frame = np.full((50, 50, 3), 200, np.uint8)
    states = np.array([_state(20.0, 0, (25.0, 25.0)), _state(20.0, 0, (0.0, 25.0)),
                       _state(20.0, 0, (-80.0, 25.0))])
    assert_allclose(AffinePatches(frame, states, (1.0, 1.0)).colours().sum(1), (1, 0.5, 0))


def started(drawn, center, **parameters):
    """Return an APPF that was started on the card."""
    tracker = create_tracker('appf', seed=2, particles=150, **parameters)
    tracker.start(drawn.frame(center), drawn.box(center))
    return tracker


@pytest.mark.parametrize('grey', [False, True])
def test_follows_a_drawn_target_through_translation_and_growth(grey):
    drawn = DrawnCard(grey)
    tracker = started(drawn, _path(0))
    for index in range(1, 20):
        scale = 1 + 0.016 * index
        estimate = tracker.update(drawn.frame(_path(index), 0.0, scale, index))
        truth = Box.from_center(*_path(index), 60 * scale, 44 * scale)
        assert estimate.box.iou(truth) > 0.55
        assert estimate.state is TrackState.TRACKING
    assert estimate.box.center_distance(truth) < 6


@pytest.mark.parametrize('last', [1.0, 0.15])
def test_particles_still_move_about_a_target_that_became_tiny(last):
    """Their places scatter by .02 sides and more, as about a target of the first size."""
    drawn, center = DrawnCard(), (160.0, 120.0)
    tracker = started(drawn, center)
    for index in range(1, 61):
        scale = last**min(index / 50, 1)
        estimate = tracker.update(drawn.frame(center, 0.0, scale, index))
    assert estimate.box.width == pytest.approx(60 * scale, rel=0.3)
    assert estimate.particles[:, 0].std() > 0.02 * np.sqrt(estimate.box.area)


@pytest.mark.parametrize('side', [20.0, 60.0, 100.0, 200.0, 400.0])
def test_patches_show_the_place_that_they_are_of(side):
    """On ramps of grey the patches' means tell their places, whatever the target's size."""
    dither, errors = np.random.default_rng(0).random((600, 1000)), []
    # up and down: what rounding adds to the grey values cancels
    for slope in (100 / side, -100 / side):
        grey = 127 + slope * (np.arange(1000) + 0.5 - 500)
        frame = np.floor((grey + dither).clip(0, 255)).astype(np.uint8)
        for center in 500 + np.arange(0, 8, 0.5):
            state = _state(side, 0, (center, 300.0))
            patch = AffinePatches(frame, state[None], (1.0, 1.0)).grey()[0]
            errors.append((255 * patch.mean() - 127) / slope + 500 - center)
    assert np.mean(errors) == pytest.approx(0, abs=0.25)


def test_the_angle_follows_a_rotation():
    drawn, center = DrawnCard(), (160.0, 120.0)
    tracker = create_tracker('appf', seed=3)
    tracker.start(drawn.frame(center), drawn.box(center))
    for index in range(1, 31):
        estimate = tracker.update(drawn.frame(center, 0.03 * index, 1.0, index))
    assert estimate.angle == pytest.approx(0.9, abs=0.15)  # clockwise is positive
    assert estimate.box.center_distance(Box.from_center(*center, 1, 1)) < 5
    # the affine frame maps the unit square about the origin onto the card
    corner = estimate.affine @ (0.5, 0.5, 1)
    expected = affine.rotation(np.asarray(0.9)) @ (30, 22) + center
    assert np.linalg.norm(corner[:2] - expected) < 10


def test_the_box_stands_upright_about_a_turned_target():
    drawn = DrawnCard()
    tracker = create_tracker('appf', seed=0)
    tracker.start(drawn.frame((100.0, 110.0)), drawn.box((100.0, 110.0)))
    for index in range(1, 41):
        tracker.update(drawn.frame((100.0, 110.0), np.pi / 2 * index / 40, seed=index))
    for index in range(1, 13):
        center = (100.0 + 4 * index, 110.0)
        estimate = tracker.update(drawn.frame(center, np.pi / 2, seed=index))
    width, height = drawn.size
    assert estimate.box.iou(Box.from_center(*center, height, width)) > 0.8
    # if box and size had different axes, that would count as an error of the size
    assert np.sqrt(np.diag(estimate.covariance)[2:]).max() < 0.25 * height


def test_a_turned_target_stays_in_the_image():
    """The centre stays inside the image, not only inside the image that's rotated back."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        frames = [np.repeat(rng.integers(256, size=(9, 1, 3), dtype=np.uint8), 5, 0)
                  for _ in range(5)]
        tracker = create_tracker('appf', seed=seed, rotation_noise=1.0)
        tracker.start(frames[0], Box(0, 1, 1, 61))
        for frame in frames[1:]:
            x, y = tracker.update(frame).box.center
            assert 0 <= x <= 1 and 0 <= y <= 45


def test_the_covariance_stays_positive_definite_while_the_target_leaves():
    drawn = DrawnCard()
    tracker = started(drawn, (270.0, 120.0))
    for index in range(1, 26):
        center = (270.0 + 5 * index, 120.0)
        estimate = tracker.update(drawn.frame(center, 0.0, 1.0, index))
        assert np.isfinite(estimate.covariance).all()
        assert (np.linalg.eigvalsh(estimate.covariance) > 0).all()
        assert estimate.box.width < 5.5 * 60 and estimate.box.height < 5.5 * 60
    assert estimate.confidence < 0.5


def test_parameters_change_while_it_runs():
    drawn = DrawnCard()
    tracker = started(drawn, _path(0))
    tracker.configure(particles=50, eigenvectors=4, update_interval=2, rotation_noise=0.0)
    for index in range(1, 8):
        estimate = tracker.update(drawn.frame(_path(index), 0.0, 1.0, index))
        tracker.configure(colour_sigma=0.1 + 0.01 * index)
    assert len(estimate.particles) == 50
    assert estimate.box.iou(drawn.box(_path(7))) > 0.6
    with pytest.raises(ValueError, match='particles must be an integer from 2'):
        tracker.configure(particles=1)


def test_a_box_that_reaches_beyond_the_image():
    drawn = DrawnCard()
    tracker = create_tracker('appf', seed=4)
    tracker.start(drawn.frame((20.0, 30.0)), drawn.box((20.0, 30.0)))
    for index in range(1, 6):
        estimate = tracker.update(drawn.frame((20.0, 30.0), 0.0, 1.0, index))
    assert estimate.box.iou(drawn.box((20.0, 30.0))) > 0.5


def test_dropped_frames_are_caught_up_with():
    drawn = DrawnCard()
    tracker = started(drawn, _path(0))
    for index in range(1, 10):
        tracker.update(drawn.frame(_path(index), 0.0, 1.0, index))
    estimate = tracker.update(drawn.frame(_path(14), 0.0, 1.0, 14), dt=5.0)
    assert estimate.box.iou(drawn.box(_path(14))) > 0.6
