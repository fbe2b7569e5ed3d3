"""Running means: of values, and of velocities."""

import pytest

from vtrack_ros.localisation.running_means import latest_weight, mean_velocity


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
