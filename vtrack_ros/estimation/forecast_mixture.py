"""Several forecasts of one position, each weighted by its recent error."""

from collections.abc import Mapping
import math

import numpy as np

from vtrack_ros.frame import Array, Point

#: Weight of the latest error in a forecast's mean error, an exponential moving average.
_RATE = 0.15
#: Initial mean error of a forecast, and the margin by which another forecast's mean error must be
#: below that of staying to be preferred to it; in the unit of length.
_FIRST_ERROR, _STAYING_MARGIN = 0.12, 0.02
#: Upper bound that errors are clamped to, in the unit of length.
_LARGEST = 1.5
#: Width of the density in mean errors; its lower bound, in the unit of length; and the lower bound
#: in the first frame, which is divided by n in the n-th: how a target moves isn't known at first.
_WIDTH, _NARROWEST, _UNKNOWN = 1.5, 0.12, 0.6
#: The exponent of a Cauchy density in two dimensions.
_TAILS = 1.5

#: Name of the forecast that the target doesn't move; it always has a record.
STAYING = 'staying'


class ForecastMixture:
    """
    Forecasts by name, and the mean error of each.

    A target's dynamics are unknown and change: a model that helps at a low rate harms at a high
    one. So each forecast is weighted by its own record of errors, as the modes of an interacting
    multiple model are [Blom and Bar-Shalom 1988]. The density has the heavy tails of a Cauchy
    density, for targets may move abruptly. The unit of length is the caller's choice, for example
    the target's side.
    """

    def __init__(self) -> None:
        self._errors = {STAYING: _FIRST_ERROR}
        self._frames = 0

    def error(self, name: str) -> float:
        """Return a forecast's mean error."""
        return self._errors.get(name, _FIRST_ERROR)

    def best(self, names: Mapping[str, Point]) -> str:
        """Return the name of least mean error; `_STAYING_MARGIN` is added to all but staying's."""
        return min(names, key=lambda name: self.error(name) + (name != STAYING) * _STAYING_MARGIN)

    @np.errstate(over='ignore')  # after a long pause a forecast may be anywhere
    def log_density(self, places: Array, forecasts: Mapping[str, Point], unit: float,
                    dt: float) -> Array:
        """
        Return the log-density of positions, shape (N, 2), after `dt`: the maximum over forecasts.

        The normalising constant is left out, so that it's at most 0. Positions and forecasts are
        in the same coordinates, e.g. pixels, and `unit` is the unit of length in these.
        """
        best = np.full(len(places), -np.inf)
        narrowest = max(_NARROWEST, _UNKNOWN / (1 + self._frames))
        for name, forecast in forecasts.items():
            width = unit * math.sqrt(dt) * max(narrowest, _WIDTH * self.error(name))
            squares = np.sum((places - forecast)**2, axis=1) / width**2
            np.maximum(best, -_TAILS * np.log1p(squares), out=best)
        return best

    def update(self, place: Point, forecasts: Mapping[str, Point], unit: float) -> None:
        """Update each forecast's mean error by its distance from where the target was found."""
        self._frames += 1
        for name, forecast in forecasts.items():
            error, mean = min(math.dist(place, forecast) / unit, _LARGEST), self.error(name)
            self._errors[name] = mean + _RATE * (error - mean)
