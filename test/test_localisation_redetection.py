"""Tracking failures: when they begin and end, where the target is searched, and jumps."""

from __future__ import annotations

from dataclasses import replace
import math

import cv2
from drawn_video import DrawnVideo, TARGET
import numpy as np
import pytest

from vtrack_ros.localisation.presence import absent_error, has_failed, InitialTemplate
from vtrack_ros.localisation.redetection import Redetection
from vtrack_ros.localisation.search_window import WindowLayout
from vtrack_ros.localisation.target_model import TargetModel, TargetSnapshot

HERE, ELSEWHERE = (60.0, 60.0), (250.0, 180.0)
VIDEO = DrawnVideo(seed=4, blob=60)


class Verifier:
    """A fake initial template: every place has the same similarity."""

    def __init__(self, similarity):
        """Take the similarity."""
        self._similarity = similarity

    def similarity(self, window, shift=(0.0, 0.0)):
        """Return it."""
        return self._similarity


class FixedModel(TargetModel):
    """A model that is marked as not learning."""

    LEARNS = False


def after(frames):
    """Return where a target from `HERE` is after that many frames with a velocity of (5, 3)."""
    return HERE[0] + 5.0 * frames, HERE[1] + 3.0 * frames


def learned(frame):
    """Return the target's snapshot at `HERE` in a frame, and its template."""
    window = WindowLayout.around(*TARGET).window(frame, HERE, TARGET)
    model = TargetModel.create(window)
    snapshot = TargetSnapshot(model, HERE, TARGET, 0.8, 0.7)
    return snapshot, InitialTemplate.of(model, window)


@pytest.fixture(scope='module')
def known():
    """Return what is learned of the target."""
    return learned(VIDEO.frame(HERE))


def search(snapshot, verifier, velocity=(0.0, 0.0), age=1.0, seed=0):
    """Return a search with a snapshot."""
    return Redetection(snapshot, verifier, velocity, age, np.random.default_rng(seed))


@pytest.mark.parametrize('similarity, peak, failed', [
    (0.7, 0.8, False), (0.16, 0.8, False), (0.14, 0.8, True), (0.7, 0.57, False),
    (0.7, 0.55, True)])
def test_a_failure_is_too_low_a_response_or_similarity(known, similarity, peak, failed):
    """It fails below 0.7 of the usual response, or a similarity of 0.15, good for any target."""
    assert has_failed(known[0], similarity, peak) is failed


def test_the_similarity_of_a_faint_target_may_be_low(known):
    """With a usual similarity of 0.1 it fails below 0.6 of that."""
    faint = replace(known[0], usual_similarity=0.1)
    assert not has_failed(faint, 0.061, 0.8)
    assert has_failed(faint, 0.059, 0.8)


def test_five_frames_of_trusted_similarity_end_the_failure(known):
    """They have to be consecutive: a frame of less similarity resets the count."""
    snapshot, _ = known
    redetection = search(snapshot, Verifier(0.0))
    frame = VIDEO.frame(None)
    for similarities in ([0.14] * 4 + [0.12], [0.14] * 4):
        for similarity in similarities:
            verdict = redetection.update(frame, snapshot, similarity, 0.1, 1.0)
            assert not verdict.over
    verdict = redetection.update(frame, snapshot, 0.14, 0.1, 1.0)
    assert verdict.over and not verdict.elsewhere
    assert verdict.live.usual_similarity == snapshot.usual_similarity


@pytest.mark.parametrize('similarity, over', [(0.105, False), (0.115, True)])
def test_a_faint_target_is_trusted_sooner(known, similarity, over):
    """With a low usual similarity 0.6 of that is trusted."""
    faint = replace(known[0], usual_similarity=0.18)
    redetection, frame = search(faint, Verifier(0.0)), VIDEO.frame(None)
    verdicts = [redetection.update(frame, faint, similarity, 0.1, 1.0) for _ in range(5)]
    assert verdicts[-1].over is over


@pytest.mark.parametrize('peak, over', [(0.7, True), (0.6, False)])
def test_a_target_seen_well_for_forty_frames_has_changed(known, peak, over):
    """A low similarity at which the response is high again is the usual one from now on."""
    snapshot, _ = known
    redetection = search(snapshot, Verifier(0.0))
    frame = VIDEO.frame(None)
    verdicts = [redetection.update(frame, snapshot, 0.125, peak, 1.0) for _ in range(41)]
    assert [verdict.over for verdict in verdicts] == [False] * 40 + [over]
    assert not verdicts[-1].elsewhere
    if over:
        assert verdicts[-1].live.usual_similarity == 0.125


def test_the_usual_response_follows_slowly_meanwhile(known):
    """It changes by 3 % of the difference in a frame."""
    verdict = search(known[0], Verifier(0.0)).update(
        VIDEO.frame(None), known[0], 0.0, 0.3, 1.0)
    assert verdict.live.usual_response == pytest.approx(0.8 - 0.03 * 0.5)


@pytest.mark.parametrize('dt, frames', [(1.0, 36), (4.0, 36)])
def test_a_hidden_target_is_searched_on_its_straight_way_on(known, dt, frames):
    """It's found at once at the extrapolated place, and isn't with a velocity of 0."""
    snapshot, template = known
    velocity = np.subtract(ELSEWHERE, HERE) / frames
    frame = VIDEO.frame(ELSEWHERE)
    verdict = search(snapshot, template, tuple(velocity), frames - dt).update(
        frame, snapshot, 0.0, 0.1, dt)
    assert verdict.over and verdict.elsewhere
    assert np.hypot(*np.subtract(verdict.live.center, ELSEWHERE)) < 4
    assert verdict.similarity > 0.4
    rests = search(snapshot, template, age=1.0).update(frame, snapshot, 0.0, 0.1, dt)
    assert not rests.over


@pytest.mark.parametrize('seed', range(3))
def test_its_colours_tell_where_to_search(known, seed):
    """225 px away, it's found once places are proposed by colours, from the ninth frame on."""
    snapshot, template = known
    redetection = search(snapshot, template, seed=seed)
    frame = VIDEO.frame(ELSEWHERE)
    for count in range(1, 20):
        verdict = redetection.update(frame, snapshot, 0.0, 0.1, 0.01)
        if verdict.over:
            break
    assert verdict.elsewhere and count > 8
    assert np.hypot(*np.subtract(verdict.live.center, ELSEWHERE)) < 4


@pytest.mark.parametrize('usual', [0.1, 0.7])
@pytest.mark.parametrize('similarity, jumps', [(0.08, False), (0.09, True)])
def test_no_jump_to_what_would_not_be_taken_for_the_target(known, usual, similarity, jumps):
    """The similarity has to be at least 0.085, whatever the usual one."""
    snapshot = replace(known[0], usual_similarity=usual)
    redetection = search(snapshot, Verifier(similarity), (5.0, 3.0), 36.0)
    frame = VIDEO.frame(after(37))
    verdict = redetection.update(frame, snapshot, 0.01, 0.5, 1.0)
    assert verdict.elsewhere is jumps
    assert (verdict.live.center == HERE) is not jumps


@pytest.mark.parametrize('away, jumps', [(0.25, False), (0.35, True)])
def test_it_is_not_found_again_at_a_distractor(known, away, jumps):
    """A place within 0.3 sides of a distractor is excluded: motion told it from the target."""
    snapshot, template = known
    place = after(37)
    beside = place[0] + away * math.sqrt(math.prod(TARGET)), place[1]
    verdict = search(snapshot, template, (5.0, 3.0), 36.0).update(
        VIDEO.frame(place), snapshot, 0.01, 0.5, 1.0, distractors=(HERE, beside))
    assert verdict.elsewhere is jumps


@pytest.mark.parametrize('here, jumps', [(0.1, False), (0.08, True)])
def test_a_plausible_place_is_not_left_at_once(known, here, jumps):
    """Another place has to be better in three frames; if this one isn't plausible, in one."""
    snapshot, template = known
    age = 36.0
    redetection = search(snapshot, template, (5.0, 3.0), age)
    over = []
    for count in range(1, 7):
        frame = VIDEO.frame(after(age + count))
        verdict = redetection.update(frame, snapshot, here, 0.5, 1.0)
        over.append(verdict.over)
        if verdict.over:
            break
    # every second frame searches the extrapolated place
    assert len(over) == (1 if jumps else 5) and over[-1] and verdict.elsewhere


@pytest.mark.parametrize('usual, here, there, jumps', [
    (0.7, 0.12, 0.165, False), (0.7, 0.12, 0.175, True),  # a gain of 0.05, the level
    (0.2, 0.12, 0.135, False), (0.2, 0.12, 0.145, True),  # a gain of 0.02, the share
])
def test_a_jump_has_to_gain_enough(known, usual, here, there, jumps):
    """It's the lower of a tenth of the usual similarity and 0.05."""
    redetection = search(
        replace(known[0], usual_similarity=usual), Verifier(there), (5.0, 3.0), 36.0)
    over = False
    for count in range(1, 6):
        frame = VIDEO.frame(after(36 + count))
        over = over or redetection.update(frame, known[0], here, 0.5, 1.0).over
    assert over is jumps


@pytest.mark.parametrize('there, jumps', [(0.125, False), (0.135, True)])
@pytest.mark.parametrize('learns, seen, frames', [(True, True, 10), (False, False, 36)])
def test_a_jump_from_a_seen_target_needs_a_similarity_that_is_trusted(
        known, learns, seen, frames, there, jumps):
    """It's 0.13, for a model that doesn't learn, too, however low the present similarity is."""
    model = (TargetModel if learns else FixedModel)(**vars(known[0].model))
    snapshot = replace(known[0], model=model)
    redetection = search(snapshot, Verifier(there), (5.0, 3.0), frames - 1.0)
    frame = VIDEO.frame(after(frames))
    verdict = redetection.update(frame, snapshot, -0.1, 0.5, 1.0, odds=0.0 if seen else -0.5)
    assert verdict.over is jumps


@pytest.mark.parametrize('offset, jumps', [(0.25, False), (0.35, True)])
def test_the_present_place_is_no_other_one(known, offset, jumps):
    """A place within 0.3 of the target's size isn't jumped to, however similar it is."""
    snapshot, template = known
    place = after(37)
    live = replace(snapshot, center=(place[0], place[1] - offset * TARGET[1]))
    verdict = search(snapshot, template, (5.0, 3.0), 36.0).update(
        VIDEO.frame(place), live, 0.0, 0.5, 1.0)
    assert verdict.elsewhere is jumps


class Draws:
    """A fake generator that draws these places: their offsets in standard deviations."""

    def __init__(self, places, spread):
        """Take the places and the standard deviation, in pixels."""
        self._draws = [np.subtract(place, HERE) / spread for place in places]

    def standard_normal(self, count):
        """Return the next one."""
        return self._draws.pop(0)

    def random(self):
        """Return 1, so that no place is proposed by colours."""
        return 1.0


@pytest.mark.parametrize('offset', [(0.9, 0.0), (0.0, 1.0), (0.0, -1.1)])
def test_a_target_near_the_border_of_a_window_is_looked_at_again(known, offset):
    """Its response there is too low for verification; in a second window about it it isn't."""
    place = tuple(at + shift * side for at, shift, side in zip(HERE, offset, TARGET))
    frame = VIDEO.frame(place)
    snapshot = replace(
        known[0], usual_response=known[0].localise(frame, HERE).peak / 0.45)
    redetection = Redetection(
        snapshot, Verifier(0.5), (0.0, 0.0), 1.0, Draws([(250.0, 60.0), (250.0, 180.0)], 45.0))
    verdict = redetection.update(frame, snapshot, 0.0, 0.0, 1.0)
    assert verdict.elsewhere
    assert np.hypot(*np.subtract(verdict.live.center, place)) < 4


@pytest.mark.parametrize('rival, found', [((226.0, 58.0), True), ((60.0, 190.0), False)])
def test_where_the_live_model_answers_is_looked_at(known, rival, found):
    """A target far from all other places that are searched is found if it's near the rival."""
    snapshot, template = known
    redetection = Redetection(
        snapshot, template, (0.0, 0.0), 20.0, Draws([(30.0, 200.0), (40.0, 190.0)], 45.0))
    verdict = redetection.update(
        VIDEO.frame((230.0, 60.0)), snapshot, 0.0, 0.1, 1.0, rival=rival)
    assert verdict.elsewhere is found
    if found:
        assert np.hypot(*np.subtract(verdict.live.center, (230.0, 60.0))) < 4


@pytest.mark.parametrize('share, away, before, jumps', [
    (0.95, 126.0, 1, True), (0.66, 126.0, 1, False), (0.66, 126.0, 7, True),
    (0.505, 160.0, 100, False)])
def test_a_lower_response_needs_a_longer_search(known, share, away, before, jumps):
    """Just after an occlusion the response has to be high; up to a limit, less is enough later."""
    place = HERE[0] + away, HERE[1]
    frame = VIDEO.frame(place)
    snapshot = replace(
        known[0], usual_response=known[0].localise(frame, place).peak / share)
    redetection = Redetection(
        snapshot, Verifier(0.09), (0.0, 0.0), 1.0,
        Draws([(150.0, 180.0)] * 2 * before + [place] * 2, 45.0))
    for _ in range(before):
        redetection.update(VIDEO.frame(None), snapshot, 0.0, 0.0, 0.01)
    verdict = redetection.update(frame, snapshot, 0.0, 0.0, 0.01)
    assert verdict.elsewhere is jumps


@pytest.mark.parametrize('learns, near, far, found', [
    (True, 0.3, 0.33, 'near'), (True, 0.1, 0.6, 'far'),
    (False, 0.3, 0.33, 'far'), (False, 0.33, 0.3, 'near'),
    (False, 0.0, 0.0, 'far')])  # neither is similar, so the higher response
def test_the_nearer_of_two_places_is_the_target_unless_the_other_is_far_more_like_it(
        known, learns, near, far, found):
    """By log-odds of distance and similarity; with a model that doesn't learn, by similarity."""
    places = {'near': (HERE[0] + 70.0, HERE[1] + 10.0), 'far': ELSEWHERE}
    frame = VIDEO.frame(places['near'])
    there, (x, y) = VIDEO.frame(ELSEWHERE), ELSEWHERE
    frame[int(y) - 60:, int(x) - 60:] = there[int(y) - 60:, int(x) - 60:]
    model = (TargetModel if learns else FixedModel)(**vars(known[0].model))
    snapshot = replace(known[0], model=model)
    if not near:
        # partly covered there, so that the response is lower
        snapshot = replace(snapshot, usual_response=0.4)
        left, top = (int(at) for at in places['near'])
        frame[top:top + TARGET[1] // 2, left - TARGET[0] // 2:left + TARGET[0] // 2] = 128

    class ByPlace:

        def similarity(self, window, shift=(0.0, 0.0)):
            return far if window.center[0] > 190 else near
    age = 20.0
    spread = math.sqrt(math.prod(TARGET)) * absent_error(age + 1)
    redetection = Redetection(
        snapshot, ByPlace(), (0.0, 0.0), age, Draws(places.values(), spread))
    verdict = redetection.update(frame, snapshot, 0.0, 0.1, 1.0)
    assert verdict.elsewhere
    assert np.hypot(*np.subtract(verdict.live.center, places[found])) < 4


@pytest.mark.parametrize('learns, usual, here, follows', [
    (False, 0.7, 0.1, True), (True, 0.7, 0.1, False),
    (False, 2.0, 0.1, False), (False, 0.7, 0.9, False)])  # less than usual, or no more than here
def test_a_model_that_never_learns_is_followed_unverified(known, learns, usual, here, follows):
    """It moves to a far higher, usual response; the failure is over only once it's verified."""
    model = (TargetModel if learns else FixedModel)(**vars(known[0].model))
    snapshot = replace(known[0], model=model, usual_response=usual)
    redetection = search(snapshot, Verifier(0.0), (5.0, 3.0), 36.0)
    place = after(37)
    verdict = redetection.update(VIDEO.frame(place), snapshot, 0.0, here, 1.0)
    assert verdict.elsewhere is follows and not verdict.over
    assert np.hypot(*np.subtract(verdict.live.center, place if follows else HERE)) < 4


@pytest.mark.parametrize('odds, share, moves, over', [
    (-1.1, 0.5, True, False), (-0.9, 0.5, False, False),
    (-1.1, 0.35, False, False), (-1.1, 1.0, True, True)])
def test_from_where_the_target_hardly_is_it_goes_on_where_it_may_be(odds, share, moves, over):
    """If log-odds here are below -1, it follows a pale target elsewhere; the failure goes on."""
    first, there, nothing = (VIDEO.frame(place, 0.0) for place in (HERE, ELSEWHERE, None))
    snapshot, _ = learned(first)
    frame = cv2.addWeighted(there, share, nothing, 1 - share, 0)
    verdict = search(snapshot, Verifier(0.1)).update(
        frame, snapshot, 0.01, 0.5, 1.0, odds=odds, rival=ELSEWHERE)
    assert (verdict.elsewhere, verdict.over) == (moves, over)
    assert verdict.tentative is (moves and not over)
    assert np.hypot(*np.subtract(verdict.live.center, ELSEWHERE if moves else HERE)) < 4


@pytest.mark.parametrize('here, frames', [(0.034, 1), (0.036, 5)])
def test_the_present_place_of_a_faint_target_is_plausible_sooner(known, here, frames):
    """From 0.35 of the usual similarity on; then a jump takes three better places, else one."""
    faint = replace(known[0], usual_similarity=0.1)
    redetection = search(faint, Verifier(0.5), (5.0, 3.0), 36.0)
    for count in range(1, 7):
        frame = VIDEO.frame(after(36 + count))
        if redetection.update(frame, faint, here, 0.5, 1.0).over:
            break
    assert count == frames


def test_the_way_on_grows_with_the_time_of_each_frame(known):
    """With an interval of seven frames, the extrapolation goes on by seven steps."""
    snapshot, template = replace(known[0], center=(60.0, 90.0)), known[1]
    redetection = search(snapshot, template, (4.0, 2.0), 2.0)
    nothing = VIDEO.frame(None)
    for _ in range(4):
        assert not redetection.update(nothing, snapshot, 0.0, 0.1, 7.0).over
    place = (60.0 + 4.0 * 37, 90.0 + 2.0 * 37)
    verdict = redetection.update(VIDEO.frame(place), snapshot, 0.0, 0.1, 7.0)
    assert verdict.elsewhere
    assert np.hypot(*np.subtract(verdict.live.center, place)) < 4


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('velocity', [(0.0, 0.0), (4.0, 2.0)])
def test_long_after_a_target_is_searched_where_it_was_seen_last(known, velocity, seed):
    """After 60 frames the place where it was seen last replaces the extrapolated one."""
    snapshot, template = known
    redetection = search(snapshot, template, velocity, 50.0, seed)
    nothing, there = VIDEO.frame(None), replace(snapshot, center=ELSEWHERE)
    redetection.update(nothing, there, 0.0, 0.1, 1.0, odds=0.0)
    redetection.update(nothing, snapshot, 0.0, 0.1, 10.0)
    frame = VIDEO.frame(ELSEWHERE)
    verdicts = [redetection.update(frame, snapshot, 0.0, 0.1, 1.0) for _ in range(2)]
    assert any(verdict.over for verdict in verdicts)
    verdict = next(verdict for verdict in verdicts if verdict.over)
    assert np.hypot(*np.subtract(verdict.live.center, ELSEWHERE)) < 4


def test_the_size_of_an_uncertain_target_is_bounded(known):
    """They are 1.5 times more and less than the last size, as factors of the given width."""
    assert search(known[0], Verifier(0.0)).bounds(TARGET[0] / 2) == (2 / 1.5, 2 * 1.5)
