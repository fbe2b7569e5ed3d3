"""Mistakes in a tracker of one's own: what is wrong is told, and where."""

import numpy as np
import pytest
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Estimate, Tracker, TrackState
from vtrack_ros.trackers import Box

FRAME = np.zeros((40, 40, 3), np.uint8)
BOX = Box(10, 10, 20, 20)


class Own(Tracker):
    """A tracker that returns what it's told to return."""

    NAME = 'own'
    SUMMARY = 'for tests'
    PARAMETERS = ParameterTable([])
    result = Estimate(BOX, 0.0, np.zeros((4, 4)), 1.0, TrackState.TRACKING)

    def _start(self, frame, box):
        return self.result

    def _update(self, frame, dt):
        return self.result


@pytest.mark.parametrize('result, words', [
    (None, 'own: .* must return an Estimate, not NoneType'),
    (BOX, 'own: .* must return an Estimate, not Box'),
    (Estimate(BOX, 0.0, np.zeros((2, 2)), 1.0, TrackState.TRACKING),
     r'own: .*\(4, 4\).*\(2, 2\)')])
def test_a_result_that_is_no_estimate(result, words):
    """A forgotten return is told where it's missing, not where the estimate is used."""
    tracker = Own()
    tracker.start(FRAME, BOX)
    tracker.result = result
    with pytest.raises((TypeError, ValueError), match=words):
        tracker.update(FRAME)
    with pytest.raises((TypeError, ValueError), match=words):
        tracker.start(FRAME, BOX)


@pytest.mark.parametrize('default, more, words', [
    (2.0, {'low': 0.1, 'high': 1.0}, 'share must be a number from 0.1 to 1, not 2.0'),
    ('c', {'choices': ('a', 'b')}, "share must be one of a, b, not 'c'"),
    (None, {}, 'share: the default must be'), ([1.0], {}, 'share: the default must be')])
def test_a_default_that_is_not_valid(default, more, words):
    """Told where it's written: before, no node would start, whichever tracker it was to use."""
    with pytest.raises((TypeError, ValueError), match=words):
        Parameter('share', default, 'A share.', **more)
