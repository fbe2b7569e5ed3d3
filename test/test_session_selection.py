"""Selections and the frames they were drawn on."""

import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.session.history import FrameHistory
from vtrack_ros.session.selection import LEAST_SIDE, Selection, Selector

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
    """Frames older than the bound are dropped."""
    kept = history(seconds=1.0, stamps=[i * SECOND // 4 for i in range(20)])
    assert (kept.oldest, kept.newest) == (15 * SECOND // 4, 19 * SECOND // 4)
    assert len(kept) == 5


def test_history_is_bounded_in_memory():
    """However many frames come, they take at most `megabytes`."""
    kept = FrameHistory(30.0, 0.1)
    for index in range(1000):
        kept.append(index, frame(side=100))
        assert kept.nbytes <= 100_000
    assert len(kept) == 10
    # The newest frame is kept, whatever its size.
    kept.append(2000, frame(side=1000))
    assert len(kept) == 1 and kept.newest == 2000


def test_history_clears_when_stamps_go_backwards():
    """A stamp that goes backwards clears all frames before it."""
    kept = history(stamps=[10, 20, 30])
    kept.append(5, frame(9))
    assert len(kept) == 1 and kept.nbytes == 10_000


def test_history_clears_when_the_shape_changes():
    """A frame of another size or number of channels clears all frames before it."""
    for other in (frame(side=50), np.zeros((100, 100, 3), np.uint8)):
        kept = history(stamps=[10, 20, 30])
        kept.append(40, other)
        assert (kept.oldest, kept.newest, kept.nbytes) == (40, 40, other.nbytes)


def test_since_takes_the_nearest():
    """`since` begins with the frame nearest to the stamp; None gives the newest one alone."""
    kept = history(stamps=[100, 200, 300])
    assert [stamp for stamp, _ in kept.since(240)] == [200, 300]
    assert [stamp for stamp, _ in kept.since(260)] == [300]
    assert [stamp for stamp, _ in kept.since(None)] == [300]
    assert FrameHistory(1, 1).since(5) == []


def test_selection_starts_on_its_own_frame():
    """It gives the frame of its stamp first, then all later ones."""
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
    """Before the first frame a selection waits; if its own frame isn't there it's refused."""
    kept = FrameHistory(2.0, 1.0)
    selector = Selector(kept)
    selector.select(Selection(Box(1, 1, 9, 9), 'test', 5 * SECOND))
    assert selector.ready() is None
    kept.append(5 * SECOND + SECOND // 2, frame())
    with pytest.raises(ValueError, match='no frame of its stamp 5.000000000 s'):
        selector.ready()
    assert selector.pending is None


def test_selection_that_is_too_old():
    """A selection that is too old is refused at once, and the pending one is kept."""
    selector = Selector(history(stamps=[10 * SECOND, 11 * SECOND]))
    first = Selection(Box(1, 1, 9, 9), 'test')
    selector.select(first)
    with pytest.raises(ValueError, match='too old'):
        selector.select(Selection(Box(1, 1, 9, 9), 'test', 1 * SECOND))
    assert selector.pending is first


@pytest.mark.parametrize('stamps', [[], [10 * SECOND, 11 * SECOND]])
def test_selection_in_the_future(stamps):
    """A stamp of another clock is refused with the next frame, whatever came before it."""
    kept = history(stamps=stamps)
    selector = Selector(kept)
    selector.select(Selection(Box(1, 1, 9, 9), 'test', 10**18))
    kept.append(12 * SECOND, frame())
    with pytest.raises(ValueError, match='in the future'):
        selector.ready()
    assert selector.pending is None and selector.ready() is None


def test_selection_after_a_pause():
    """A selection after a pause isn't compared with the stamps of frames from before it."""
    kept = history(stamps=[10 * SECOND, 10 * SECOND + SECOND // 10])
    selector = Selector(kept)
    selector.select(Selection(Box(1, 1, 9, 9), 'test', 60 * SECOND))
    kept.append(60 * SECOND, frame(7))
    _, frames = selector.ready()
    assert [(stamp, int(pixels[0, 0])) for stamp, pixels in frames] == [(60 * SECOND, 7)]


@pytest.mark.parametrize('seconds, megabytes, parameter', [
    (2.0, 0.05, 'history_megabytes'), (0.15, 1.0, 'history_seconds')])
def test_selection_never_starts_on_other_pixels(seconds, megabytes, parameter):
    """A selection on a dropped frame is refused, and the parameter that keeps more is named."""
    stamps = [10 * SECOND + i * SECOND // 30 for i in range(20)]
    selector = Selector(history(seconds, megabytes, stamps))
    refused = f'too old: frames are kept from 10.*; raise {parameter} '
    with pytest.raises(ValueError, match=refused):
        selector.select(Selection(Box(1, 1, 9, 9), 'test', stamps[8]))
    # A frame that may have been lost in transport is replaced by its neighbour.
    selector.select(Selection(Box(1, 1, 9, 9), 'test', stamps[17] + SECOND // 60))
    _, frames = selector.ready()
    assert frames[0][0] in stamps[17:19]


def test_selection_on_a_frame_that_was_lost():
    """A selection in the middle of a gap is refused, and the nearest frame is named."""
    stamps = [i * SECOND // 30 for i in [*range(10), *range(16, 20)]]
    selector = Selector(history(stamps=stamps))
    selector.select(Selection(Box(1, 1, 9, 9), 'test', 13 * SECOND // 30))
    with pytest.raises(ValueError, match='there is no frame of its stamp'):
        selector.ready()


def test_box_on_a_frame():
    """A region is clamped, a box may reach beyond the image."""
    picture = frame(side=50)
    assert Selection(Box(40, 40, 100, 100), 'a', clamp=True).box_on(picture) == Box(40, 40, 10, 10)
    assert Selection(Box(40, 40, 18, 18), 'a').box_on(picture) == Box(40, 40, 18, 18)
    least = Box(0, 0, LEAST_SIDE, LEAST_SIDE)
    assert Selection(least, 'a').box_on(picture) == least


@pytest.mark.parametrize('box, clamp, words', [
    (Box(50, 0, 5, 5), False, 'no pixel inside the image of 50 x 50'),
    (Box(50, 0, 5, 5), True, 'no pixel inside the image of 50 x 50'),
    (Box(40, 40, 100, 100), False, r'centre \(90, 90\) outside the image of 50 x 50'),
    (Box(-30, 10, 40, 10), False, r'centre \(-10, 15\) outside'),
    (Box(20, 20, 0.2, 20), False, 'at least 2 px'),
    (Box(20, 20, 20, 1.9), False, 'at least 2 px'),
    (Box(49, 20, 20, 20), True, 'at least 2 px'),
    (Box(-1e300, 20, 2e300, 20), False, 'at most 1000000 px'),
    (Box(20, -1e7, 20, 2e7), False, 'at most 1000000 px')])
def test_box_that_cannot_be_followed(box, clamp, words):
    """A box outside the image, too small or too large is refused with what's valid."""
    with pytest.raises(ValueError, match=words):
        Selection(box, 'a', clamp=clamp).box_on(frame(side=50))
