"""A target without ROS: selections, streams, and faults of the tracker."""

import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.session.exemplar import Exemplar
from vtrack_ros.session.history import FrameHistory
from vtrack_ros.session.last_measurement import LastMeasurement
from vtrack_ros.session.selection import Selection
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.session.target import Target
from vtrack_ros.tracker import Estimate, TrackState

STEP = 33_333_333


class Lines:
    """A log that keeps its lines."""

    def __init__(self):
        self.said = []

    def info(self, text):
        """Keep a line."""
        self.said.append(text)

    warning = error = repeated_error = info


class Scripted:
    """A mock tracker that returns, or raises, what is in `states`."""

    states: list = []
    parameters: dict = {}

    def __init__(self):
        self.started = []
        self.updates = 0

    def start(self, frame, box):
        """Begin."""
        self.started.append((int(frame.flat[0]), box))
        return Estimate(box, 0.0, np.eye(4), 1.0, TrackState.TRACKING)

    def update(self, frame, dt=1.0):
        """Return the next state, or raise it."""
        self.updates += 1
        state = self.states.pop(0) if self.states else TrackState.TRACKING
        if isinstance(state, Exception):
            raise state
        return Estimate(Box(10, 10, 20, 20), 0.0, np.eye(4), 1.0, state)


@pytest.fixture
def scripted(monkeypatch):
    """Replace every tracker by the mock; return a list of those that were made."""
    made = []

    def create(*_, **__):
        made.append(Scripted())
        return made[-1]
    monkeypatch.setattr('vtrack_ros.session.session.create_tracker', create)
    monkeypatch.setattr(Scripted, 'states', [])
    return made


class Following:
    """A target with its log and its frame history."""

    def __init__(self, box=None, history=None):
        self.log = Lines()
        self.history = history or FrameHistory(2.0, 16.0)
        self.session = TrackingSession()
        self.target = Target(self.session, self.history, self.log)
        self.target.set_init_box(box, 'parameter init_box')

    def update(self, frame, stamp):
        """Take a frame as the node does."""
        self.history.append(stamp, frame)
        return self.target.update(frame, stamp)


def frame(value=0):
    """Return a grey picture."""
    return np.full((100, 100), value, np.uint8)


def selection(x=50.0, class_id='ball', stamp=None):
    """Return a selection by a box."""
    return Selection(Box(x - 10, 40, 20, 20), '~/init', stamp, class_id=class_id)


def test_detector_is_wanted_while_there_is_no_target_or_it_is_lost(scripted):
    """It's wanted without a target or after LOST, not while tracking or searching."""
    follow = Following()
    Scripted.states = [TrackState.TRACKING, TrackState.SEARCHING, TrackState.LOST]
    assert follow.target.wanted
    follow.target.select(selection(40.0))
    assert not follow.target.wanted
    assert follow.update(frame(), 0).box.center == (40.0, 50.0)
    for index in (1, 2):
        assert not follow.target.wanted
        follow.update(frame(), index * STEP)
    assert follow.update(frame(), 3 * STEP).state is TrackState.LOST
    assert follow.target.wanted
    follow.target.select(selection(70.0))
    assert follow.update(frame(), 4 * STEP).box.center == (70.0, 50.0)
    assert follow.target.identity[0] == 'ball'


def test_a_stamped_selection_starts_on_its_frame(scripted):
    """It starts on the frame that it was made on, and catches up."""
    follow = Following()
    for index in range(5):
        follow.update(frame(index), 10**9 + index * STEP)
    follow.target.select(selection(stamp=10**9 + 2 * STEP))
    follow.update(frame(5), 10**9 + 5 * STEP)
    tracker = scripted[-1]
    assert tracker.started == [(2, Box(40, 40, 20, 20))]
    assert tracker.updates == 3


def test_two_targets_of_one_history(scripted):
    """Two targets with sessions of their own share frames; each starts on its own selection's."""
    one = Following()
    other = Target(TrackingSession(), one.history, Lines())
    for index in range(3):
        one.update(frame(index), 10**9 + index * STEP)
        other.update(frame(index), 10**9 + index * STEP)
    one.target.select(selection(30.0, stamp=10**9))
    other.select(selection(60.0, stamp=10**9 + STEP))
    one.update(frame(3), 10**9 + 3 * STEP)
    other.update(frame(3), 10**9 + 3 * STEP)
    started = [tracker.started for tracker in scripted if tracker.started]
    assert started == [[(0, Box(20, 40, 20, 20))], [(1, Box(50, 40, 20, 20))]]


def test_a_fault_of_the_tracker_forgets_the_target_and_no_more(scripted):
    """The tracker's error is logged, and the next selection is tracked."""
    follow = Following(Box(10, 10, 20, 20))
    assert follow.update(frame(), 0) is not None
    Scripted.states = [np.linalg.LinAlgError('singular')]
    assert follow.update(frame(), STEP) is None
    assert 'LinAlgError: singular' in follow.log.said[-1] and follow.target.state_name == 'waiting'
    follow.target.select(selection())
    assert follow.update(frame(), 2 * STEP) is not None


@pytest.mark.parametrize('ask', [
    lambda session: session.change('dcf'), lambda session: session.restart()])
def test_a_fault_of_a_new_tracker_is_not_raised(scripted, ask):
    """A tracker that fails where it takes over gives up the target, and says why."""
    follow = Following(Box(10, 10, 20, 20))
    Scripted.states = [TrackState.SEARCHING, IndexError('far out')]
    for index in range(2):
        follow.update(frame(), index * STEP)
    session = follow.session
    ask(session)
    assert session.estimate is None and session.failure == 'IndexError: far out'
    follow.target.select(selection())
    assert follow.update(frame(), 2 * STEP) is not None
    assert session.restart() is not None and not session.failure


@pytest.mark.parametrize('ask', [
    lambda session: session.restart(), lambda session: session.resize(False),
    lambda session: session.change('dcf')])
def test_a_tracker_that_cannot_be_made_again(scripted, monkeypatch, ask):
    """Any error of it, as of a file that is gone, is a ValueError, and the target is kept."""
    def fail(*_, **__):
        raise FileNotFoundError('model.onnx')
    follow = Following(Box(10, 10, 80, 80))
    follow.update(frame(), 0)
    session = follow.session
    seen = session.last_measurement
    monkeypatch.setattr('vtrack_ros.session.session.create_tracker', fail)
    with pytest.raises(ValueError, match='FileNotFoundError: model.onnx'):
        ask(session)
    assert session.last_measurement is seen and session.tracker == 'gmpf'
    assert session.update(frame(), STEP).measured


def test_without_a_target_no_tracker_is_made(scripted):
    """A restart without a target makes no tracker, which could fail."""
    session = TrackingSession()
    count = len(scripted)
    assert session.restart() is None and len(scripted) == count


def test_a_fault_of_a_tracker_that_takes_up_a_saved_target(scripted):
    """It's a ValueError, as of a saved target that can't be used; there is no target then."""
    session, box = TrackingSession(), Box(10, 10, 20, 20)
    Scripted.states = [IndexError('far out')]
    with pytest.raises(ValueError, match='IndexError: far out'):
        session.take_up(LastMeasurement(frame(), 0, box), 0, Exemplar.of(frame(), box))
    assert session.estimate is None


@pytest.mark.parametrize('ask', [
    lambda session: session.resize(True), lambda session: session.change(seed=1)])
def test_an_earlier_fault_is_not_told_again(scripted, ask):
    """Where there's no target to resize, or no tracker takes over, no tracker failed."""
    follow = Following(Box(10, 10, 20, 20))
    Scripted.states = [TrackState.SEARCHING, IndexError('far out')]
    for index in range(2):
        follow.update(frame(), index * STEP)
    session = follow.session
    assert session.restart() is None and session.failure == 'IndexError: far out'
    assert ask(session) is None and not session.failure


def test_init_box_counts_at_the_beginning_of_a_stream(scripted):
    """It's selected once per stream, and again in the next one, unless told otherwise."""
    follow = Following(Box(10, 10, 20, 20))
    assert follow.update(frame(), 100) is not None
    follow.target.forget()
    assert follow.update(frame(), 200) is None
    follow.history.clear()
    follow.target.begin_stream(from_init_box=False)
    assert follow.update(frame(), 50) is None
    follow.target.begin_stream()
    assert follow.update(frame(), 60) is not None


def test_every_target_has_its_own_name(scripted):
    """Unless a selection has an id, the target's id is a running number."""
    follow = Following(Box(10, 10, 20, 20))
    follow.update(frame(), 0)
    assert follow.target.identity == ('target', '1')
    follow.target.select(selection(class_id='cup'))
    follow.update(frame(), STEP)
    assert follow.target.identity == ('cup', '2')


def test_nothing_is_left_of_another_stream(scripted):
    """A pending selection on one of its frames is dropped when another begins; the log says so."""
    follow = Following()
    follow.update(frame(), 10**9)
    follow.target.select(selection(stamp=2 * 10**9))
    follow.target.begin_stream()
    assert '~/init refused' in follow.log.said[-1] and '2.000000000 s' in follow.log.said[-1]
    assert follow.update(frame(), 2 * 10**9) is None


@pytest.mark.parametrize('from_init_box', [True, False])
def test_a_selection_for_the_next_frame_may_be_for_a_new_stream(scripted, from_init_box):
    """One made while the camera was off isn't lost, and takes precedence over init_box."""
    follow = Following(Box(10, 10, 20, 20))
    follow.update(frame(), 10**9)
    follow.target.select(selection(30.0))
    follow.history.clear()
    follow.target.begin_stream(from_init_box)
    assert follow.update(frame(), 0).box.center == (30.0, 50.0)


def test_a_detection_of_another_stream_is_dropped(scripted):
    """Without a stamp it's for the next frame, too; but the detector will see the new stream."""
    follow = Following()
    follow.update(frame(), 10**9)
    follow.target.select(Selection(Box(30, 30, 9, 9), '~/init_detections', automatic=True))
    follow.target.begin_stream()
    assert not follow.log.said and follow.update(frame(), 0) is None


@pytest.mark.parametrize('picture, words', [
    (np.zeros((80, 90), np.uint8), 'the image size changed from 100 x 100 to 90 x 80'),
    (np.zeros((100, 100, 3), np.uint8), 'the images changed from grey to colour')])
def test_frames_of_another_shape_forget_the_target(scripted, picture, words):
    """The log says what has changed, and the next selection is tracked in the new frames."""
    follow = Following(Box(10, 10, 20, 20))
    assert follow.update(frame(), 0) is not None
    assert follow.update(picture, STEP) is None
    assert follow.log.said[-1] == f'{words}: the target is forgotten'
    follow.target.select(selection())
    assert follow.update(picture, 2 * STEP) is not None


def test_selection_on_a_frame_of_another_shape(scripted):
    """It's refused as too old, for frames of another shape are dropped, and nothing starts."""
    follow = Following()
    follow.update(np.zeros((80, 90), np.uint8), 10**9)
    follow.update(frame(), 10**9 + STEP)
    follow.update(frame(), 10**9 + 2 * STEP)
    with pytest.raises(ValueError, match='too old: frames are kept from 1.0333'):
        follow.target.select(selection(stamp=10**9 - STEP))
    assert follow.update(frame(), 10**9 + 3 * STEP) is None


def test_selection_of_the_future_does_not_shut_the_detector_out(scripted):
    """A selection stamped far ahead, before the first frame, is refused when that comes."""
    follow = Following()
    follow.target.select(selection(stamp=10**18))
    assert follow.update(frame(), 0) is None
    assert 'in the future' in follow.log.said[-1]
    assert follow.target.wanted
    follow.target.select(selection())
    assert follow.update(frame(), STEP) is not None
