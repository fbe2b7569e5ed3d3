"""GM(1,1): what the grey model reproduces, its limits, and pitfalls of the printed equations."""

from functools import partial
import math

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest

from vtrack_ros.estimation import (
    Belief, ConstantVelocity, gm11_forecast, GreyProposal, Weights)

LENGTHS = (4, 5, 6, 8)
equivariant_forecast = partial(gm11_forecast, margin=10.0)


def as_printed(series):
    """Evaluate the paper's equations with a general least-squares solver (a != 0)."""
    m = len(series)
    accumulated = np.cumsum(series)
    background = (accumulated[1:] + accumulated[:-1]) / 2
    design = np.column_stack([-background, np.ones(m - 1)])
    a, b = np.linalg.lstsq(design, series[1:], rcond=None)[0]
    return (series[0] - b / a) * math.exp(-a * m) * (1 - math.exp(a))


@pytest.mark.parametrize('length', LENGTHS)
def test_positive_series_get_the_paper_s_formula(length):
    rng = np.random.default_rng(length)
    series = rng.uniform(1.0, 3.0, (length, 6))
    expected = [as_printed(column) for column in series.T]
    np.testing.assert_allclose(gm11_forecast(series), expected, rtol=1e-8)


@pytest.mark.parametrize('length', LENGTHS)
def test_other_series_get_it_after_a_shift_up_to_their_range(length):
    """The smallest value of the shifted series is the range."""
    series = np.random.default_rng(length).uniform(-3.0, 1.0, length)
    shift = np.ptp(series) - series.min()
    expected = as_printed(series + shift) - shift
    assert gm11_forecast(series[:, np.newaxis])[0] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize('length', LENGTHS)
@pytest.mark.parametrize('value', [1e-6, 0.0, 3.0, -7.0, 1e9])
@pytest.mark.parametrize('forecast', [gm11_forecast, equivariant_forecast])
def test_a_constant_series_stays(length, value, forecast):
    """Here a is zero: the forecast is the limit b."""
    result = forecast(np.full((length, 2), value))
    np.testing.assert_allclose(result, value, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize('length', LENGTHS)
@pytest.mark.parametrize('ratio', [0.7, 0.9, 0.99, 1.01, 1.1, 1.5])
def test_a_geometric_series_goes_on(length, ratio):
    """
    GM(1,1) fits a geometric series without residual.

    With u = (r - 1) / (r + 1) the fit is a = -2u, where log r = 2 atanh u. This difference d is
    all of the error: d for each of the m steps, and `d / |a| + d` at most by `1 - exp(a)`.
    """
    series = 5.0 * ratio ** np.arange(length + 1)
    u = (ratio - 1) / (ratio + 1)
    fitted = 5.0 * ratio / (ratio - 1) * math.exp(2 * u * length) * (1 - math.exp(-2 * u))
    forecast = gm11_forecast(series[:-1, np.newaxis])[0]
    assert forecast == pytest.approx(fitted, rel=1e-9)
    difference = 2 * (math.atanh(abs(u)) - abs(u))
    bound = difference * (length + 1 + 1 / abs(2 * u))
    assert abs(math.log(forecast / series[-1])) <= bound + 1e-12


def test_the_limit_of_a_small_slope_is_continuous():
    base = np.array([100.0, 100.0, 100.0, 100.0, 100.0])
    slope = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    for size in (1e-3, 1e-6, 1e-9, 1e-12):
        forecast = gm11_forecast((base + size * slope)[:, np.newaxis])[0]
        assert forecast == pytest.approx(100.0 + 5 * size, abs=size * 0.1 + 1e-11)


@pytest.mark.parametrize('slope', [-3.0, -0.1, 0.2, 4.0])
@pytest.mark.parametrize('start', [0.0, 200.0, -1000.0])
def test_a_line_goes_on_and_the_margin_says_how_well(slope, start):
    """The departure from a line falls with the square of slope over shift: O(1 / margin)."""
    line = start + slope * np.arange(6.0)
    errors = []
    for margin in (10.0, 100.0, 1000.0):
        forecast = equivariant_forecast(line[:-1, np.newaxis], margin=margin)[0]
        errors.append(abs(forecast - line[-1]) / abs(slope))
    assert errors[0] < 0.1
    assert errors[1] < errors[0] / 8 and errors[2] < errors[1] / 8


def test_a_large_margin_is_the_least_squares_line_through_all_but_the_first():
    series = np.array([9.0, 2.0, 3.5, 3.0, 5.5])
    line = np.polyval(np.polyfit(np.arange(2, 6), series[1:], 1), 6)
    forecast = equivariant_forecast(series[:, np.newaxis], margin=1e6)[0]
    assert forecast == pytest.approx(line, abs=1e-3)


@pytest.mark.parametrize('forecast', [gm11_forecast, equivariant_forecast])
def test_series_through_zero(forecast):
    """A velocity that changes its sign is forecast beyond its last value, and bounded."""
    velocity = np.array([[-2.0], [-1.0], [0.0], [1.0], [2.0]])
    assert 2.0 < forecast(velocity)[0] < 4.5


def test_positive_columns_are_left_alone_beside_others():
    rng = np.random.default_rng(1)
    positive, mixed = rng.uniform(1, 2, (5, 1)), rng.normal(size=(5, 1))
    together = gm11_forecast(np.hstack([positive, mixed]))
    # other strides may round differently
    assert together[0] == pytest.approx(gm11_forecast(positive)[0], rel=1e-12)
    assert together[1] == pytest.approx(gm11_forecast(mixed)[0], rel=1e-12)


series_of_any_kind = arrays(
    float, (5, 2), elements=st.floats(-1e12, 1e12, allow_subnormal=False))


@settings(max_examples=300, deadline=None, derandomize=True)
@given(series_of_any_kind)
def test_no_series_overflows(series):
    """|a| <= 2 for a positive series, so the forecast of five values grows e^12 at most."""
    span = np.ptp(series, axis=0) + np.abs(series).max(axis=0)
    for forecast in (gm11_forecast, equivariant_forecast):
        result = forecast(series)
        assert np.isfinite(result).all()
        assert (np.abs(result) <= 1e7 * span).all()


@settings(max_examples=100, deadline=None, derandomize=True)
@given(arrays(float, (5, 1), elements=st.floats(-100, 100).map(lambda x: round(x, 3))),
       st.floats(-1e4, 1e4), st.floats(0.01, 100))
def test_the_equivariant_forecast_moves_and_scales_with_the_series(series, shift, scale):
    moved = equivariant_forecast(scale * series + shift)
    expected = scale * equivariant_forecast(series) + shift
    np.testing.assert_allclose(moved, expected, rtol=1e-6,
                               atol=1e-7 * (1 + abs(shift) + scale * 100))


def test_the_paper_s_forecast_is_not_shift_invariant():
    """The pitfall that the equivariant form avoids."""
    series = np.array([[1.0], [2.0], [3.0], [4.0], [5.0]])
    assert abs(gm11_forecast(series)[0] - (gm11_forecast(series + 100)[0] - 100)) > 0.1


def test_several_steps_ahead():
    series = 3.0 * 1.05 ** np.arange(9)
    for steps in (1, 2, 3):
        forecast = gm11_forecast(series[:5, np.newaxis], steps)[0]
        assert forecast == pytest.approx(series[4 + steps], rel=1e-3)
    half = gm11_forecast(series[:5, np.newaxis], 0.5)[0]
    assert series[4] < half < series[5]


@pytest.mark.parametrize('forecast', [gm11_forecast, equivariant_forecast])
@pytest.mark.parametrize('series', [
    np.ones((3, 2)), np.ones(5), np.full((5, 1), math.nan), np.full((5, 1), math.inf)])
def test_wrong_series_are_refused(forecast, series):
    with pytest.raises(ValueError, match='series'):
        forecast(series)


def test_a_wrong_margin_is_refused():
    with pytest.raises(ValueError, match='margin'):
        equivariant_forecast(np.ones((5, 1)), margin=0.0)


def test_estimates_of_one_time_are_taken_for_one_step_apart():
    estimates = tuple(np.array([200 + 20.0 * step]) for step in range(5))
    proposal = GreyProposal(5)
    once, spaced = (proposal.forecast(Belief(
        np.zeros((2, 1)), Weights.uniform(2), 4.0, None, estimates, times), 1.0)
        for times in ((4.0,) * 5, (0.0, 1.0, 2.0, 3.0, 4.0)))
    np.testing.assert_array_equal(once, spaced)


@pytest.mark.parametrize('times', [(0, 1, 2, 3, 6), (0, 1, 4, 5, 6), (50, 53, 54, 55, 56)])
def test_dropped_frames_do_not_bend_a_line(times):
    """Estimates on a line with a gap: the forecast is on the line, at any step."""
    estimates = tuple(np.array([200 + 20.0 * time, 20.0]) for time in times)
    belief = Belief(np.zeros((2, 2)), Weights.uniform(2), float(times[-1]), None, estimates,
                    tuple(map(float, times)))
    proposal = GreyProposal(5, velocities={1: 0})
    for step in (1.0, 2.0):
        position, velocity = proposal.forecast(belief, step)
        assert position == pytest.approx(200 + 20 * (times[-1] + step), abs=0.15 * 20 * step)
        assert velocity == pytest.approx(20, rel=0.15)


def test_a_forecast_so_far_ahead_that_its_spread_overflows_is_not_drawn_from():
    """P_k of eq. 17 has the square of the forecast motion: infinite, though that is finite."""
    model, times = ConstantVelocity(2), (0.0, 1.0, 2.0, 3.0, 4.0)
    estimates = tuple(np.array([100 + 8.0 * time, 100, 8, 0]) for time in times)
    belief = Belief(np.tile(estimates[-1], (20, 1)), Weights.uniform(20), 4.0, None, estimates,
                    times)
    proposal = GreyProposal(5, margin=None)
    assert np.isfinite(proposal.forecast(belief, 1e4)).all()
    proposed = proposal.propose(model, belief, 1e4, np.random.default_rng(1))
    assert np.isfinite(proposed.states).all() and proposed.log_density is None
