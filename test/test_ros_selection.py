"""Selections and the frames they were drawn on."""

import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.ros.selection import FrameHistory, Selection, Selector, TOLERANCE

SECOND = 10**9


def frame(value=0, side=100):
    """Return a grey picture."""
    return np.full((side, side), value, np.uint8)


def history(seconds=2.0, megabytes=1.0, stamps=()):
    """Return a history with frames of these stamps, whose pixels are their indices."""
    result = FrameHistory(seconds, megabytes)
    for index, stamp in enumerate(stamps):
        result.append(stamp, frame(index))
    return result


def test_history_is_bounded_in_time():
    """Frames older than the bound go."""
    kept = history(seconds=1.0, stamps=[i * SECOND // 4 for i in range(20)])
    assert (kept.oldest, kept.newest) == (15 * SECOND // 4, 19 * SECOND // 4)
    assert len(kept) == 5


def test_history_is_bounded_in_memory():
    """However fast the camera and large its images, memory has a limit."""
    kept = FrameHistory(30.0, 0.1)
    for index in range(1000):
        kept.append(index, frame(side=100))
        assert kept.nbytes <= 100_000
    assert len(kept) == 10
    # The newest frame is kept whatever it takes.
    kept.append(2000, frame(side=1000))
    assert len(kept) == 1 and kept.newest == 2000


def test_history_clears_when_stamps_go_backwards():
    """Frames of another stream are no frames of this one."""
    kept = history(stamps=[10, 20, 30])
    kept.append(5, frame(9))
    assert len(kept) == 1 and kept.nbytes == 10_000


def test_since_takes_the_nearest():
    """Between two frames the nearer one is meant."""
    kept = history(stamps=[100, 200, 300])
    assert [stamp for stamp, _ in kept.since(240)] == [200, 300]
    assert [stamp for stamp, _ in kept.since(260)] == [300]
    assert [stamp for stamp, _ in kept.since(None)] == [300]
    assert FrameHistory(1, 1).since(5) == []


def test_selection_starts_on_its_own_frame():
    """The frame of the stamp first, then all that came later."""
    selector = Selector(history(stamps=[0, SECOND, 2 * SECOND]))
    selector.select(Selection(Box(1, 1, 9, 9), 'test', SECOND))
    selection, frames = selector.ready()
    assert [(stamp, int(pixels[0, 0])) for stamp, pixels in frames] == [
        (SECOND, 1), (2 * SECOND, 2)]
    assert selector.ready() is None


def test_selection_waits_for_its_frame():
    """A selection ahead of its image isn't ready before it."""
    kept = history(stamps=[SECOND])
    selector = Selector(kept)
    selector.select(Selection(Box(1, 1, 9, 9), 'test', 2 * SECOND))
    assert selector.ready() is None
    kept.append(2 * SECOND, frame(7))
    _, frames = selector.ready()
    assert int(frames[0][1][0, 0]) == 7


def test_selection_before_any_frame():
    """Before the first frame everything waits; one that never came is said to be missing."""
    kept = FrameHistory(2.0, 1.0)
    selector = Selector(kept)
    selector.select(Selection(Box(1, 1, 9, 9), 'test', 5 * SECOND))
    assert selector.ready() is None
    kept.append(5 * SECOND + TOLERANCE + 1, frame())
    with pytest.raises(ValueError, match='never received'):
        selector.ready()
    assert selector.pending is None


@pytest.mark.parametrize('stamp, words', [
    (1 * SECOND, 'too old'), (100 * SECOND, 'in the future')])
def test_selection_out_of_reach(stamp, words):
    """What can't be had is refused at once, and what was pending stays."""
    selector = Selector(history(stamps=[10 * SECOND, 11 * SECOND]))
    first = Selection(Box(1, 1, 9, 9), 'test')
    selector.select(first)
    with pytest.raises(ValueError, match=words):
        selector.select(Selection(Box(1, 1, 9, 9), 'test', stamp))
    assert selector.pending is first


def test_box_on_a_frame():
    """A region is clamped, a box isn't, and neither may lie outside."""
    picture = frame(side=50)
    assert Selection(Box(40, 40, 100, 100), 'a', clamp=True).box_on(picture) == Box(40, 40, 10, 10)
    assert Selection(Box(40, 40, 100, 100), 'a').box_on(picture) == Box(40, 40, 100, 100)
    with pytest.raises(ValueError, match='no pixel inside the image of 50 x 50'):
        Selection(Box(50, 0, 5, 5), 'a').box_on(picture)
