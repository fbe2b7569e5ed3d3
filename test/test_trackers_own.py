"""Mistakes in a tracker of one's own: what is wrong is told, and where."""

from dataclasses import replace

import numpy as np
import pytest
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.tracker import Estimate, Tracker, TrackState
from vtrack_ros.trackers import Box

FRAME = np.zeros((40, 40, 3), np.uint8)
BOX = Box(10, 10, 20, 20)
GOOD = Estimate(BOX, 0.0, np.zeros((4, 4)), 1.0, TrackState.TRACKING)


class Own(Tracker):
    """A tracker that returns what it's told to return."""

    NAME = 'own'
    SUMMARY = 'for tests'
    PARAMETERS = ParameterTable([])
    result = GOOD

    def _start(self, frame, box):
        return self.result

    def _update(self, frame, dt):
        return self.result


@pytest.mark.parametrize('result, words', [
    (None, 'own: .* must return an Estimate, not NoneType'),
    (BOX, 'own: .* must return an Estimate, not Box'),
    (replace(GOOD, covariance=np.zeros((2, 2))), r'own: .*\(4, 4\).*\(2, 2\)'),
    (replace(GOOD, covariance=np.zeros((4, 4)).tolist()), 'own: the covariance .* ndarray'),
    (replace(GOOD, box=(10, 10, 20, 20)), 'own: the box of an estimate must be a Box, not '),
    (replace(GOOD, state='tracking'), "own: the state .* a TrackState, not 'tracking'"),
    (replace(GOOD, confidence=None), 'own: the confidence .* from 0 to 1, not None'),
    (replace(GOOD, confidence=np.nan), 'own: the confidence .* from 0 to 1, not nan'),
    (replace(GOOD, confidence=1.1), 'own: the confidence .* from 0 to 1, not 1.1'),
    (replace(GOOD, particles=np.zeros((5, 2))), r'own: the particles .*\(N, 4\), not \(5, 2\)')])
def test_a_result_that_is_no_estimate(result, words):
    """A forgotten return is told where it's missing, not where the estimate is used."""
    tracker = Own()
    tracker.start(FRAME, BOX)
    tracker.result = result
    with pytest.raises((TypeError, ValueError), match=words):
        tracker.update(FRAME)
    with pytest.raises((TypeError, ValueError), match=words):
        tracker.start(FRAME, BOX)


class Ordered(Own):
    """A tracker whose parameters are refused only once they are taken."""

    NAME = 'ordered'
    PARAMETERS = ParameterTable([
        Parameter(name, default, 'A bound.', 0.0, 9.0)
        for name, default in (('least', 1.0), ('most', 2.0))])

    def _configure(self):
        self.bounds = self.parameters['least'], self.parameters['most']
        if self.bounds[0] > self.bounds[1]:
            raise ValueError('least must not be above most')


def test_a_change_that_is_refused_when_it_is_taken():
    """It's not made: before, it stayed, and each later change was refused for it."""
    tracker = Ordered(most=3.0)
    with pytest.raises(ValueError, match='least must not be above most'):
        tracker.configure(least=5.0)
    assert (tracker.parameters, tracker.bounds) == ({'least': 1.0, 'most': 3.0}, (1.0, 3.0))
    tracker.configure(most=2.0)
    assert tracker.bounds == (1.0, 2.0)
    with pytest.raises(ValueError, match='least must not be above most'):
        Ordered(least=5.0)


@pytest.mark.parametrize('default, more, words', [
    (2.0, {'low': 0.1, 'high': 1.0}, 'share must be a number from 0.1 to 1, not 2.0'),
    ('c', {'choices': ('a', 'b')}, "share must be one of a, b, not 'c'"),
    (None, {}, 'share: the default must be'), ([1.0], {}, 'share: the default must be')])
def test_a_default_that_is_not_valid(default, more, words):
    """Told where it's written: before, no node would start, whichever tracker it was to use."""
    with pytest.raises((TypeError, ValueError), match=words):
        Parameter('share', default, 'A share.', **more)


@pytest.mark.parametrize('bound, wrong, words', [
    ({'low': 1.0}, 0.5, 'size must be a number of at least 1, not 0.5'),
    ({'high': 9.0}, 9.5, 'size must be a number of at most 9, not 9.5'),
    ({'low': 1.0, 'unit': 'px'}, 0.5, 'size must be a number of at least 1 px, not 0.5')])
def test_a_number_with_a_single_bound(bound, wrong, words):
    """It's told: before, 0.5 was refused because it "must be a number"."""
    with pytest.raises(ValueError, match=words):
        Parameter('size', 3.0, 'A size.', **bound).checked(wrong)
