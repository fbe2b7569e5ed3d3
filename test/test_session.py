"""The tracking session: changes of stream, tracker, parameters and seed; restarts."""

from drawn_card import DrawnCard
from drawn_ellipse import ellipse
import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.session.frame_interval import FrameIntervalEstimator
from vtrack_ros.session.frame_interval import LONGEST_STEP
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import create_tracker, Estimate, tracker_names, TrackState

STEP = 33_333_333


def frame(index=0, height=90, width=120):
    """Return a picture with a bright textured square that moves to the right."""
    rng = np.random.default_rng(1)
    picture = rng.integers(60, 90, (height, width, 3), np.uint8)
    x = int(box(index).x)
    picture[30:54, x:x + 24] = np.kron(rng.integers(0, 2, (4, 4)), np.ones((6, 6), int))[
        ..., None] * np.array([20, 40, 190]) + 30
    return picture


def box(index=0):
    """Return the square's box."""
    return Box(20 + 2 * index, 30, 24, 24)


class Script:
    """A mock tracker that returns scripted states, one per update, and records the time steps."""

    def __init__(self, states):
        self.states = list(states)
        self.steps = []

    def start(self, frame, box):
        """Begin."""
        return Estimate(box, 0.0, np.eye(4), 1.0, TrackState.TRACKING)

    def update(self, frame, dt):
        """Return a fixed box with the next state."""
        self.steps.append(dt)
        state = self.states.pop(0) if self.states else TrackState.TRACKING
        return Estimate(Box(50, 30, 24, 24), 0.0, np.eye(4), 1.0, state)


@pytest.mark.parametrize('wrong', [
    None, [[1, 2], [3, 4]], frame().astype(float), np.dstack([frame(), frame()[:, :, 0]])])
def test_a_frame_that_is_none_is_refused_and_the_target_kept(wrong):
    """Before, one with an alpha channel silently ended the tracking, as another size does."""
    session = TrackingSession('dcf')
    session.start(frame(), 0, box())
    with pytest.raises((TypeError, ValueError), match='frame must'):
        session.update(wrong, STEP)
    assert session.update(frame(1), STEP).box.iou(box(1)) > 0.6


def test_cadence_counts_frame_intervals():
    """A gap of two intervals is two steps; jitter and gaps don't change the interval."""
    estimator = FrameIntervalEstimator()
    assert [estimator.steps(100 + jitter) for jitter in (0, 5, -5, 2)] == [1, 1, 1, 1]
    assert estimator.steps(201) == 2
    assert estimator.steps(99) == 1
    assert estimator.steps(510) == 5


def test_a_long_first_interval_is_not_the_usual_one():
    """After a gap right behind the start, as while topics are discovered, each frame is one."""
    estimator = FrameIntervalEstimator()
    assert [estimator.steps(interval * 10**6) for interval in (2000, 33, 33, 34)][1:] == [1, 1, 1]


def test_a_slow_cameras_interval_is_more_than_one():
    """At ten frames a second one is two and a half intervals of 40 ms, and a lost one as many."""
    estimator = FrameIntervalEstimator()
    steps = [estimator.steps(interval * 10**6) for interval in (100, 101, 99, 200, 100)]
    assert steps == pytest.approx([2.5, 2.5, 2.5, 5, 2.5], rel=0.02)


@pytest.mark.parametrize('interval', [33_333_333, 40_000_000])
def test_a_frame_of_an_ordinary_camera_is_one_step(interval):
    estimator = FrameIntervalEstimator()
    assert [estimator.steps(interval) for _ in range(5)] == 5 * [1.0]


def test_no_target_no_estimate():
    """Before a start there is no estimate, no measurement and no restart."""
    session = TrackingSession()
    assert session.update(frame(), 5) is None
    assert session.estimate is None and session.last_measurement is None
    assert session.restart() is None


@pytest.mark.parametrize('tracker', tracker_names(replicas=False))
def test_same_seed_same_boxes(tracker):
    """Two sessions of the same seed give the same boxes, bit for bit."""
    runs = []
    for _ in range(2):
        session = TrackingSession(tracker, seed=3)
        session.start(frame(0), 0, box(0))
        runs.append([session.update(frame(i), i * STEP).box for i in range(1, 6)])
    assert runs[0] == runs[1]


def test_backwards_ends_it():
    """A stamp before the last one ends the tracking."""
    session = TrackingSession()
    session.start(frame(0), 1000, box(0))
    assert session.update(frame(1), 2000) is not None
    assert session.update(frame(2), 1999) is None
    assert session.estimate is None
    assert session.update(frame(3), 3000) is None


def test_another_size_ends_it():
    """A frame of another size or number of channels ends the tracking."""
    for other in (frame(1, height=80), np.ascontiguousarray(frame(1)[..., 0])):
        session = TrackingSession()
        session.start(frame(0), 0, box(0))
        assert session.update(other, STEP) is None
        assert session.estimate is None


def test_steps_in_frame_intervals(monkeypatch):
    """Dropped frames give longer steps, up to LONGEST_STEP; an equal stamp is one step."""
    script = Script([])
    monkeypatch.setattr('vtrack_ros.session.session.create_tracker', lambda *a, **k: script)
    session = TrackingSession()
    session.start(frame(), 0, box())
    for stamp in (1, 2, 3, 4, 4, 6, 10**6):
        assert session.update(frame(), stamp * STEP) is not None
    assert script.steps == [1, 1, 1, 1, 1, 2, LONGEST_STEP]


def test_restart_goes_back_to_the_last_good_look(monkeypatch):
    """While lost, a restart learns the last measured frame and box, not the prediction."""
    started = []

    class Witness(Script):

        def start(self, frame, box):
            started.append((frame, box))
            return super().start(frame, box)

    monkeypatch.setattr('vtrack_ros.session.session.create_tracker', lambda *a, **k: Witness(
        [TrackState.TRACKING, TrackState.SEARCHING, TrackState.LOST]))
    session = TrackingSession()
    frames = [frame(i) for i in range(4)]
    session.start(frames[0], 0, box(0))
    for index in (1, 2, 3):
        session.update(frames[index], index * STEP)
    assert session.estimate.state is TrackState.LOST
    assert session.last_measurement.frame is frames[1]
    session.restart()
    assert started[-1][0] is frames[1] and started[-1][1] == Box(50, 30, 24, 24)


@pytest.mark.parametrize('tracker', tracker_names(replicas=False))
def test_another_tracker_keeps_the_target(tracker):
    """Every tracker continues at the previous one's target."""
    session = TrackingSession('pf')
    session.start(frame(0), 0, box(0))
    session.update(frame(1), STEP)
    session.change(tracker=tracker)
    assert session.tracker == tracker
    estimate = session.update(frame(2), 2 * STEP)
    assert estimate.box.iou(box(2)) > 0.3


def test_changed_parameters_are_in_force_on_the_next_frame():
    """The next estimate has the new number of particles, and the target is kept."""
    session = TrackingSession('gmpf', parameters={'gmpf': {'particles': 50}})
    session.start(frame(0), 0, box(0))
    assert len(session.update(frame(1), STEP).particles) == 50
    session.change(parameters={'gmpf': {'particles': 80}})
    estimate = session.update(frame(2), 2 * STEP)
    assert len(estimate.particles) == 80
    assert estimate.box.iou(box(2)) > 0.3


def test_parameters_of_another_tracker_wait_for_it():
    """A tracker that isn't running uses its changed parameters when it's started."""
    session = TrackingSession('gmpf')
    session.start(frame(0), 0, box(0))
    session.change(parameters={'pf': {'particles': 33}})
    assert session.tracker == 'gmpf'
    session.change(tracker='pf')
    assert len(session.update(frame(1), STEP).particles) == 33


@pytest.mark.parametrize('change, error', [
    ({'tracker': 'nobody'}, ValueError),
    ({'parameters': {'nobody': {}}}, ValueError),
    ({'parameters': {'gmpf': {'nothing': 1}}}, ValueError),
    ({'parameters': {'gmpf': {'particles': 0}}}, ValueError),
    ({'parameters': {'gmpf': {'particles': 'many'}}}, TypeError),
    ({'tracker': 'pf', 'seed': 1, 'parameters': {'pf': {'particles': -1}}}, ValueError),
    ({'seed': -1}, ValueError), ({'seed': 'one'}, TypeError),
])
def test_wrong_changes_change_nothing(change, error):
    """A change with one wrong value raises an error and changes nothing."""
    session, untouched = TrackingSession('gmpf', seed=4), TrackingSession('gmpf', seed=4)
    for one in (session, untouched):
        one.start(frame(0), 0, box(0))
    with pytest.raises(error):
        session.change(**change)
    assert session.tracker == 'gmpf'
    for index in range(1, 4):
        assert (session.update(frame(index), index * STEP).box
                == untouched.update(frame(index), index * STEP).box)


@pytest.mark.parametrize('make', [
    lambda seed: TrackingSession('gmpf', seed), lambda seed: create_tracker('gmpf', seed=seed)])
@pytest.mark.parametrize('seed, error', [(-1, ValueError), ('one', TypeError), (1.5, TypeError)])
def test_a_wrong_seed_is_named(make, seed, error):
    """The error is about the seed, not about a parameter of the tracker."""
    with pytest.raises(error, match=f'^seed {seed!r}: '):
        make(seed)


def test_a_new_seed_counts_from_the_next_start():
    """A new seed has no effect on the running tracker, only from the next start on."""
    session, untouched = TrackingSession('gmpf', seed=4), TrackingSession('gmpf', seed=4)
    for one in (session, untouched):
        one.start(frame(0), 0, box(0))
    session.change(seed=5)
    assert session.update(frame(1), STEP).box == untouched.update(frame(1), STEP).box
    session.start(frame(0), 0, box(0))
    assert session.update(frame(1), STEP).box == fresh_run(5)


def fresh_run(seed):
    """Return the first tracked box of a fresh session."""
    session = TrackingSession('gmpf', seed=seed)
    session.start(frame(0), 0, box(0))
    return session.update(frame(1), STEP).box


@pytest.mark.parametrize('before, after, rotation', [
    ('gmpf', 'pf', True), ('appf', 'abmspf', True), ('gmpf', 'dcf', False)])
def test_another_tracker_goes_on_with_a_turned_target(before, after, rotation):
    """The bound is kept, and so are rotation and own size if the tracker measures rotation."""
    drawn, center, angle = DrawnCard(), (150.0, 120.0), -1.2
    session = TrackingSession(before, seed=1)
    session.start(drawn.frame(center), 0, drawn.box(center))
    for index in range(1, 33):
        session.update(drawn.frame(center, min(index / 30, 1) * angle, seed=index), STEP * index)
    session.change(tracker=after)
    for index in range(33, 40):
        estimate = session.update(drawn.frame(center, angle, seed=index), STEP * index)
    assert estimate.measured
    assert estimate.box.iou(Box.around_ellipse(center, drawn.size, angle)) > 0.8
    if rotation:
        assert estimate.angle == pytest.approx(angle, abs=0.15)
        assert estimate.upright.iou(drawn.box(center)) > 0.85


def test_a_rotation_without_an_affine_frame_leaves_the_box():
    """If a tracker gives an angle but no affine frame, the measured bound is its box."""
    center, axes = (160.0, 120.0), (44.0, 22.0)
    session = TrackingSession('abmspf_paper', seed=1)
    session.start(ellipse(center, axes), 0, Box.from_center(*center, 88, 44))
    for index in range(1, 21):
        estimate = session.update(ellipse(center, axes, 0.04 * index, seed=index), STEP * index)
    assert abs(estimate.angle) > 0.3 and estimate.affine is None and estimate.measured
    assert session.last_measurement.bound == estimate.box
