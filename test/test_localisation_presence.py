"""Whether the target is present: judged from its similarity and a sharp response."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logit

from vtrack_ros.localisation.presence import (
    logistic, PresenceDetector, state_after, support_of, unknown_covariance)
from vtrack_ros.tracker import TrackState


@pytest.mark.parametrize('similarity', [-1000.0, 0.0, 0.3, 1.0])
@pytest.mark.parametrize('sharpness', [-5.0, 0.0, 6.0, 40.0])
def test_confidence_is_a_share_whatever_the_evidence(similarity, sharpness):
    """What speaks wildly for or against the target is a probability all the same."""
    presence = PresenceDetector()
    presence.judge(similarity, sharpness, 1.0)
    assert 0 <= presence.confidence <= 1


def test_absence_is_told_at_once_and_counted_in_frames():
    """It's said in the frame itself, as is that the target is there again."""
    presence = PresenceDetector()
    assert presence.unseen_frames == 0 and presence.confidence > 0.95
    presence.judge(0.05, 2.5, 1.0)
    presence.judge(0.05, 2.5, 2.0)
    assert presence.unseen_frames == 3 and presence.confidence < 0.2
    presence.judge(0.3, 6.0, 1.0)
    assert presence.unseen_frames == 0 and presence.confidence > 0.7
    # of the same evidence elsewhere nothing is left of that here
    presence.judge(0.05, 2.5, 1.0)
    presence.judge(0.3, 6.0, 1.0, elsewhere=True)
    anew = PresenceDetector()
    anew.judge(0.3, 6.0, 1.0, elsewhere=True)
    assert presence.confidence == anew.confidence > 0.95


def found_after(frames, threshold=0.5):
    """Return who wasn't there for so many frames, and then is there by about two to one."""
    presence = PresenceDetector()
    presence.threshold = threshold
    for _ in range(frames):
        presence.judge(0.02, 2.5, 1.0)
    for _ in range(10):
        presence.judge(0.1, 3.8, 1.0)
    return presence


def test_who_was_lost_for_long_has_to_be_recognised():
    """In each frame without it something else may look like it: so the odds fall."""
    soon, late = found_after(30), found_after(60)
    assert soon.absent_frames == 0 < late.absent_frames
    assert logit(soon.confidence) - logit(late.confidence) == pytest.approx(np.log(2), abs=0.2)
    assert found_after(300).confidence == found_after(3000).confidence < late.confidence


def test_the_confidence_is_the_same_whatever_is_enough():
    """Who asks for more isn't told less."""
    for frames in (0, 30, 60):
        assert found_after(frames, 0.9).confidence == found_after(frames).confidence
        assert found_after(frames, 0.9).absent_frames >= 10


def test_who_is_recognised_after_long_is_there_as_before():
    """From then on half a likeness is enough again; what it does meanwhile knows no doubt."""
    presence = found_after(300)
    assert presence.unseen_frames == 0 < presence.absent_frames
    for _ in range(4):
        presence.judge(0.3, 6.0, 1.0)
    assert presence.absent_frames == 0
    for _ in range(10):
        presence.judge(0.1, 3.8, 1.0)
    assert presence.absent_frames == 0
    assert presence.confidence == pytest.approx(found_after(0).confidence, abs=1e-3)


def test_who_was_lost_for_long_is_recognised_by_the_first_frames_model():
    """To what it has learned since, the live model's response is as sharp as to the target."""
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
    # what it does meanwhile goes by the live model
    assert learned.unseen_frames == target.unseen_frames == 0
    assert not found_after(20).doubts


def test_another_model_speaks_against_the_target_or_says_nothing():
    """By the logarithm of its similarity below .07: what it sees itself may be something else."""
    assert support_of(0.07) == support_of(0.3) == 0
    assert support_of(0.035) == pytest.approx(-np.log(2))
    assert support_of(-1.0) == support_of(0.0) == pytest.approx(-np.log(7))


def test_similarity_and_sharpness_make_up_for_one_another():
    """A target that has turned is known by its sharp response, a blurred one by its look."""
    def confidence(similarity, sharpness):
        presence = PresenceDetector()
        presence.judge(similarity, sharpness, 1.0, elsewhere=True)
        return presence.confidence
    assert confidence(0.09, 6.0) > 0.5 > confidence(0.09, 3.0)
    assert confidence(0.25, 3.0) > 0.5 > confidence(0.04, 6.0)


def test_who_is_sure_has_seen_the_target_well_in_the_latest_frame():
    """One that resembles its first look little is, if the response is sharp."""
    presence = PresenceDetector()
    assert presence.is_sure(0.12, 6.5) and presence.is_sure(0.4, 4.0)
    assert not presence.is_sure(0.05, 3.0) and not presence.is_sure(0.08, 3.5)
    # it's asked, not told
    assert presence.confidence == PresenceDetector().confidence
    for _ in range(3):
        presence.judge(0.05, 2.5, 1.0)
    assert not presence.is_sure(0.12, 6.5)


def after(similarities, interval=1.0):
    """Return what judged frames of such similarities, all as sharp."""
    presence = PresenceDetector()
    for similarity in similarities:
        presence.judge(similarity, 5.0, interval)
    return presence


@pytest.mark.parametrize('interval', [1.0, 4.0])
def test_who_fades_has_turned_and_who_falls_is_hidden(interval):
    """The same look says less for a target if it came at once; how fast is a matter of time."""
    low = [0.08] * 8
    faded = after([*np.geomspace(0.3, 0.08, round(48 / interval)), *low], interval)
    fallen = after([*[0.3] * 20, *low], interval)
    assert logit(faded.confidence) - logit(fallen.confidence) == pytest.approx(1.0, abs=0.01)
    assert fallen.unseen_frames > 0 == faded.unseen_frames


def test_a_fall_is_over_when_the_look_is_back_or_elsewhere():
    """Half the usual similarity doesn't end what half of it wouldn't have begun; .7 of it does."""
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
    """Tracking while it's seen, searching at first, lost when the prediction means nothing."""
    assert [state_after(frames) for frames in (0.0, 1.0, 30.0, 30.5)] == [
        TrackState.TRACKING, TrackState.SEARCHING, TrackState.SEARCHING, TrackState.LOST]


def test_an_unseen_target_may_be_a_side_away_and_farther_later():
    """Errors are shares of the mean side; unseen, a side is added, and twice its square in 30."""
    seen, unseen, later = (
        np.sqrt(np.diag(unknown_covariance(0.1, 0.2, 400.0, frames))) for frames in (0, 1e-9, 30))
    np.testing.assert_allclose(seen, [2, 2, 4, 4])
    np.testing.assert_allclose(unseen[:2]**2, 2**2 + 20**2)
    np.testing.assert_allclose(later[:2]**2, 2**2 + 2 * 20**2)
    np.testing.assert_allclose(later[2:], unseen[2:])
    np.testing.assert_allclose(unseen[2:]**2, 4**2 + 6**2)
    assert unknown_covariance(0.1, 0.2, 400.0, 0.0).shape == (4, 4)


@pytest.mark.parametrize('sharpness', [3.2, 4.0, 5.5, 8.0, 20.0])
def test_who_is_less_like_itself_is_less_sure_to_be_there(sharpness):
    """The standard deviation is .3 sides times the root of the odds against it, or the least."""
    presence = PresenceDetector()
    for _ in range(30):
        presence.judge(0.15, sharpness, 1.0)
    confidence = presence.confidence
    error = 0.3 * np.sqrt((1 - confidence) / confidence)
    x, y, width, height = np.sqrt(np.diag(presence.least_covariance(400.0, 0.06, 0.08))) / 20
    assert x == y == pytest.approx(max(0.06, error))
    assert width == height == pytest.approx(max(0.08, error))
    assert 0.5 < confidence


def test_who_is_hardly_there_may_be_as_far_away_as_who_is_as_likely_as_not():
    """Out of sight another error is added, which doesn't grow with the evidence against it."""
    presence = PresenceDetector()
    for _ in range(30):
        presence.judge(0.02, 2.0, 1.0)
    expected = unknown_covariance(0.3, 0.3, 400.0, presence.absent_frames)
    np.testing.assert_allclose(presence.least_covariance(400.0, 0.1, 0.1), expected)


def test_the_threshold_says_what_is_said_but_not_what_is_done():
    """A confidence is enough or not: the evidence is the same, and a tracker goes by that."""
    lenient, strict = PresenceDetector(), PresenceDetector()
    lenient.threshold, strict.threshold = 0.1, 0.9
    for each in (lenient, strict):
        each.judge(0.09, 4.5, 1.0, elsewhere=True)
    assert 0.1 < lenient.confidence == strict.confidence < 0.9
    assert (lenient.absent_frames, strict.absent_frames) == (0, 1)
    assert lenient.unseen_frames == strict.unseen_frames


def test_support_has_a_say_in_what_is_said_but_not_in_what_is_done():
    """It takes as much off the evidence; whether the target is followed goes by its look."""
    def judged(support, elsewhere=False):
        presence = PresenceDetector()
        for _ in range(6):
            presence.judge(0.09, 5.0, 1.0, elsewhere, support)
        return presence
    usual, resting = judged(0.0), judged(-1.5)
    assert logit(usual.confidence) - logit(resting.confidence) == pytest.approx(1.5, abs=0.01)
    assert resting.absent_frames > 0 == usual.absent_frames
    assert resting.unseen_frames == usual.unseen_frames == 0
    # the way to another place isn't the target's motion
    assert judged(-1.5, elsewhere=True).confidence == judged(0.0, elsewhere=True).confidence
