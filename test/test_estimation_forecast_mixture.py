"""Forecasts that are weighted by their recent errors."""

import math

import numpy as np
import pytest

from vtrack_ros.estimation.forecast_mixture import ForecastMixture, STAYING


def taught(path, forecast, frames=40):
    """Return a mixture updated along a path with two forecasts, and the next two forecasts."""
    mixture, place = ForecastMixture(), path(0)
    for frame in range(1, frames):
        found = path(frame)
        mixture.update(found, {STAYING: place, 'other': forecast(place)}, 1.0)
        place = found
    return mixture, {STAYING: place, 'other': forecast(place)}


def onwards(place):
    """Forecast a step of 0.4 to the right."""
    return place[0] + 0.4, place[1]


def test_a_moving_target_is_expected_further_on():
    """The right forecast is the best, with a mean error below 0.01; that of staying is a step."""
    mixture, forecasts = taught(lambda frame: (0.4 * frame, 0.0), onwards)
    assert mixture.best(forecasts) == 'other'
    assert mixture.error('other') < 0.01
    assert mixture.error(STAYING) == pytest.approx(0.4, abs=0.01)


def test_a_resting_target_is_expected_to_stay():
    """For a resting target the best forecast is staying."""
    mixture, forecasts = taught(lambda frame: (3.0, 0.0), onwards)
    assert mixture.best(forecasts) == STAYING


def test_it_learns_anew_when_the_target_stops():
    """After the target has stopped, the best forecast is staying."""
    mixture, forecasts = taught(lambda frame: (0.4 * min(frame, 20), 0.0), onwards, 60)
    assert mixture.best(forecasts) == STAYING


def test_places_near_the_better_forecast_are_more_probable():
    """The density is highest at the forecast and falls with distance, to more than exp(-12)."""
    mixture, forecasts = taught(lambda frame: (0.4 * frame, 0.0), onwards)
    at = np.array(forecasts['other'])
    places = at + np.array([[0.0, 0.0], [0.2, 0.0], [1.0, 0.0], [30.0, 0.0]])
    density = mixture.log_density(places, forecasts, 1.0, 1.0)
    assert density[0] == 0 and np.all(np.diff(density) < 0)
    assert density[-1] > -12


def test_far_away_it_falls_as_a_cauchy_density_of_the_plane():
    """It falls with the cube of the distance: with its square it isn't a density in the plane."""
    mixture, forecasts = taught(lambda frame: (3.0, 0.0), onwards)
    near, far = mixture.log_density(
        np.array([[103.0, 0.0], [1003.0, 0.0]]), {STAYING: forecasts[STAYING]}, 1.0, 1.0)
    assert far - near == pytest.approx(-3 * math.log(10), abs=0.01)


def test_in_the_first_frames_a_target_may_go_anywhere_near():
    """As the motion is unknown, the density is wide at first, and narrows from frame to frame."""
    mixture, forecasts = ForecastMixture(), {STAYING: (0.0, 0.0)}
    densities = []
    for _ in range(4):
        densities.append(mixture.log_density(np.array([[1.0, 0.0]]), forecasts, 1.0, 1.0)[0])
        mixture.update((0.0, 0.0), forecasts, 1.0)
    assert densities[0] > -2 and np.all(np.diff(densities) < -0.3)


def test_time_widens_the_density():
    """Its width grows with the square root of time, as that of a random walk."""
    mixture = ForecastMixture()
    places, forecasts = np.array([[1.0, 0.0], [2.0, 0.0]]), {STAYING: (0.0, 0.0)}
    now = mixture.log_density(places[:1], forecasts, 1.0, 1.0)
    later = mixture.log_density(places[1:], forecasts, 1.0, 4.0)
    assert now[0] == pytest.approx(later[0])


def test_lengths_are_in_the_callers_unit():
    """With ten times the unit, errors and densities are the same at ten times the distance."""
    small, large = ForecastMixture(), ForecastMixture()
    for mixture, unit in ((small, 1.0), (large, 10.0)):
        for _ in range(5):
            mixture.update((unit, 0.0), {STAYING: (0.0, 0.0)}, unit)
    assert small.error(STAYING) == large.error(STAYING) > 0.5
    densities = [mixture.log_density(np.array([[unit, unit]]), {STAYING: (0.0, 0.0)}, unit, 1.0)
                 for mixture, unit in ((small, 1.0), (large, 10.0))]
    assert math.isclose(*(float(density[0]) for density in densities))
