"""A target that is learned afresh in a larger or a smaller extent."""

import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.session.session import TrackingSession

STEP = 40_000_000


def frames(count=12):
    """Return frames of a figure of two colours that moves right by two pixels a frame."""
    ground = np.random.default_rng(0).integers(90, 120, (240, 320, 3), np.uint8)
    made = []
    for index in range(count):
        frame = ground.copy()
        left = 100 + 2 * index
        frame[60:120, left:left + 60] = (40, 60, 200)
        frame[120:180, left:left + 60] = (190, 70, 40)
        made.append(frame)
    return made


def whole(index):
    """Return the figure's box in a frame."""
    return Box(100 + 2 * index, 60, 60, 120)


def on_the_part(tracker='gmpf', upto=6):
    """Return a session that has tracked the figure's upper part for some frames."""
    session = TrackingSession(tracker)
    session.start(frames()[0], 0, Box(100, 60, 60, 60))
    for index in range(1, upto):
        session.update(frames()[index], STEP * index)
    return session


def test_no_target():
    """Without a target there's nothing to resize."""
    assert TrackingSession().resize(True) is None


@pytest.mark.parametrize('tracker', ['gmpf', 'appf', 'dcf'])
def test_larger(tracker):
    """The whole figure is tracked from the frame on in which it was asked for."""
    session = on_the_part(tracker)
    assert session.estimate.box.iou(whole(5)) < 0.6
    assert session.resize(True).box.iou(whole(5)) > 0.6
    for index in range(6, 12):
        session.update(frames()[index], STEP * index)
    assert session.estimate.measured and session.estimate.box.iou(whole(11)) > 0.6
    assert session.interval == STEP


def test_exemplar_is_of_the_new_extent():
    """After a resize the exemplar, from which the target is learned later, has the new extent."""
    session = on_the_part()
    session.resize(True)
    box = session.exemplar.box
    assert box.height / box.width == pytest.approx(2.0, rel=0.35)


def test_nothing_larger_keeps_the_target():
    """At the end of the image it's refused, and tracking goes on in the box of before."""
    session = on_the_part()
    with pytest.raises(ValueError, match='found no extent'):
        for _ in range(30):
            session.resize(True)
    before = session.estimate.box
    assert session.update(frames()[6], STEP * 6).box.iou(before) > 0.5
