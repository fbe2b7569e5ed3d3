"""Two models of one target, and a search that's guided by forecasts."""

import math

import cv2
from drawn_video import (
    box_at, DrawnVideo, region_at, SIZE, START, straight, TARGET, texture)
import numpy as np
import pytest

from vtrack_ros.appearance.constrained_filter import ConstrainedFilter
from vtrack_ros.appearance.regression import ScaleRegression
from vtrack_ros.geometry import Box
from vtrack_ros.localisation import Found, GuidedSearch, Hypotheses
from vtrack_ros.localisation.localiser import Localiser
from vtrack_ros.localisation.redetection import Redetection, Verdict
from vtrack_ros.localisation.target_model import TargetModel
from vtrack_ros.trackers import create_tracker

VIDEO = DrawnVideo(seed=1)


def started(frame, center=START):
    """Return hypotheses of the drawn target, and a guided search."""
    target = Hypotheses(frame, center, TARGET, np.random.default_rng(0))
    return target, GuidedSearch(frame, target)


def follow(path, frame_of=VIDEO.frame, dt=1.0):
    """Follow a path, and return the hypotheses, the search and the last find."""
    target, search = started(frame_of(path[0]), path[0])
    for center in path[1:]:
        frame = frame_of(center)
        found = search.search(frame, dt)
        search.follow(dt, target.update(frame, found, dt))
    return target, search, found


def update(localiser, frame, place):
    """Update a localiser with the target at a place; tell whether it's elsewhere."""
    return localiser.update(frame, localiser.localise(frame, place), place, 1.0)


def followed_by_camera(frames=25):
    """Return frames of a target that stays in the picture, before a moving ground, and its box."""
    rng = np.random.default_rng(2)
    ground = texture((SIZE[1], SIZE[0] + 2 * frames),
                     [(60, 70, 60), (150, 160, 150), (90, 110, 120)], 14, rng)
    figure = texture((14, 16), [(70, 90, 90), (170, 150, 140), (40, 50, 60)], 6, rng)
    images = []
    for index in range(frames):
        image = ground[:, 2 * index:2 * index + SIZE[0]].copy()
        image[103:117, 132:148] = figure
        images.append(image)
    # most of what is in the box is ground
    return images, Box.from_center(140, 110, 36, 30)


@pytest.mark.parametrize('name, kept', [
    ('dcf', False), ('gmpf', True), ('pqkpf', True), ('abmspf', True), ('pf', True)])
def test_a_target_that_the_camera_follows_is_kept(name, kept):
    """One model alone follows the ground that moves behind it; with two the target is kept."""
    images, box = followed_by_camera()
    tracker = create_tracker(name, seed=0)
    tracker.start(images[0], box)
    overlap = [tracker.update(image).box.iou(box) for image in images[1:]][-1]
    assert (overlap > 0.5) is kept


def turned_while_away(seed):
    """Return two frames of a reddish figure that turns while the camera moves, and its box."""
    rng = np.random.default_rng(seed)
    ground = np.kron(rng.integers(40, 200, (30, 60, 3), np.uint8), np.ones((8, 8, 1), np.uint8))
    spots = np.kron(rng.integers(0, 60, (8, 8, 3), np.uint8), np.ones((6, 6, 1), np.uint8))
    colour = np.array([10, 20, 190], np.uint8) + spots
    y, x = np.mgrid[:48, :48] - 23.5
    disc, images = np.hypot(x, y) < 24, []
    for shift, bars in ((0, (np.abs(x - y) < 12) | (np.abs(x + y) < 12)),
                        (40, (np.abs(x) < 10) | (np.abs(y) < 10))):
        image = ground[:, shift:shift + 320].copy()
        image[100:148, 140:188][disc & bars] = colour[disc & bars]
        images.append(cv2.GaussianBlur(image, (0, 0), 1))
    return *images, Box(140, 100, 48, 48)


@pytest.mark.parametrize('name', ['gmpf', 'pqkpf', 'abmspf', 'appf', 'pf'])
@pytest.mark.parametrize('seed', range(1, 4))
def test_after_a_gap_the_target_is_what_looks_like_it(name, seed):
    """It's found (IoU above 0.5), though the learned ground responds where it's forecast."""
    before, after, box = turned_while_away(seed)
    tracker = create_tracker(name, seed=0)
    tracker.start(before, box)
    assert tracker.update(after, 20.0).box.iou(box) > 0.5


def test_no_frame_measures_two_sizes(monkeypatch):
    """After the first 30 frames, at most one model's size is measured in a frame."""
    counts = []
    updated = ScaleRegression.updated

    def counted(*values):
        counts[-1] += 1
        return updated(*values)

    def frame_of(center):
        counts.append(0)
        return VIDEO.frame(center)
    monkeypatch.setattr(ScaleRegression, 'updated', counted)
    follow([START, *((START[0] + index, START[1]) for index in range(72))], frame_of)
    assert max(counts[31:]) == 1 and sum(counts[31:]) > 10


def test_the_box_has_the_size_between_the_two_models(monkeypatch):
    """If one measures growth and the other none, the box has the geometric mean of their sizes."""
    def growth(model, window, shift):
        return 1.01 if isinstance(model.correlation, ConstrainedFilter) else 1.0
    monkeypatch.setattr(TargetModel, 'growth', growth)
    target, _, _ = follow([START] * 30)
    box = target.estimate(np.eye(4)).box
    assert target.size == pytest.approx(TARGET)
    assert 0.5 * np.log(1.01) * 5 < np.log(box.width / TARGET[0]) < 0.5 * np.log(1.01) * 10
    assert box.center == pytest.approx(target.center)
    assert box.width / box.height == pytest.approx(TARGET[0] / TARGET[1])


@pytest.mark.parametrize('distractor, frames, found', [
    (False, 20, True), (True, 16, False), (True, 40, True)])
def test_redetection_does_not_jump_to_a_distractor(distractor, frames, found):
    """A distractor's place isn't jumped to, unless the target has been lost for long."""
    target, _ = started(VIDEO.frame(START))
    there = START[0] + 90.0, START[1]
    places = [START] * 4 + [there] * frames
    jumps = []
    for place in places:
        frame = VIDEO.frame(place)
        found_here = Found(target.localise(frame, START), START, (there,) * distractor)
        jumps.append(target.update(frame, found_here, 1.0))
        if jumps[-1]:
            break
    assert jumps[-1] is found
    assert (target.center == pytest.approx(there, abs=3)) is found


def test_the_window_goes_ahead_of_a_steady_target():
    """At steps of half a side, the window's centre is within 6 px of the target, not behind it."""
    path = [(40.0 + 22 * index, 110.0) for index in range(11)]
    target, _, found = follow(path)
    assert box_at(path[-1]).iou(Box.from_center(*target.center, *target.size)) > 0.7
    assert abs(found.response.window.center[0] - path[-1][0]) < 6


def test_after_a_gap_it_searches_around():
    """A target that is 63 px (1.4 sides) away after ten frames is found at once."""
    target, search, _ = follow([START] * 6)
    place = (START[0] + 60, START[1] + 20)
    frame = VIDEO.frame(place)
    found = search.search(frame, 10.0)
    assert found.place == (pytest.approx(place[0], abs=3), pytest.approx(place[1], abs=3))
    # without a gap, and with the target seen, one window is enough
    still = search.search(VIDEO.frame(START), 1.0)
    assert still.place == (pytest.approx(START[0], abs=2), pytest.approx(START[1], abs=2))


def test_a_double_elsewhere_isn_t_taken_for_the_target():
    """Its response is as high, but it isn't where the target is expected."""
    target, search, _ = follow([START] * 8)
    double = VIDEO.frame((START[0] + 52, START[1]))
    frame = VIDEO.frame(START)
    x, y = round(START[0] + 52 - TARGET[0] / 2), round(START[1] - TARGET[1] / 2)
    frame[y:y + TARGET[1], x:x + TARGET[0]] = double[y:y + TARGET[1], x:x + TARGET[0]]
    found = search.search(frame, 1.0)
    assert found.place == (pytest.approx(START[0], abs=3), pytest.approx(START[1], abs=3))


def test_where_the_target_is_found_again_there_is_no_distractor():
    """What was followed as its double was the target, so it doesn't hide it."""
    target, search, _ = follow([START] * 8)
    other, frame = (START[0] + 30, START[1]), VIDEO.frame(START)
    frame[region_at(other)] = VIDEO.frame(other)[region_at(other)]
    for _ in range(4):
        found = search.search(frame, 1.0)
        search.follow(1.0, target.update(frame, found, 1.0))
    assert found.place == (pytest.approx(START[0], abs=2), pytest.approx(START[1], abs=2))
    assert found.distractors
    target.update(frame, Found(target.localise(frame, other), other), 1.0)
    search.follow(1.0, elsewhere=True)
    found = search.search(frame, 1.0)
    assert not any(math.dist(place, other) < 10 for place in found.distractors)
    assert found.place == (pytest.approx(other[0], abs=2), pytest.approx(other[1], abs=2))


def test_maxima_are_the_tops():
    """The highest one is among them, and all have at least 0.6 of its response."""
    target, _ = started(VIDEO.frame(START))
    response = target.localise(VIDEO.frame(START), START)
    tops = response.maxima(0.6)
    assert max(value for _, value in tops) == response.peak
    assert response.center in [place for place, _ in tops]
    assert all(value >= 0.6 * response.peak for _, value in tops)


def before_a_plain_wall(center):
    """Draw the target before a wall, on which a camera's motion can't be measured."""
    image = np.full((SIZE[1], SIZE[0], 3), 120, np.uint8)
    image[region_at(center)] = VIDEO.frame(center, noise=0.0)[region_at(center)]
    return image


def test_out_of_sight_a_velocity_fades_with_time():
    """After six frames, or two of three times the interval, it's searched at the same place."""
    path, places = straight(20, (5, 1)), []
    for dt in (1.0, 3.0):
        target, search, _ = follow(path, before_a_plain_wall)
        for _ in range(round(6 / dt)):
            search.follow(dt, elsewhere=True)
        localise, searched = target.localise, []
        target.localise = lambda *args: searched.append(args[1]) or localise(*args)
        search.search(before_a_plain_wall(path[-1]), 1.0)
        places.append(np.subtract(searched[0], path[-1]))
    assert places[0] == pytest.approx(places[1], abs=1e-6)
    assert places[0] == pytest.approx([5 * 0.9**6, 0.9**6], abs=0.7)


@pytest.mark.parametrize('seed', range(5))
def test_a_localiser_restarted_beside_one_that_searches_goes_on_searching(seed):
    """It takes over the other's place, but searches from where that one lost the target."""
    video, here, elsewhere = DrawnVideo(seed=4, blob=60), (60.0, 60.0), (250.0, 180.0)
    first, nothing = video.frame(here), video.frame(None)
    leader, other = (Localiser(first, here, TARGET, np.random.default_rng(seed)) for _ in range(2))
    for localiser in (leader, other):
        update(localiser, first, here)
    for place in (here, here, here, elsewhere, elsewhere):
        update(leader, nothing, place)
    other.resume(other.snapshot, leader)
    assert leader.uncertain and other.uncertain
    assert np.hypot(*np.subtract(other.center, elsewhere)) < 20
    assert any(update(other, first, other.center) for _ in range(2))
    assert np.hypot(*np.subtract(other.center, here)) < 4
    other.resume(other.snapshot, Localiser(first, here, TARGET, np.random.default_rng(seed)))
    assert not other.uncertain


def test_where_the_target_only_may_be_the_evidence_of_earlier_frames_still_counts(monkeypatch):
    """After ten frames without it, a tentative place is believed less than one that is sure."""
    first, confidences = VIDEO.frame(START, noise=0.0), []
    nothing = np.full_like(first, 120)
    for tentative in (True, False):
        localiser = Localiser(first, START, TARGET, np.random.default_rng(0))
        for frame in (first, *[nothing] * 10):
            update(localiser, frame, START)
        there = Verdict(localiser.snapshot, 0.15, elsewhere=True, sharpness=5.0,
                        tentative=tentative, over=not tentative)
        monkeypatch.setattr(Redetection, 'update', lambda *_, there=there: there)
        update(localiser, nothing, START)
        confidences.append(localiser.estimate(np.zeros((4, 4))).confidence)
        monkeypatch.undo()
    assert confidences[0] < 0.9 * confidences[1]
