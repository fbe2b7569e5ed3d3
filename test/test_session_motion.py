"""The motion filter: velocity, its covariance, forecasts, and jumps that are no motion."""

import math

import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.geometry.affine import transformation
from vtrack_ros.session.motion_filter import LONGEST_FORECAST, Motion, MotionFilter
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.tracker import Estimate, TrackState

STEP = 33_333_333
SECONDS = STEP / 1e9
SIDE = 40.0
#: A typical covariance of a tracker's measured box.
COVARIANCE = np.diag([0.07, 0.07, 0.1, 0.1])**2 * SIDE**2


def measured(x, y=100.0, size=SIDE, covariance=COVARIANCE, state=TrackState.TRACKING):
    """Return an estimate of a square target about a centre."""
    return Estimate(Box.from_center(x, y, size, size), 0.0, covariance, 1.0, state)


def follow(centers, stamps=None, covariance=COVARIANCE):
    """Return a filter that was given squares about the centres; None is no measurement."""
    motion_filter = MotionFilter()
    stamps = STEP * (1 + np.arange(len(centers))) if stamps is None else stamps
    for center, stamp in zip(centers, stamps):
        motion_filter.add(measured(0.0, state=TrackState.SEARCHING) if center is None else
                          measured(*center, covariance=covariance), int(stamp))
    return motion_filter


def straight(frames, speed=90.0):
    """Return centres of a target that moves right at `speed` [px/s], and up at half of it."""
    return [(50 + speed * SECONDS * i, 200 - speed / 2 * SECONDS * i) for i in range(frames)]


def moving(motion_filter, age=0.0):
    """Return the motion, which must be known."""
    motion = motion_filter.motion(age)
    assert isinstance(motion, Motion)
    return motion


def test_constant_velocity_is_found():
    """From 0 with a large variance the velocity converges on the true one with a small one."""
    first = moving(follow(straight(1)))
    assert not first.velocity.any()
    assert first.covariance[4, 4] > 90**2
    later = moving(follow(straight(40)))
    assert later.velocity == pytest.approx([90, -45, 0, 0], abs=0.5)
    assert later.covariance[4, 4] < first.covariance[4, 4] / 10
    assert later.box.center == pytest.approx(straight(40)[-1])


def test_a_target_that_turns_neither_grows_nor_comes_nearer():
    """A rotating target of 40 x 20 px keeps its size and velocity, though its bound changes."""
    motion_filter, size = MotionFilter(), (40.0, 20.0)
    for index in range(30):
        turn, center = 0.1 * index, (50.0 + 3 * index, 100.0)
        motion_filter.add(Estimate(
            Box.around_ellipse(center, size, turn), turn, COVARIANCE, 1.0, TrackState.TRACKING,
            affine=transformation(center, size, turn)), STEP * (index + 1))
    motion = moving(motion_filter)
    assert motion.velocity == pytest.approx([90, 0, 0, 0], abs=0.5)
    assert motion.box.center == pytest.approx(center, abs=0.1)
    assert (motion.box.width, motion.box.height) == pytest.approx(size)


@pytest.mark.parametrize('density, fading, most', [(2.0, math.inf, 0.995), (500.0, 0.1, 0.95)])
def test_error_is_what_the_covariance_says(density, fading, most):
    """
    The 90 % ellipse of the velocity holds the true one in about 90 % of the frames.

    In more for steady targets: the filter allows for them to become erratic. The truth is by
    Euler's method in steps of a millisecond; the errors of measurement are white.
    """
    rng, inside = np.random.default_rng(8), []
    for _ in range(25):
        velocity = rng.normal(0, SIDE, 2) if math.isinf(fading) else np.zeros(2)
        place, motion_filter = np.array([300.0, 300.0]), MotionFilter()
        for frame in range(40):
            for _ in range(33):
                velocity = velocity * (1 - 1e-3 / fading) + rng.normal(
                    0, SIDE * math.sqrt(density * 1e-3), 2)
                place = place + 1e-3 * velocity
            error = rng.normal(0, SIDE * math.sqrt(0.05 * 0.07**2 + 0.01**2), 2)
            motion_filter.add(measured(*place + error), 33_000_000 * (frame + 1))
            if frame > 10:
                motion = moving(motion_filter)
                offset = motion.velocity[:2] - velocity
                distance = offset @ np.linalg.solve(motion.covariance[4:6, 4:6], offset)
                inside.append(distance < -2 * math.log(0.1))
    assert 0.87 < np.mean(inside) < most


def test_frames_that_never_came():
    """With two of three frames missing the velocity is the same: the time is by the stamps."""
    every = straight(60)
    stamps = STEP * np.arange(1, 61)
    assert moving(follow(every[::3], stamps[::3])).velocity == pytest.approx(
        [90, -45, 0, 0], abs=0.5)


def test_out_of_sight_and_found_on_its_way():
    """Without a measurement there is no motion; found at the predicted place, it's as before."""
    hidden = [*straight(30), *[None] * 6]
    assert follow(hidden).motion() is None
    seen = moving(follow([*hidden, *straight(37)[-1:]]))
    assert seen.velocity == pytest.approx([90, -45, 0, 0], abs=5)


@pytest.mark.parametrize('gap', [0, 1, 6, 40])
@pytest.mark.parametrize('sides', [-6, 5])
def test_found_elsewhere_is_no_velocity(gap, sides):
    """A jump that no motion explains restarts the filter: velocity 0, with a large variance."""
    way = straight(30)
    x, y = way[-1]
    motion = moving(follow([*way, *[None] * gap, (x + sides * SIDE, y)]))
    assert not motion.velocity.any()
    assert motion.covariance[4, 4] > 90**2
    assert motion.box.center == pytest.approx((x + sides * SIDE, y))


def test_long_pause_says_nothing():
    """A gap longer than LONGEST_FORECAST restarts the filter, with velocity 0."""
    way = straight(30)
    stamps = STEP * np.arange(1, 31)
    stamps[-1] = stamps[-2] + LONGEST_FORECAST * 1e9 + STEP
    assert not moving(follow(way, stamps)).velocity.any()


def test_images_without_stamps_have_no_velocity():
    """If a stamp is 0, or that of the image before, there is no motion: no time is known."""
    assert follow(straight(1), np.zeros(1)).motion() is None
    assert follow(straight(10), np.zeros(10)).motion() is None
    assert follow(straight(10), np.full(10, STEP)).motion() is None
    assert follow(straight(3), [0, 0, STEP]).motion() is not None


def test_forecast():
    """The box is extrapolated with the velocity, and its covariance grows from the tracker's."""
    motion_filter = follow(straight(40))
    now, later, last = (moving(motion_filter, age) for age in (0.0, 0.05, 0.2))
    assert now.covariance[:4, :4] == pytest.approx(
        COVARIANCE + (0.01 * SIDE)**2 * np.diag([1, 1, 0.25, 0.25]))
    way = np.subtract(later.box.center, now.box.center)
    assert way == pytest.approx(0.05 * now.velocity[:2], rel=0.03)
    assert later.box.width == pytest.approx(SIDE)
    variances = [np.linalg.eigvalsh(one.covariance[:2, :2])[0] for one in (now, later, last)]
    assert variances == sorted(variances)
    for one in (now, later, last):
        assert np.linalg.eigvalsh(one.covariance)[0] > 0
    assert moving(motion_filter).velocity == pytest.approx(now.velocity)


def test_growth():
    """If the size grows by a factor of e in two seconds, its velocity is half of it per second."""
    motion_filter = MotionFilter()
    for i in range(1, 61):
        motion_filter.add(measured(100.0, size=20 * math.exp(i * SECONDS / 2)), i * STEP)
    motion = moving(motion_filter)
    assert motion.velocity[2:] == pytest.approx([motion.box.width / 2] * 2, rel=0.1)
    ahead = moving(motion_filter, 0.1)
    assert ahead.box.width == pytest.approx(motion.box.width * math.exp(0.05), rel=0.02)
    assert motion.velocity[:2] == pytest.approx([0, 0], abs=1)


def test_unknown_covariance_stays_unknown():
    """If the tracker's covariance is NaN the velocity is known, but its covariance is NaN."""
    motion = moving(follow(straight(40), covariance=np.full((4, 4), np.nan)))
    assert motion.velocity == pytest.approx([90, -45, 0, 0], abs=0.5)
    assert np.isnan(motion.covariance).all()


@pytest.mark.parametrize('covariance', [
    np.zeros((4, 4)), np.ones((4, 4)), -np.eye(4), 1e12 * np.eye(4), np.full((4, 4), 1e200)])
def test_whatever_a_tracker_says(covariance):
    """With zero, singular, negative or huge covariances the velocity stays finite."""
    motion = moving(follow([*straight(20), (1e5, -1e5), (0, 0), None, (1e-3, 0)],
                           covariance=covariance), 0.5)
    assert np.isfinite(motion.velocity).all()


def test_a_late_query_has_the_same_answer():
    """Filtering waits for a query; the velocity is the same as if queried in every frame."""
    asked, silent = MotionFilter(), MotionFilter()
    for i, center in enumerate(straight(80)):
        for one in (asked, silent):
            one.add(measured(*center), STEP * (i + 1))
        asked.motion()
    assert moving(silent).velocity == pytest.approx(moving(asked).velocity, abs=0.5)


def test_session_begins_anew_with_every_target():
    """A new selection starts at velocity 0; after the target is given up there is no motion."""
    rng = np.random.default_rng(1)
    ground = rng.integers(60, 90, (120, 200, 3), np.uint8)
    patch = np.kron(rng.integers(0, 2, (4, 4)), np.ones((6, 6), int))[..., None] * 190

    def frame(i):
        picture = ground.copy()
        picture[40:64, 20 + 3 * i:44 + 3 * i] = patch
        return picture
    session = TrackingSession('dcf')
    assert session.motion() is None
    session.start(frame(0), STEP, Box(20, 40, 24, 24))
    for i in range(1, 20):
        session.update(frame(i), STEP * (i + 1))
    motion = session.motion()
    assert motion is not None
    assert motion.velocity[0] == pytest.approx(3 / SECONDS, rel=0.1)
    session.start(frame(20), STEP * 21, Box(80, 40, 24, 24))
    again = session.motion()
    assert again is not None and not again.velocity.any()
    session.forget()
    assert session.motion() is None
