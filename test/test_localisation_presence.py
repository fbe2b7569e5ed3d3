"""Whether the target is present: judged from its similarity and a sharp response."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logit

from vtrack_ros.localisation.filter_parameters import PRESENCE
from vtrack_ros.localisation.presence import (
    logistic, PresenceDetector, state_after, support_of, unknown_covariance)
from vtrack_ros.tracker import TrackState


@pytest.mark.parametrize('similarity', [-1000.0, 0.0, 0.3, 1.0])
@pytest.mark.parametrize('sharpness', [-5.0, 0.0, 6.0, 40.0])
def test_confidence_is_a_share_whatever_the_evidence(similarity, sharpness):
    """It's in [0, 1] for extreme similarities and sharpness, too."""
    presence = PresenceDetector()
    presence.judge(similarity, sharpness, 1.0)
    assert 0 <= presence.confidence <= 1


def test_absence_is_told_at_once_and_counted_in_frames():
    """Absence and return are reported in the frame itself; unseen frames are summed by `dt`."""
    presence = PresenceDetector()
    assert presence.unseen_frames == 0 and presence.confidence > 0.95
    presence.judge(0.05, 2.5, 1.0)
    presence.judge(0.05, 2.5, 2.0)
    assert presence.unseen_frames == 3 and presence.confidence < 0.2
    presence.judge(0.3, 6.0, 1.0)
    assert presence.unseen_frames == 0 and presence.confidence > 0.7
    # evidence from another place isn't averaged with that from here
    presence.judge(0.05, 2.5, 1.0)
    presence.judge(0.3, 6.0, 1.0, elsewhere=True)
    anew = PresenceDetector()
    anew.judge(0.3, 6.0, 1.0, elsewhere=True)
    assert presence.confidence == anew.confidence > 0.95


def found_after(frames, threshold=0.5):
    """Return a detector after frames without the target, then ten at odds of 1.6 for it."""
    presence = PresenceDetector()
    presence.threshold = threshold
    for _ in range(frames):
        presence.judge(0.02, 2.5, 1.0)
    for _ in range(10):
        presence.judge(0.1, 3.8, 1.0)
    return presence


def test_a_target_that_was_lost_for_long_has_to_be_recognised():
    """Twice as many frames without it halve the odds, for something else may look like it."""
    soon, late = found_after(30), found_after(60)
    assert soon.absent_frames == 0 < late.absent_frames
    assert logit(soon.confidence) - logit(late.confidence) == pytest.approx(np.log(2), abs=0.2)
    assert found_after(300).confidence == found_after(3000).confidence < late.confidence


def test_the_confidence_is_the_same_whatever_is_enough():
    """A higher threshold lengthens the reported absence, but doesn't change the confidence."""
    for frames in (0, 30, 60):
        assert found_after(frames, 0.9).confidence == found_after(frames).confidence
        assert found_after(frames, 0.9).absent_frames >= 10


def test_a_target_that_is_recognised_after_long_is_there_as_before():
    """Strong evidence ends the penalty for the absence; `unseen_frames` never depends on it."""
    presence = found_after(300)
    assert presence.unseen_frames == 0 < presence.absent_frames
    for _ in range(4):
        presence.judge(0.3, 6.0, 1.0)
    assert presence.absent_frames == 0
    for _ in range(10):
        presence.judge(0.1, 3.8, 1.0)
    assert presence.absent_frames == 0
    assert presence.confidence == pytest.approx(found_after(0).confidence, abs=1e-3)


def test_a_target_that_was_lost_for_long_is_recognised_by_the_first_frames_model():
    """Only a sharp response of the first frame's model confirms it after 60 missed frames."""
    def found(first_sharpness):
        presence = PresenceDetector()
        for _ in range(60):
            presence.judge(0.02, 2.5, 1.0)
        assert presence.doubts
        for _ in range(6):
            presence.judge(0.15, 8.0, 1.0, first_sharpness=first_sharpness)
        return presence
    learned, target = found(2.5), found(8.0)
    assert learned.doubts and learned.absent_frames > 0 and learned.confidence < 0.5
    assert not target.doubts and target.absent_frames == 0 and target.confidence > 0.8
    # the unseen frames depend on the live model
    assert learned.unseen_frames == target.unseen_frames == 0
    assert not found_after(20).doubts


def test_another_model_speaks_against_the_target_or_says_nothing():
    """It's log(similarity / 0.07) for similarities below 0.07, -log 7 at least, and 0 above."""
    assert support_of(0.07) == support_of(0.3) == 0
    assert support_of(0.035) == pytest.approx(-np.log(2))
    assert support_of(-1.0) == support_of(0.0) == pytest.approx(-np.log(7))


def test_similarity_and_sharpness_make_up_for_one_another():
    """A sharp response makes up for a low similarity (a turn), and vice versa (blur)."""
    def confidence(similarity, sharpness):
        presence = PresenceDetector()
        presence.judge(similarity, sharpness, 1.0, elsewhere=True)
        return presence.confidence
    assert confidence(0.09, 6.0) > 0.5 > confidence(0.09, 3.0)
    assert confidence(0.25, 3.0) > 0.5 > confidence(0.04, 6.0)


def test_a_sure_detector_has_seen_the_target_well_in_the_latest_frame():
    """It's sure at a high similarity, or at less with a sharp response; not after an absence."""
    presence = PresenceDetector()
    assert presence.is_sure(0.12, 6.5) and presence.is_sure(0.4, 4.0)
    assert not presence.is_sure(0.05, 3.0) and not presence.is_sure(0.08, 3.5)
    # the query doesn't change the state
    assert presence.confidence == PresenceDetector().confidence
    for _ in range(3):
        presence.judge(0.05, 2.5, 1.0)
    assert not presence.is_sure(0.12, 6.5)


def after(similarities, interval=1.0):
    """Return a detector after frames of these similarities, all as sharp."""
    presence = PresenceDetector()
    for similarity in similarities:
        presence.judge(similarity, 5.0, interval)
    return presence


@pytest.mark.parametrize('interval', [1.0, 4.0])
def test_a_similarity_that_fades_is_a_turn_and_one_that_falls_an_occlusion(interval):
    """An abrupt fall of the similarity lowers the log-odds by 1; a gradual one doesn't."""
    low = [0.08] * 8
    faded = after([*np.geomspace(0.3, 0.08, round(48 / interval)), *low], interval)
    fallen = after([*[0.3] * 20, *low], interval)
    assert logit(faded.confidence) - logit(fallen.confidence) == pytest.approx(1.0, abs=0.01)
    assert fallen.unseen_frames > 0 == faded.unseen_frames


def test_a_fall_is_over_when_the_look_is_back_or_elsewhere():
    """Half the usual similarity neither begins nor ends a fall; 0.7 of it or a jump ends it."""
    dipped, hidden, back = (after([*[0.3] * 20, first, *[second] * 9]) for first, second in (
        (0.15, 0.15), (0.05, 0.15), (0.05, 0.21)))
    assert logit(dipped.confidence) - logit(hidden.confidence) == pytest.approx(1.0, abs=0.01)
    never = after([0.21] * 9)
    assert logit(back.confidence) - logit(never.confidence) == pytest.approx(0.0, abs=0.01)
    for presence in (hidden, dipped):
        presence.judge(0.15, 5.0, 1.0, elsewhere=True)
    assert hidden.confidence == dipped.confidence


def test_the_logistic_function():
    """1 / (1 + exp(-x)), from 0 to 1 for any number."""
    for value in (-3.0, 0.0, 0.5, 2.0):
        assert logistic(value) == pytest.approx(1 / (1 + np.exp(-value)))
    assert (logistic(-1e9), logistic(1e9)) == (0.0, 1.0)


def test_a_target_is_lost_after_thirty_frames_unseen():
    """TRACKING while it's seen, SEARCHING for up to 30 frames, then LOST."""
    assert [state_after(frames) for frames in (0.0, 1.0, 30.0, 30.5)] == [
        TrackState.TRACKING, TrackState.SEARCHING, TrackState.SEARCHING, TrackState.LOST]


def test_an_unseen_target_may_be_a_side_away_and_farther_later():
    """Unseen, a side is added to the centre's error; after 30 frames that variance is doubled."""
    seen, unseen, later = (
        np.sqrt(np.diag(unknown_covariance(0.1, 0.2, 400.0, frames))) for frames in (0, 1e-9, 30))
    np.testing.assert_allclose(seen, [2, 2, 4, 4])
    np.testing.assert_allclose(unseen[:2]**2, 2**2 + 20**2)
    np.testing.assert_allclose(later[:2]**2, 2**2 + 2 * 20**2)
    np.testing.assert_allclose(later[2:], unseen[2:])
    np.testing.assert_allclose(unseen[2:]**2, 4**2 + 6**2)
    assert unknown_covariance(0.1, 0.2, 400.0, 0.0).shape == (4, 4)


@pytest.mark.parametrize('sharpness', [3.2, 4.0, 5.5, 8.0, 20.0])
def test_a_target_that_is_less_like_itself_is_less_sure_to_be_there(sharpness):
    """The standard deviation is 0.3 sides times the root of the odds against, or the least one."""
    presence = PresenceDetector()
    for _ in range(30):
        presence.judge(0.15, sharpness, 1.0)
    confidence = presence.confidence
    error = 0.3 * np.sqrt((1 - confidence) / confidence)
    x, y, width, height = np.sqrt(np.diag(presence.least_covariance(400.0, 0.06, 0.08))) / 20
    assert x == y == pytest.approx(max(0.06, error))
    assert width == height == pytest.approx(max(0.08, error))
    assert 0.5 < confidence


def test_a_target_that_is_hardly_there_may_be_as_far_away_as_at_even_odds():
    """Below even odds the error is that at even odds, and the error out of sight is added."""
    presence = PresenceDetector()
    for _ in range(30):
        presence.judge(0.02, 2.0, 1.0)
    expected = unknown_covariance(0.3, 0.3, 400.0, presence.absent_frames)
    np.testing.assert_allclose(presence.least_covariance(400.0, 0.1, 0.1), expected)


def test_the_threshold_says_what_is_said_but_not_what_is_done():
    """It changes `absent_frames`, but neither the confidence nor `unseen_frames`."""
    lenient, strict = PresenceDetector(), PresenceDetector()
    lenient.threshold, strict.threshold = 0.1, 0.9
    for each in (lenient, strict):
        each.judge(0.09, 4.5, 1.0, elsewhere=True)
    assert 0.1 < lenient.confidence == strict.confidence < 0.9
    assert (lenient.absent_frames, strict.absent_frames) == (0, 1)
    assert lenient.unseen_frames == strict.unseen_frames


def test_without_a_threshold_of_its_own_a_tracker_reports_as_by_default():
    """A localiser that a tracker never tells `confidence_threshold` reports by its default."""
    given, default = PresenceDetector(), PresenceDetector()
    given.threshold = PRESENCE['confidence_threshold'].default
    for each in (given, default):
        each.judge(0.09, 3.2, 1.0, elsewhere=True)
    assert given.threshold < default.confidence < 0.5
    assert default.absent_frames == given.absent_frames == 0


def test_support_has_a_say_in_what_is_said_but_not_in_what_is_done():
    """It's added to the reported log-odds, but `unseen_frames` depends on appearance alone."""
    def judged(support, elsewhere=False):
        presence = PresenceDetector()
        for _ in range(6):
            presence.judge(0.09, 5.0, 1.0, elsewhere, support)
        return presence
    usual, resting = judged(0.0), judged(-1.5)
    assert logit(usual.confidence) - logit(resting.confidence) == pytest.approx(1.5, abs=0.01)
    assert resting.absent_frames > 0 == usual.absent_frames
    assert resting.unseen_frames == usual.unseen_frames == 0
    # a jump to another place isn't the target's motion
    assert judged(-1.5, elsewhere=True).confidence == judged(0.0, elsewhere=True).confidence
