"""Running means: of values, and of velocities."""

import pytest

from vtrack_ros.localisation.running_means import ExampleTime, latest_weight, mean_velocity


def test_a_velocity_is_a_running_mean():
    """It's a moving average of steps, [px/frame], with a weight of the latest one."""
    velocity = mean_velocity((0.0, 0.0), (10.0, 10.0), (18.0, 10.0), 2.0, 0.3)
    assert velocity == pytest.approx((0.3 * 4, 0.0))
    velocity = mean_velocity(velocity, (18.0, 10.0), (18.0, 13.0), 1.0, 0.3)
    assert velocity == pytest.approx((0.7 * 0.3 * 4, 0.3 * 3))


def test_a_mean_begins_as_a_plain_one_and_goes_on_at_its_rate():
    """The first four values have equal weights; from the tenth on the latest has the rate."""
    mean = 0.0
    for time, value in enumerate((8.0, 2.0, 4.0, 6.0), start=1):
        mean += latest_weight(0.1, 1.0, time) * (value - mean)
    assert mean == pytest.approx(5.0)
    assert latest_weight(0.1, 1.0, 40.0) == 0.1
    assert latest_weight(0.1, 3.0, 40.0) == pytest.approx(0.3)


def test_a_step_longer_than_the_mean_is_all_of_it():
    """After a gap the weight of the latest value is 1, and never more."""
    assert latest_weight(0.5, 30.0, 40.0) == 1.0


def test_a_mean_over_a_long_time_goes_on_at_its_rate():
    """Without a time the weight is that of a moving average: the rate, per frame."""
    assert latest_weight(0.1, 1.0) == 0.1
    assert latest_weight(0.1, 4.0) == pytest.approx(0.4)


def due(intervals, every, phase=0):
    """Return the numbers of the frames, from 1 on, in which something is due."""
    time, frames = ExampleTime(), []
    for frame, dt in enumerate(intervals, start=1):
        time.advance(dt)
        if time.is_due(every, phase):
            frames.append(frame)
    return frames


def test_what_is_done_at_an_interval_is_due_by_the_time():
    """Every four frames; at half the frame rate in every second one; at a fifth in all."""
    assert due(12 * [1.0], 4) == [4, 8, 12]
    assert due(8 * [1.0], 2, phase=1) == [1, 3, 5, 7]
    assert due([1.0, *6 * [2.0]], 4) == [3, 5, 7]
    assert due(5 * [5.0], 4) == [2, 3, 4, 5]


def test_an_example_stands_for_the_time_since_the_last_but_not_for_a_gap():
    time, steps = ExampleTime(), []
    for dt in (1.0, 3.0, 3.0, 20.0, 3.0):
        time.advance(dt)
        steps.append(time.step)
    assert steps == [1.0, 1.0, 3.0, 3.0, 3.0]
    time.advance(7.0, by_one=True)
    assert time.step == 1.0


@pytest.mark.parametrize('step, count', [(1.0, 1.0), (4.0, 1.0), (6.0, 1.5)])
def test_an_example_of_a_longer_time_than_the_interval_counts_more(step, count):
    time = ExampleTime()
    time.advance(step)
    time.advance(step)
    assert time.count(4) == count
