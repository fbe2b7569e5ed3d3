"""Forecasts that are believed as far as they foretold lately."""

import math

import numpy as np
import pytest

from vtrack_ros.estimation.forecast_mixture import ForecastMixture, STAYING


def taught(path, forecast, frames=40):
    """Return a mixture that has seen a path, with one forecast beside that of staying."""
    mixture, place = ForecastMixture(), path(0)
    for frame in range(1, frames):
        found = path(frame)
        mixture.update(found, {STAYING: place, 'other': forecast(place)}, 1.0)
        place = found
    return mixture, {STAYING: place, 'other': forecast(place)}


def onwards(place):
    """Expect a step to the right."""
    return place[0] + 0.4, place[1]


def test_a_moving_target_is_expected_further_on():
    """The forecast that was right has a mean error next to nothing."""
    mixture, forecasts = taught(lambda frame: (0.4 * frame, 0.0), onwards)
    assert mixture.best(forecasts) == 'other'
    assert mixture.error('other') < 0.01
    assert mixture.error(STAYING) == pytest.approx(0.4, abs=0.01)


def test_a_resting_target_is_expected_to_stay():
    """Nothing is forecast for the sake of forecasting."""
    mixture, forecasts = taught(lambda frame: (3.0, 0.0), onwards)
    assert mixture.best(forecasts) == STAYING


def test_it_learns_anew_when_the_target_stops():
    """What helped before the stop doesn't after it."""
    mixture, forecasts = taught(lambda frame: (0.4 * min(frame, 20), 0.0), onwards, 60)
    assert mixture.best(forecasts) == STAYING


def test_places_near_the_better_forecast_are_more_probable():
    """At it the density is highest; far away a dart off is improbable, and not impossible."""
    mixture, forecasts = taught(lambda frame: (0.4 * frame, 0.0), onwards)
    at = np.array(forecasts['other'])
    places = at + np.array([[0.0, 0.0], [0.2, 0.0], [1.0, 0.0], [30.0, 0.0]])
    density = mixture.log_density(places, forecasts, 1.0, 1.0)
    assert density[0] == 0 and np.all(np.diff(density) < 0)
    assert density[-1] > -12


def test_far_away_it_falls_as_a_cauchy_density_of_the_plane():
    """With the cube of the distance: what falls with its square isn't a density in two axes."""
    mixture, forecasts = taught(lambda frame: (3.0, 0.0), onwards)
    near, far = mixture.log_density(
        np.array([[103.0, 0.0], [1003.0, 0.0]]), {STAYING: forecasts[STAYING]}, 1.0, 1.0)
    assert far - near == pytest.approx(-3 * math.log(10), abs=0.01)


def test_in_the_first_frames_a_target_may_go_anywhere_near():
    """How it moves isn't known then: what is a side away is the less probable the later it is."""
    mixture, forecasts = ForecastMixture(), {STAYING: (0.0, 0.0)}
    densities = []
    for _ in range(4):
        densities.append(mixture.log_density(np.array([[1.0, 0.0]]), forecasts, 1.0, 1.0)[0])
        mixture.update((0.0, 0.0), forecasts, 1.0)
    assert densities[0] > -2 and np.all(np.diff(densities) < -0.3)


def test_time_widens_the_density():
    """As the root of it, as a random walk's."""
    mixture = ForecastMixture()
    places, forecasts = np.array([[1.0, 0.0], [2.0, 0.0]]), {STAYING: (0.0, 0.0)}
    now = mixture.log_density(places[:1], forecasts, 1.0, 1.0)
    later = mixture.log_density(places[1:], forecasts, 1.0, 4.0)
    assert now[0] == pytest.approx(later[0])


def test_lengths_are_in_the_callers_unit():
    """A target ten times as large may move ten times as far."""
    small, large = ForecastMixture(), ForecastMixture()
    for mixture, unit in ((small, 1.0), (large, 10.0)):
        for _ in range(5):
            mixture.update((unit, 0.0), {STAYING: (0.0, 0.0)}, unit)
    assert small.error(STAYING) == large.error(STAYING) > 0.5
    densities = [mixture.log_density(np.array([[unit, unit]]), {STAYING: (0.0, 0.0)}, unit, 1.0)
                 for mixture, unit in ((small, 1.0), (large, 10.0))]
    assert math.isclose(*(float(density[0]) for density in densities))
