"""Targets that rotate in the image are localised in windows of their angle."""

from drawn_card import DrawnCard
import numpy as np
from numpy.testing import assert_allclose
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.localisation import Localiser
from vtrack_ros.trackers import create_tracker

CENTER = 150.0, 120.0


def localised(drawn, angles, center=CENTER):
    """Return a localiser that has seen the card upright, then turned by each of some angles."""
    localiser = Localiser(drawn.frame(center), center, drawn.size, np.random.default_rng(0))
    for index, angle in enumerate(angles):
        frame = drawn.frame(center, angle, seed=index)
        localiser.update(frame, localiser.localise(frame, center), center, 1.0)
    return localiser


def test_a_turned_window_shows_the_target_as_it_stood():
    """Its response is twice that of an upright window, and has its maximum at the target."""
    drawn, turn = DrawnCard(), 0.8
    localiser = localised(drawn, [0.0] * 3)
    moved = (CENTER[0] + 6, CENTER[1] - 4)
    frame = drawn.frame(moved, turn)
    found = localiser.localise(frame, CENTER, turn)
    assert found.peak > 2 * localiser.localise(frame, CENTER).peak
    assert_allclose(found.center, moved, atol=1.5)
    assert found.sample(np.array([found.center]))[0] == pytest.approx(found.peak, rel=0.12)
    assert not localiser.update(frame, found, found.center, 1.0)
    assert_allclose(localiser.center, moved, atol=1.5)
    assert localiser.angle == turn


def test_a_target_that_is_taken_for_turned_but_stands_upright_is_upright_again():
    """A sum of measured turns may be wrong: the initial template corrects the angle to 0."""
    drawn = DrawnCard()
    localiser = localised(drawn, [0.0] * 3)
    localiser.transform(1.0, 0.3)
    for index in range(8):
        frame = drawn.frame(CENTER, seed=index)
        localiser.update(frame, localiser.localise(frame, CENTER), CENTER, 1.0)
    assert localiser.angle == 0


@pytest.mark.parametrize('angle', [0.32, -0.6])
@pytest.mark.parametrize('error', [0.15, -0.15])
def test_an_error_of_the_rotation_is_put_right(angle, error):
    """The initial template corrects the angle to 0.06 rad, about half a step of 0.1 rad."""
    drawn = DrawnCard()
    localiser = localised(drawn, [0.0] * 3)
    localiser.transform(1.0, angle + error)
    for index in range(8):
        frame = drawn.frame(CENTER, angle, seed=index)
        localiser.update(frame, localiser.localise(frame, CENTER), CENTER, 1.0)
    assert localiser.angle == pytest.approx(angle, abs=0.06)


def test_a_target_that_has_turned_stays_so():
    """Its angle stays, for upright it's less similar to the initial template."""
    drawn = DrawnCard()
    localiser = localised(drawn, [0.0] * 3)
    localiser.transform(1.0, 0.3 + 2 * np.pi)
    for index in range(8):
        frame = drawn.frame(CENTER, 0.3, seed=index)
        localiser.update(frame, localiser.localise(frame, CENTER), CENTER, 1.0)
    assert localiser.angle == pytest.approx(0.3)


@pytest.mark.parametrize('name', ['gmpf', 'pqkpf', 'pf', 'abmspf', 'appf'])
def test_a_target_is_followed_while_it_turns(name):
    """Over half a turn, clockwise, the box has an IoU above 0.7 with the bound of the ellipse."""
    drawn = DrawnCard()
    tracker = create_tracker(name, seed=0)
    tracker.start(drawn.frame((100.0, 110.0)), drawn.box((100.0, 110.0)))
    for index in range(1, 81):
        center, angle = (100.0 + index, 110.0), np.pi * index / 80
        estimate = tracker.update(drawn.frame(center, angle, seed=index))
        truth = Box.around_ellipse(center, drawn.size, angle)
        assert estimate.box.iou(truth) > 0.7 and estimate.measured
    assert -np.pi <= estimate.angle <= np.pi and abs(estimate.angle) > np.pi - 0.3
    # the affine frame maps the unit square about the origin onto the card
    corner = estimate.affine @ (0.5, 0.5, 1)
    assert np.linalg.norm(corner[:2] - (center[0] - 30, center[1] - 22)) < 15


@pytest.mark.parametrize('name', ['gmpf', 'dcf'])
def test_a_target_that_only_moves_has_no_rotation(name):
    """Its angle stays below 0.05 rad, and its box keeps its aspect."""
    drawn = DrawnCard()
    tracker = create_tracker(name, seed=0)
    tracker.start(drawn.frame((100.0, 110.0)), drawn.box((100.0, 110.0)))
    for index in range(1, 41):
        estimate = tracker.update(drawn.frame((100.0 + 2 * index, 110.0), seed=index))
        assert abs(estimate.angle) < 0.05
    assert estimate.box.width / estimate.box.height == pytest.approx(60 / 44, abs=0.05)
