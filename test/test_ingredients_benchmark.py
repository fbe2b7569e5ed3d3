"""The benchmark of the ingredients: each one can be left out, and is restored afterwards."""

from evaluation_material import write_sequence
import numpy as np
import pytest

from vtrack_ros.estimation.forecast_mixture import ForecastMixture
from vtrack_ros.evaluation.sequences import read_folder
from vtrack_ros.localisation.redetection import Redetection


@pytest.fixture
def ingredients(from_benchmarks):
    """Return the benchmark."""
    return from_benchmarks('ingredients')


def test_a_target_that_is_lost_is_followed_without_each_ingredient(
        ingredients, tmp_path, monkeypatch):
    """Each run has a reproducible score, whatever is left out, re-detection included."""
    asked = []
    update = Redetection.update

    def counted(self, *values):
        asked.append(self)
        return update(self, *values)

    monkeypatch.setattr(Redetection, 'update', counted)
    sequence, = read_folder(write_sequence(tmp_path / 'square', frames=26))
    scores = ingredients.follow('gmpf', 'hidden', 0, sequence)
    assert asked
    assert list(scores) == list(ingredients.WITHOUT)
    assert all(0 <= score <= 1 for score in scores.values())
    some = ('re-detection', 'the second model')
    monkeypatch.setattr(ingredients, 'WITHOUT', {name: ingredients.WITHOUT[name] for name in some})
    assert ingredients.follow('gmpf', 'hidden', 0, sequence) == {
        name: scores[name] for name in some}


def test_what_was_left_out_is_there_again(ingredients):
    """Without the forecasts all places are equally likely; afterwards they count again."""
    mixture, forecasts = ForecastMixture(), {'staying': (0.0, 0.0)}
    places = np.array([(0.0, 0.0), (40.0, 0.0)])

    def gap():
        near, far = mixture.log_density(places, forecasts, 20.0, 1.0)
        return near - far

    with_it = gap()
    with ingredients.without('motion among candidates'):
        assert gap() == 0
    assert gap() == with_it > 0
