"""Whether the target is present: judged from its similarity in a few frames."""

from __future__ import annotations

import numpy as np
import pytest

from vtrack_ros.localisation.presence import (
    logistic, PresenceDetector, state_after, unknown_covariance)
from vtrack_ros.tracker import TrackState


@pytest.mark.parametrize('similarity', [-1000.0, -20.0, 0.0, 20.0, 1000.0])
def test_confidence_is_a_share_whatever_the_similarity(similarity):
    """A place that speaks wildly for or against the target counts no more than a clear one."""
    presence = PresenceDetector()
    for _ in range(10):
        presence.judge(similarity, 0.3, 1.0)
        assert 0 <= presence.confidence <= 1
    assert presence.confidence == pytest.approx(float(similarity > 0), abs=0.02)
    for _ in range(3):
        presence.judge(0.0 if similarity > 0 else 0.3, 0.3, 1.0)
    assert presence.confidence == pytest.approx(float(similarity <= 0), abs=0.1)


def test_absence_is_counted_in_frames_and_not_from_one_bad_frame():
    """One bad frame among good ones is none; the second one is; another place begins anew."""
    presence = PresenceDetector()
    assert presence.unseen_frames == 0
    presence.judge(0.0, 0.3, 1.0)
    assert presence.unseen_frames == 0
    for _ in range(5):
        presence.judge(0.3, 0.3, 1.0)
    assert presence.unseen_frames == 0 and presence.confidence > 0.9
    presence.judge(0.0, 0.3, 1.0)
    presence.judge(0.0, 0.3, 2.0)
    presence.judge(0.0, 0.3, 3.0)
    assert presence.unseen_frames == 5 and presence.confidence < 0.2
    presence.judge(0.3, 0.3, 1.0, elsewhere=True)
    assert presence.unseen_frames == 0 and presence.confidence > 0.9
    # the margin is the new place's alone, and no case is clearer than 0.1
    anew = PresenceDetector()
    assert presence.confidence == anew.confidence
    anew.judge(0.3, 0.3, 1.0)
    assert presence.confidence == anew.confidence == logistic(0.1 / 0.02)


def test_what_is_plain_to_see_has_to_be_plain():
    """A similarity that's enough for a target of which little is known isn't for a clear one."""
    faint, plain = PresenceDetector(), PresenceDetector()
    for _ in range(5):
        faint.judge(0.1, 0.2, 1.0)
        plain.judge(0.1, 0.75, 1.0)
    assert faint.confidence > 0.5 > plain.confidence


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
