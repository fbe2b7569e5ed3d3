"""The target without ROS around it: who may select it, when, and what a fault does."""

from types import SimpleNamespace as Message

import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.ros.parameters import checked_settings, parameter_table
from vtrack_ros.ros.target import Target
from vtrack_ros.trackers import Estimate, TrackState

STEP = 33_333_333


class Lines:
    """A log that remembers."""

    def __init__(self):
        self.said = []

    def info(self, text):
        """Remember."""
        self.said.append(text)

    warning = error = info


class Scripted:
    """A tracker that says what it's told to."""

    states: list = []

    def __init__(self):
        self.started = []
        self.updates = 0

    def start(self, frame, box):
        """Begin."""
        self.started.append((int(frame.flat[0]), box))
        return Estimate(box, 0.0, np.eye(4), 1.0, TrackState.TRACKING)

    def update(self, frame, dt=1.0):
        """Say the next state, or raise it."""
        self.updates += 1
        state = self.states.pop(0) if self.states else TrackState.TRACKING
        if isinstance(state, Exception):
            raise state
        return Estimate(Box(10, 10, 20, 20), 0.0, np.eye(4), 1.0, state)


@pytest.fixture
def scripted(monkeypatch):
    """Let every tracker be the scripted one; returns those that were made."""
    made = []

    def create(*_, **__):
        made.append(Scripted())
        return made[-1]
    monkeypatch.setattr('vtrack_ros.session.session.create_tracker', create)
    monkeypatch.setattr('vtrack_ros.ros.target.create_tracker', create)
    monkeypatch.setattr(Scripted, 'states', [])
    return made


def target(**changes):
    """Return a target with default settings but for some, and its log."""
    values = {name: row.default for name, row in parameter_table().items()}
    log = Lines()
    return Target(checked_settings({**values, **changes}), log), log


def frame(value=0):
    """Return a grey picture."""
    return np.full((100, 100), value, np.uint8)


def detection(x=50.0, score=0.9, class_id='ball', stamp=0):
    """Return what a detector found, with the fields of vision_msgs/msg/Detection2D."""
    time = Message(sec=stamp // 10**9, nanosec=stamp % 10**9)
    return Message(
        header=Message(stamp=time), id='',
        bbox=Message(center=Message(position=Message(x=x, y=50.0), theta=0.0),
                     size_x=20.0, size_y=20.0),
        results=[Message(hypothesis=Message(class_id=class_id, score=score))])


def detections(*rows, stamp=0):
    """Return several of them."""
    time = Message(sec=stamp // 10**9, nanosec=stamp % 10**9)
    return Message(header=Message(stamp=time), detections=list(rows))


def test_detector_is_asked_while_there_is_no_target_or_it_is_lost(scripted):
    """While tracking and while searching it isn't; after it was lost it is again."""
    follow, _ = target(init_class='ball')
    Scripted.states = [TrackState.TRACKING, TrackState.SEARCHING, TrackState.LOST]
    follow.on_detections(detections(detection(40.0)))
    assert follow.update(frame(), 0).box.center == (40.0, 50.0)
    for index in (1, 2):
        follow.on_detections(detections(detection(60.0)))
        follow.update(frame(), index * STEP)
        assert follow.estimate.box.center == (20.0, 20.0)
    assert follow.update(frame(), 3 * STEP).state is TrackState.LOST
    follow.on_detections(detections(detection(60.0), detection(70.0, 0.95), detection(80.0, 0.1)))
    assert follow.update(frame(), 4 * STEP).box.center == (70.0, 50.0)
    assert follow.identity[0] == 'ball'


def test_detections_have_the_stamp_of_their_array(scripted):
    """A detector's box starts on the frame that the detector saw, and catches up."""
    follow, _ = target()
    for index in range(5):
        follow.update(frame(index), 10**9 + index * STEP)
    follow.on_detections(detections(detection(), stamp=10**9 + 2 * STEP))
    follow.update(frame(5), 10**9 + 5 * STEP)
    tracker = scripted[-1]
    assert tracker.started == [(2, Box(40, 40, 20, 20))]
    assert tracker.updates == 3


def test_a_fault_of_the_tracker_forgets_the_target_and_no_more(scripted):
    """Whatever it raises is said, and the next selection is followed."""
    follow, log = target(init_box=[10, 10, 20, 20])
    assert follow.update(frame(), 0) is not None
    Scripted.states = [np.linalg.LinAlgError('singular')]
    assert follow.update(frame(), STEP) is None
    assert 'LinAlgError: singular' in log.said[-1] and follow.word == 'waiting'
    follow.on_detection(detection())
    assert follow.update(frame(), 2 * STEP) is not None


def test_init_box_counts_at_the_beginning_of_a_stream(scripted):
    """It's used once a stream, and again in the next."""
    follow, _ = target(init_box=[10, 10, 20, 20])
    assert follow.update(frame(), 100) is not None
    follow.forget()
    assert follow.update(frame(), 200) is None
    follow.begin_stream()
    assert follow.update(frame(), 0) is not None


def test_every_target_has_its_own_name(scripted):
    """Unless it was given one, a target is counted."""
    follow, _ = target(init_box=[10, 10, 20, 20])
    follow.update(frame(), 0)
    assert follow.identity == ('target', '1')
    follow.on_detection(detection(class_id='cup'))
    follow.update(frame(), STEP)
    assert follow.identity == ('cup', '2')


def test_nothing_is_left_of_another_stream(scripted):
    """A selection that waits for its frame doesn't wait into the next stream."""
    follow, _ = target()
    follow.update(frame(), 10**9)
    follow.on_detection(detection(stamp=2 * 10**9))
    follow.begin_stream()
    assert follow.update(frame(), 2 * 10**9) is None


def test_the_warm_up_is_no_target(scripted):
    """What was loaded at the start leaves no trace."""
    follow, log = target()
    assert follow.word == 'waiting' and follow.estimate is None and log.said == []


@pytest.mark.parametrize('picture, words', [
    (np.zeros((80, 90), np.uint8), 'the image size changed from 100 x 100 to 90 x 80'),
    (np.zeros((100, 100, 3), np.uint8), 'the images changed from grey to colour')])
def test_frames_of_another_shape_forget_the_target(scripted, picture, words):
    """The log says what is different, and the new frames are as good as the old ones."""
    follow, log = target(init_box=[10, 10, 20, 20])
    assert follow.update(frame(), 0) is not None
    assert follow.update(picture, STEP) is None
    assert log.said[-1] == f'{words}: the target is forgotten'
    follow.on_detection(detection())
    assert follow.update(picture, 2 * STEP) is not None


def test_selection_on_a_frame_of_another_shape(scripted):
    """Nobody can catch up from it: it's refused, and no start is told of that wasn't one."""
    follow, log = target()
    follow.update(np.zeros((80, 90), np.uint8), 10**9)
    follow.update(frame(), 10**9 + STEP)
    follow.update(frame(), 10**9 + 2 * STEP)
    follow.on_detection(detection(stamp=10**9 - STEP))
    assert follow.update(frame(), 10**9 + 3 * STEP) is None
    assert not any('started' in line for line in log.said)
    assert 'too old: frames are kept from 1.0333' in log.said[-1]


def test_selection_of_the_future_does_not_shut_the_detector_out(scripted):
    """One that came before the first frame, with a stamp of another clock, is refused by it."""
    follow, log = target()
    follow.on_detection(detection(stamp=10**18))
    assert follow.update(frame(), 0) is None
    assert 'in the future' in log.said[-1]
    follow.on_detections(detections(detection()))
    assert follow.update(frame(), STEP) is not None
