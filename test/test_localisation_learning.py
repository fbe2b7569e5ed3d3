"""How fast a localiser learns how a target looks, and its size: by the time, not by the frame."""

import math

import cv2
from drawn_video import DrawnVideo, look_alike, region_at, START, TARGET
import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.localisation import Localiser
from vtrack_ros.trackers import create_tracker

VIDEO = DrawnVideo(seed=1)


@pytest.mark.parametrize('tracker', ['dcf', 'gmpf'])
@pytest.mark.parametrize('share', [0.31, 0.23, 0.17, 0.11])
def test_a_target_between_pixels_is_learned_where_it_is(tracker, share):
    """In frames like the first one, a target of 5 to 15 px stays on its place and in its size."""
    frame = cv2.resize(VIDEO.frame(START, noise=0.0), None, fx=share, fy=share,
                       interpolation=cv2.INTER_AREA)
    errors, growths = [], []
    for shift in np.linspace(0, 1, 5):
        center, size = ([share * length for length in pair] for pair in (START, TARGET))
        box = Box.from_center(center[0] + shift, center[1] + shift, *size)
        following = create_tracker(tracker, seed=0)
        following.start(frame, box)
        for _ in range(9):
            estimate = following.update(frame)
        errors.append(math.dist(estimate.box.center, box.center))
        growths.append(estimate.box.width / box.width)
    assert max(errors) < 0.3
    assert growths == pytest.approx(5 * [1.0], abs=0.05)


def response_after(*intervals):
    """Return the highest response to a target that has changed, followed at these intervals."""
    before = VIDEO.frame(START, noise=0.0)
    after = before.copy()
    after[region_at(START)] = look_alike(VIDEO, START, 0.5)
    localiser = Localiser(before, START, TARGET, np.random.default_rng(0))
    for dt in intervals:
        localiser.update(after, localiser.localise(after, START), START, dt)
    return localiser.localise(after, START).peak


@pytest.mark.parametrize('dt, share', [(2.0, 0.9), (3.0, 0.9), (6.0, 0.6)])
def test_at_a_low_frame_rate_about_as_much_is_learned_in_the_same_time(dt, share):
    """In 24 frames' time the response to what has changed grows about as much; a little later."""
    first, every = response_after(), response_after(*24 * [1.0])
    # at its first interval it isn't known to be the usual one
    fewer = response_after(1.0, *round(24 / dt) * [dt])
    assert share * (every - first) < fewer - first < 1.1 * (every - first)


def test_one_example_after_a_gap_counts_once():
    """Fifteen frames without an image don't make the next one worth fifteen."""
    usual = 3 * [1.0]
    assert response_after(*usual, 15.0, 1.0) == pytest.approx(response_after(*usual, 1.0, 1.0))


@pytest.mark.parametrize('dt, every', [(1.0, 4), (2.0, 2), (5.0, 1)])
def test_the_size_is_measured_by_the_time(dt, every):
    """Every four frames, at half the frame rate in every second one, at a fifth in all."""
    frame = VIDEO.frame(START, noise=0.0)
    localiser = Localiser(frame, START, TARGET, np.random.default_rng(0))
    measured = []
    for _ in range(17):
        localiser.update(frame, localiser.localise(frame, START), START, dt)
        measured.append(localiser.resized)
    assert sum(measured[1:]) == 16 // every
