"""Several forecasts of one place, each believed as far as it foretold lately."""

from collections.abc import Mapping
import math

import numpy as np

from vtrack_ros.frame import Array, Point

#: Weight of the latest error in a forecast's mean error.
_RATE = 0.15
#: Mean error that a forecast begins with, and by how much another one has to be better than that
#: of staying, in units.
_FIRST_ERROR, _BETTER = 0.12, 0.02
#: Error beyond which a forecast isn't any more wrong.
_LARGEST = 1.5
#: The density's width is so many mean errors, and not less than that; in the first frame not less
#: than the last, in the second half of it, and so on: how a target moves isn't known at first.
_WIDTH, _NARROWEST, _UNKNOWN = 1.5, 0.12, 0.6
#: The exponent of a Cauchy density in two dimensions.
_TAILS = 1.5

#: The forecast that the target stays: it's always there.
STAYING = 'staying'


class ForecastMixture:
    """
    Forecasts by name, and the mean error of each.

    A target's dynamics aren't known, and change: what helps at a low rate harms at a high one. So
    each forecast is believed by its own record, as the modes of an interacting multiple model are
    [Blom and Bar-Shalom 1988], with tails as heavy as a Cauchy density's, for targets dart off.
    All lengths are in a unit that the caller chooses, as the target's side is.
    """

    def __init__(self) -> None:
        self._errors = {STAYING: _FIRST_ERROR}
        self._frames = 0

    def error(self, name: str) -> float:
        """Return a forecast's mean error."""
        return self._errors.get(name, _FIRST_ERROR)

    def best(self, names: Mapping[str, Point]) -> str:
        """Return the name of the forecast with the least mean error; staying has a start."""
        return min(names, key=lambda name: self.error(name) + (name != STAYING) * _BETTER)

    @np.errstate(over='ignore')  # after a long pause a forecast may be anywhere
    def log_density(self, places: Array, forecasts: Mapping[str, Point], unit: float,
                    dt: float) -> Array:
        """
        Return how probable places, shape (N, 2), are after `dt`: at most 0, by the best forecast.

        Up to a constant, and in the same unit as the forecasts, of which `unit` is one.
        """
        best = np.full(len(places), -np.inf)
        narrowest = max(_NARROWEST, _UNKNOWN / (1 + self._frames))
        for name, forecast in forecasts.items():
            width = unit * math.sqrt(dt) * max(narrowest, _WIDTH * self.error(name))
            squares = np.sum((places - forecast)**2, axis=1) / width**2
            np.maximum(best, -_TAILS * np.log1p(squares), out=best)
        return best

    def update(self, place: Point, forecasts: Mapping[str, Point], unit: float) -> None:
        """Learn from where the target was found how wrong each forecast was."""
        self._frames += 1
        for name, forecast in forecasts.items():
            error, mean = min(math.dist(place, forecast) / unit, _LARGEST), self.error(name)
            self._errors[name] = mean + _RATE * (error - mean)
