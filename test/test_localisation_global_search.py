"""A search of the whole frame: when it begins, what it accepts, what a localiser makes of it."""

from __future__ import annotations

from dataclasses import replace
import itertools

from drawn_video import DrawnVideo, region_at, TARGET, texture
import numpy as np
import pytest

from vtrack_ros.localisation.global_search import GlobalSearch
from vtrack_ros.localisation.localiser import Localiser
from vtrack_ros.localisation.presence import InitialTemplate
from vtrack_ros.localisation.search_window import WindowLayout
from vtrack_ros.localisation.target_model import TargetModel, TargetSnapshot

HERE, ELSEWHERE = (60.0, 60.0), (250.0, 180.0)
VIDEO = DrawnVideo(seed=4, blob=60)


def searching():
    """Return a search for the first frame's target, and the snapshot tracked instead of it."""
    frame = VIDEO.frame(HERE)
    window = WindowLayout.around(*TARGET).window(frame, HERE, TARGET)
    model = TargetModel.create(window)
    live = TargetSnapshot(model, (150.0, 120.0), TARGET, 0.8, 0.1)
    search = GlobalSearch(
        model, InitialTemplate.of(model, window), TARGET, np.random.default_rng(1))
    return search, live


@pytest.fixture
def search_and_live():
    """Return a search and what is tracked, as `searching` does."""
    return searching()


def sightings(search, live, frame, similarity, frames, dt=1.0, failed=False, distractors=()):
    """Return a search's results in a number of frames that are all alike."""
    return [search.update(frame, live, similarity, failed, dt, distractors)
            for _ in range(frames)]


def test_it_finds_the_first_look_anywhere_in_the_frame(search_and_live):
    search, live = search_and_live
    found = [one for one in sightings(search, live, VIDEO.frame(ELSEWHERE), 0.05, 150) if one]
    assert found
    assert np.hypot(*np.subtract(found[0].center, ELSEWHERE)) < 3
    assert found[0].similarity > 0.5


def test_it_soon_covers_the_frame():
    """After 30 frames of failure the target is sighted in a few frames, wherever it is."""
    delays = []
    for place in itertools.product((30.0, 90.0, 200.0, 290.0), (30.0, 120.0, 215.0)):
        search, live = searching()
        found = sightings(search, live, VIDEO.frame(place), 0.05, 60, failed=True)
        delays.append(next(index for index, one in enumerate(found) if one) - 29)
    assert np.mean(delays) < 4


def test_what_resembles_the_first_look_is_not_doubted(search_and_live):
    """A place of similarity 0.2 isn't left, however similar another one is."""
    search, live = search_and_live
    assert not any(sightings(search, live, VIDEO.frame(ELSEWHERE), 0.2, 200))


def test_a_doubt_of_some_frames_is_none(search_and_live):
    """After 20 frames of low similarity, as by an occluder, there's no sighting yet."""
    search, live = search_and_live
    frame = VIDEO.frame(ELSEWHERE)
    for _ in range(5):
        assert not any(sightings(search, live, frame, 0.05, 20))
        assert not any(sightings(search, live, frame, 0.6, 20))


def test_what_has_failed_for_long_is_doubted(search_and_live):
    """After 30 frames of failure, not sooner, a place is sighted if it's far more similar."""
    search, live = search_and_live
    frame = VIDEO.frame(ELSEWHERE)
    assert not any(sightings(search, live, frame, 0.2, 29, failed=True))
    assert any(sightings(search, live, frame, 0.2, 150, failed=True))
    search.restart(1.0)
    assert not any(sightings(search, live, frame, 0.7, 200, failed=True))


def test_what_was_found_after_a_failure_is_doubted_until_it_is_like_the_target(search_and_live):
    """At once, unless tracking fails again, and until it has 0.9 of the usual similarity."""
    search, live = search_and_live
    frame = VIDEO.frame(ELSEWHERE)
    search.restart(0.25, usual=0.45)
    assert not any(sightings(search, live, frame, 0.25, 29, failed=True))
    assert any(sightings(search, live, frame, 0.25, 30))
    search.restart(0.25, usual=0.45)
    sightings(search, live, VIDEO.frame(None), 0.45, 20)
    assert not any(sightings(search, live, frame, 0.25, 150))
    search.restart(0.25, usual=0.25)
    assert not any(sightings(search, live, frame, 0.24, 150))


def test_where_it_was_lost_as_like_as_what_is_tracked_is_enough(search_and_live):
    """There an equal similarity is enough; not elsewhere, nor once the target is confirmed."""
    search, live = search_and_live
    frame = VIDEO.frame(ELSEWHERE)
    search.restart(0.6, usual=0.9)
    assert not any(sightings(search, live, frame, 0.6, 100))
    search.restart(0.6, usual=0.9, lost=(ELSEWHERE[0] + 20, ELSEWHERE[1]))
    found = [one for one in sightings(search, live, frame, 0.6, 40) if one]
    assert found
    assert np.hypot(*np.subtract(found[0].center, ELSEWHERE)) < 3
    search.restart(0.6, usual=0.9, lost=ELSEWHERE)
    sightings(search, live, VIDEO.frame(None), 0.85, 20)
    assert not any(sightings(search, live, frame, 0.6, 100))


def test_what_motion_told_from_the_target_is_not_it_where_it_was_lost(search_and_live):
    """A distractor there isn't sighted at an equal similarity, but if it's far more similar."""
    search, live = search_and_live
    frame, near = VIDEO.frame(ELSEWHERE), [(ELSEWHERE[0] + 3, ELSEWHERE[1])]
    search.restart(0.6, usual=0.9, lost=ELSEWHERE)
    assert not any(sightings(search, live, frame, 0.6, 100, distractors=near))
    search.restart(0.3, usual=0.9, lost=ELSEWHERE)
    assert any(sightings(search, live, frame, 0.3, 100, distractors=near))


def test_time_passes_with_frames_that_were_dropped(search_and_live):
    """Time is counted in `dt`: at four times the interval the target is sighted as soon."""
    search, live = search_and_live
    frame, times = VIDEO.frame(ELSEWHERE), []
    for dt in (1.0, 4.0):
        search.restart(1.0)
        found = sightings(search, live, frame, 0.05, 100, dt)
        times.append(dt * next(index for index, one in enumerate(found) if one))
    assert times[1] == pytest.approx(times[0], rel=0.3)


def test_a_frame_without_the_target_has_no_sighting(search_and_live):
    search, live = search_and_live
    assert not any(sightings(search, live, VIDEO.frame(None), 0.05, 150))


def test_the_tracked_place_is_not_elsewhere(search_and_live):
    """Where the live place is the target's, no other one is sighted."""
    search, live = search_and_live
    live = replace(live, center=ELSEWHERE)
    assert not any(sightings(search, live, VIDEO.frame(ELSEWHERE), 0.05, 150))


def test_it_has_to_be_seen_twice(search_and_live):
    """What is there for one frame only isn't sighted."""
    search, live = search_and_live
    empty, frame = VIDEO.frame(None), VIDEO.frame(ELSEWHERE)
    assert not any(sightings(search, live, empty, 0.05, 60))
    for _ in range(40):
        assert search.update(frame, live, 0.05, False, 1.0) is None
        assert not any(sightings(search, live, empty, 0.05, 6))


def test_a_localiser_that_learned_something_else_finds_its_target():
    """Sharply on another object, with a low usual similarity, it restarts once, at the target."""
    both, alone = VIDEO.frame(HERE), VIDEO.frame(HERE)
    other = texture(
        TARGET[::-1], [(200, 30, 20), (90, 200, 90), (220, 160, 40)], 8, np.random.default_rng(7))
    for image in (both, alone):
        image[region_at(ELSEWHERE)] = other
    alone[:120] = VIDEO.frame(None)[:120]
    localiser, wrong = (Localiser(both, place, TARGET, np.random.default_rng(1))
                        for place in (HERE, ELSEWHERE))

    def follow(frame):
        return localiser.update(
            frame, localiser.localise(frame, localiser.center), localiser.center, 1.0)

    assert not follow(both)
    localiser.resume(replace(wrong.snapshot, usual_similarity=0.05), wrong)
    assert not any(follow(alone) for _ in range(100))
    assert np.hypot(*np.subtract(localiser.center, ELSEWHERE)) < 3
    found = [follow(both) and localiser.restarted for _ in range(150)]
    assert sum(found) == 1
    assert np.hypot(*np.subtract(localiser.center, HERE)) < 3
    assert localiser.similarity > 0.3


@pytest.mark.parametrize('seed', range(4))
def test_what_is_half_like_the_target_is_left_for_it_however_the_failure_ended(seed):
    """At the end of the failure nothing jumped: the half-similar object is at the old place."""
    hidden, half = VIDEO.frame(None), VIDEO.frame(ELSEWHERE)
    half[:120, :160] = (hidden[:120, :160] / 2 + VIDEO.frame(HERE)[:120, :160] / 2)
    localiser = Localiser(VIDEO.frame(HERE), HERE, TARGET, np.random.default_rng(seed))
    for frame in [VIDEO.frame(HERE)] * 10 + [hidden] * 6 + [half] * 40:
        localiser.update(
            frame, localiser.localise(frame, localiser.center), localiser.center, 1.0)
        if localiser.restarted:
            break
    assert np.hypot(*np.subtract(localiser.center, ELSEWHERE)) < 3


@pytest.mark.parametrize('seed', range(4))
def test_what_is_a_little_like_the_target_is_left_for_it_wherever_it_was_found(seed):
    """The search of the whole frame after a long absence finds it, and later the target."""
    hidden, little = VIDEO.frame(None), VIDEO.frame(None)
    little[120:, 160:] = (0.8 * hidden + 0.2 * VIDEO.frame(ELSEWHERE))[120:, 160:]
    both = little.copy()
    both[:120, :160] = VIDEO.frame(HERE)[:120, :160]
    localiser = Localiser(VIDEO.frame(HERE), HERE, TARGET, np.random.default_rng(seed))

    def follow(frame):
        return localiser.update(
            frame, localiser.localise(frame, localiser.center), localiser.center, 1.0)

    for frame in [VIDEO.frame(HERE)] * 10 + [hidden] * 40:
        assert not follow(frame)
    assert any(follow(little) and localiser.restarted for _ in range(100))
    assert np.hypot(*np.subtract(localiser.center, ELSEWHERE)) < 3
    assert any(follow(both) for _ in range(60))
    assert np.hypot(*np.subtract(localiser.center, HERE)) < 3
