"""Statistics of the flow of frames, and the diagnostics that are made from them."""

import math

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.ros.diagnostics import percentiles, report, SEGMENT, state_status
from vtrack_ros.session.frame_flow import Arrival, FrameFlow, RECOVERY_COUNT
from vtrack_ros.tracker import Estimate, TrackState

STEP = 33_333_333
MS = 10**6


def feed(flow, indices, busy=5.0):
    """Let frames of these indices arrive on time."""
    for index in indices:
        flow.arrived(index * STEP, 1 + index * STEP)
        flow.processing.append(busy)
        flow.latency.append(busy + 1)


def judge(flow, now, faults=(), publishers=1):
    """Return level, message and values of the report on the last period."""
    return report(flow, now, faults, publishers, '/image')


def test_all_is_well():
    """Frames at 30 Hz without a gap give level OK, and none is missing."""
    flow = FrameFlow()
    feed(flow, range(31))
    level, text, values = judge(flow, 30 * STEP + 1)
    assert level == 0 and flow.missing == 0
    assert values['frames received'] == '31' and values['processing p50'] == '5.00 ms'
    assert abs(float(text.split()[0]) - 31) < 0.1


def test_missing_frames_are_counted_by_their_stamps():
    """The 16 frames that were left out count as missing; a warning advises the DDS profile."""
    flow = FrameFlow()
    feed(flow, [i for i in range(60) if i < 10 or i % 3])
    assert flow.missing == 16
    flow.largest = SEGMENT
    level, text, values = judge(flow, 60 * STEP)
    assert level == 1 and '16' in text and 'fastdds.xml' in text
    assert values['frames missing'] == '16'


def test_heavy_losses_are_seen_too():
    """If only one frame in four arrives, the number of missing ones is right to 5 %."""
    rng = np.random.default_rng(0)
    kept = [index for index in range(2000) if rng.random() < 0.25]
    flow = FrameFlow()
    feed(flow, kept)
    truly = kept[-1] - kept[0] + 1 - len(kept)
    assert abs(flow.missing - truly) < 0.05 * truly


def test_jitter_is_no_loss():
    """Jitter of 5 % of the interval (standard deviation) makes no frame count as missing."""
    rng = np.random.default_rng(0)
    flow = FrameFlow()
    for index in range(1000):
        flow.arrived(index * STEP + int(rng.normal(0, 0.05 * STEP)) + STEP, 1)
    assert flow.missing == 0


@pytest.mark.parametrize('milliseconds', [2, 5, 10])
def test_stamps_that_shake_lose_nothing(milliseconds):
    """With jitter of 2 to 10 ms at most 15 frames count as missing while 3000 arrive."""
    rng = np.random.default_rng(1)
    flow = FrameFlow()
    for index in range(3000):
        flow.arrived(10**9 + index * STEP + int(rng.normal(0, milliseconds * MS)), 1)
    assert flow.missing <= 15


def test_losses_are_counted_though_the_stamps_shake():
    """With every tenth frame missing and 2 ms of jitter, the 299 are counted to within 15."""
    rng = np.random.default_rng(1)
    flow = FrameFlow()
    for index in [i for i in range(3000) if i % 10]:
        flow.arrived(10**9 + index * STEP + int(rng.normal(0, 2 * MS)), 1)
    assert abs(flow.missing - 299) < 15


def test_small_images_do_not_want_more_shared_memory():
    """The DDS profile is only advised if images don't fit the default shared memory."""
    flow = FrameFlow()
    feed(flow, [i for i in range(60) if i < 10 or i % 3])
    flow.largest = 30_000
    _, text, _ = judge(flow, 60 * STEP)
    assert 'missing' in text and 'fastdds' not in text


def test_a_late_frame_begins_no_stream():
    """A stamp that steps back once (reordered frames, an NTP step) counts as a late frame."""
    flow = FrameFlow()
    for index in range(200):
        early = 75 * MS if index % 40 == 39 else 0
        arrival = flow.arrived(10**9 + index * STEP - early, 1)
        assert arrival is (Arrival.LATE if early else Arrival.NEXT)
    assert flow.late == 5


def test_a_stamp_left_out_begins_no_stream():
    """A zero among other stamps counts as late; the third in a row begins a stream."""
    flow = FrameFlow()
    stamps = [10**9, 2 * 10**9, 0, 3 * 10**9, 0, 0, 4 * 10**9, 0, 0, 0]
    assert [flow.arrived(stamp, 0).value for stamp in stamps] == [
        'next', 'next', 'late', 'next', 'late', 'late', 'next', 'late', 'late', 'beginning']
    assert flow.arrived(0, 0).value == 'next'
    assert flow.late == 5


def test_a_first_stamp_left_out_begins_no_stream():
    """Where the first frame has none, a later zero counts as late, too, and is no loop."""
    flow, now = FrameFlow(), 10**18
    found = [flow.arrived(now + index * STEP if index % 8 else 0, index * STEP)
             for index in range(40)]
    assert found[:4] == [Arrival.NEXT, Arrival.LATE, Arrival.LATE, Arrival.NEXT]
    assert all(one is (Arrival.NEXT if index % 8 else Arrival.LATE)
               for index, one in enumerate(found[4:], 4))


def test_a_stamp_of_the_far_future_is_but_a_wrong_one():
    """One frame an hour ahead is late; the third of such frames in a row is accepted."""
    flow, hour = FrameFlow(), 3600 * 10**9
    feed(flow, range(60))
    assert flow.arrived(60 * STEP + hour, 60 * STEP) is Arrival.LATE
    for index in range(61, 80):
        assert flow.arrived(index * STEP, index * STEP) is Arrival.NEXT
    forward = [flow.arrived(index * STEP + hour, index * STEP) for index in range(80, 90)]
    assert forward == [Arrival.LATE] * (RECOVERY_COUNT - 1) + [Arrival.NEXT] * 8
    assert flow.late == RECOVERY_COUNT and flow.missing == 1
    # After an hour without frames such a stamp is accepted at once.
    assert flow.arrived(100 * STEP + 2 * hour, 100 * STEP + hour) is Arrival.NEXT


def test_frames_that_wait_here_are_not_the_transports_loss():
    """Missing large images with a high latency: the network is busy; no profile is advised."""
    flow = FrameFlow()
    flow.largest = 10**6
    feed(flow, [index for index in range(60) if index % 5])
    flow.latency.extend([90.0] * 60)
    _, text, _ = judge(flow, 60 * STEP)
    assert 'missing' in text and 'network is busy' in text and 'fastdds' not in text


def test_a_clock_that_was_set_back_is_no_loop():
    """The third frame in a row that is stamped before the newest one is a RESET, not LATE."""
    flow = FrameFlow()
    feed(flow, range(300))
    back = [flow.arrived((299 - 10 + index) * STEP, 1) for index in range(RECOVERY_COUNT)]
    assert back == [Arrival.LATE] * (RECOVERY_COUNT - 1) + [Arrival.RESET]
    # Set back by seconds: at once. To the stream's first stamp: the stream begins again.
    assert flow.arrived(200 * STEP, 1) is Arrival.RESET
    assert flow.arrived(0, 1) is Arrival.BEGINNING
    for index in range(1, 20):
        assert flow.arrived(index * STEP, 1) is Arrival.NEXT
    # Even if the stream was short.
    assert flow.arrived(0, 1) is Arrival.BEGINNING


def test_a_slow_tracker_is_told_from_a_lossy_network():
    """When processing takes longer than the frame interval, a faster tracker is advised."""
    flow = FrameFlow()
    feed(flow, [i for i in range(60) if i < 10 or i % 3], busy=60.0)
    level, text, _ = judge(flow, 60 * STEP)
    assert level == 1 and 'faster tracker' in text


def test_a_pause_is_no_loss():
    """A long gap, or a stream that begins again, makes no frame count as missing."""
    flow = FrameFlow()
    feed(flow, [*range(10), *range(1000, 1010)])
    assert flow.missing == 0
    assert flow.arrived(0, 1020 * STEP) is Arrival.BEGINNING
    assert flow.arrived(0, 1021 * STEP) is Arrival.NEXT
    assert flow.missing == 0


def test_silence():
    """Without images the warning is: no publisher, no image yet, or no image for some time."""
    flow = FrameFlow()
    assert judge(flow, 5, publishers=0)[:2] == (1, 'no node publishes /image')
    assert judge(flow, 6)[:2] == (1, 'no image on /image yet')
    feed(flow, range(3))
    judge(flow, 3 * STEP)
    level, text, _ = judge(flow, 3 * STEP + 4 * 10**9)
    assert level == 1 and text == 'no image on /image for 4 s'


def test_malformed_images_and_mismatches_come_first():
    """A QoS mismatch is the message before all else; malformed images come next."""
    flow = FrameFlow()
    feed(flow, range(10))
    for index in range(10, 13):
        flow.count_malformed(index * STEP, 1 + index * STEP, 'too short')
    level, text, _ = judge(flow, 13 * STEP)
    assert level == 1 and text == '3 of the last 13 images were malformed: too short'
    feed(flow, range(13, 20))
    assert judge(flow, 20 * STEP, faults=['QoS mismatch'])[:2] == (2, 'QoS mismatch')


def test_malformed_images_are_not_missing():
    """They came; only those that never came are counted as missing."""
    flow = FrameFlow()
    feed(flow, range(10))
    for index in range(10, 60):
        if index % 5 == 0:
            flow.count_malformed(index * STEP, 1 + index * STEP, 'too short')
        elif index % 5 != 1:
            feed(flow, [index])
    assert (flow.received, flow.malformed, flow.missing) == (40, 10, 10)


def test_stamps_of_malformed_images_are_not_believed():
    """The stamps of malformed images don't begin another stream."""
    flow = FrameFlow()
    feed(flow, range(10))
    for stamp in (0, 10**18, 5):
        flow.count_malformed(stamp, 1 + 10 * STEP, 'unknown encoding')
        feed(flow, [10 + stamp % 7])
    assert flow.arrived(30 * STEP, 30 * STEP) is Arrival.NEXT


def test_malformed_images_alone_are_no_silence():
    """If all images are malformed, that is reported, not silence."""
    flow = FrameFlow()
    for index in range(5):
        flow.count_malformed(index * STEP, 1 + index * STEP, 'too short')
    level, text, _ = judge(flow, 5 * STEP)
    assert level == 1 and text == '5 of the last 5 images were malformed: too short'
    assert flow.silence(5 * STEP) < 1 and flow.age(5 * STEP) == math.inf


def test_an_interruption_is_no_loss():
    """Frames sent during an interruption aren't missing; going backwards is still noticed."""
    flow = FrameFlow()
    feed(flow, range(10))
    judge(flow, 10 * STEP)
    flow.interrupt()
    feed(flow, range(25, 35))
    assert flow.missing == 0
    # The rate is that of the frames since then.
    assert float(judge(flow, 34 * STEP + 1)[1].split()[0]) > 29
    flow.interrupt()
    assert flow.arrived(-60 * STEP, 40 * STEP) is Arrival.BEGINNING


def test_percentiles():
    """They equal NumPy's; of an empty list they are NaN."""
    values = list(np.random.default_rng(0).exponential(1, 500))
    assert percentiles(values) == (np.percentile(values, 50), np.percentile(values, 99))
    assert all(math.isnan(value) for value in percentiles([]))


def estimate(state):
    """Return an estimate."""
    return Estimate(Box(10, 20, 30, 40), 0.0, np.eye(4), 0.75, state)


@pytest.mark.parametrize('name, state, level', [
    ('stale', TrackState.TRACKING, DiagnosticStatus.WARN),
    ('stale', TrackState.LOST, DiagnosticStatus.ERROR),
    ('paused', TrackState.TRACKING, DiagnosticStatus.OK),
    ('inactive', TrackState.LOST, DiagnosticStatus.OK)])
def test_stale_state(name, state, level):
    """A stale state is a warning at least, but paused and inactive ones are OK."""
    status = state_status('/tracker', 'gmpf', name, estimate(state), {}, stale=True)
    assert (status.message, status.level) == (name, level)
    assert {row.key: row.value for row in status.values}['box'] == 'stale'


@pytest.mark.parametrize('state, level', [
    (TrackState.TRACKING, DiagnosticStatus.OK), (TrackState.SEARCHING, DiagnosticStatus.WARN),
    (TrackState.LOST, DiagnosticStatus.ERROR)])
def test_state(state, level):
    """The level says how bad it is, and the values whether the box was measured."""
    status = state_status('/tracker', 'gmpf', state.value, estimate(state), {'a': 'b'})
    values = {row.key: row.value for row in status.values}
    assert status.level == level and status.message == state.value
    assert status.name == '/tracker: target' and status.hardware_id == 'gmpf'
    assert values['box'] == ('measured' if state is TrackState.TRACKING else 'predicted')
    assert values['confidence'] == '0.750' and values['a'] == 'b'
