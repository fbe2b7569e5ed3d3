"""A correlation filter whose support is the target's box, without any background."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
import math
from typing import ClassVar

import numpy as np

from vtrack_ros.appearance.regression import (
    CorrelationFilter, fourier_matrices, inverse_maps, inverse_matrices, side_support, Spectrum,
    transform_matrices)
from vtrack_ros.frame import Array32, Point

#: Regularisation of the filter [Lukezic2017, lambda]; ADMM's penalty in the first iteration, and
#: the factor by which it grows in each one.
_RIDGE, _PENALTY, _GROWTH = 0.01, 5.0, 3.0
#: Iterations of the ADMM.
_STEPS = 2
#: Lower bound of a channel's reliability, its peak response to the example it was learned from.
_LEAST = 1e-4


@dataclass(frozen=True)
class ConstrainedFilter(CorrelationFilter):
    """
    A correlation filter whose support is the target's box, so that no background is in it.

    A filter that was learned from a whole window follows the ground where the camera follows the
    target. Masking it afterwards isn't the same as learning from the box alone, as is done here by
    the alternating direction method of multipliers (ADMM), one channel at a time [Lukezic et al.
    2017, eqs 6-10]. The `numerator` is the filter itself. Channels are weighted by their peak
    response to the example [eq. 11].

    `support` are the matrices that confine a spectrum to the target's box, of `support_matrices`.
    """

    support: tuple[Spectrum, Array32, Spectrum]

    #: Learning rate; lower than the unconstrained filter's, so that this one remembers longer.
    RATE: ClassVar[float] = 0.01

    @classmethod
    def within(cls, width: float, height: float, empty: CorrelationFilter) -> ConstrainedFilter:
        """Make an empty filter for a target of that size, in cells, otherwise like `empty`."""
        rows, columns = empty.shape
        return cls(np.zeros((1, *empty.label.shape), np.complex64),
                   np.ones(empty.label.shape, np.float32), empty.label, empty.shape, 0.0,
                   support_matrices(rows, columns, width, height))

    def updated(self, spectrum: Spectrum, rate: float,
                shift: Point = (0.0, 0.0)) -> ConstrainedFilter:
        """Return the filter after one more example, with weight `rate` in the moving average."""
        fresh = replace(self, numerator=self._learned(spectrum, shift))
        return self.mixed(fresh, rate) if rate < 1 else fresh

    def _learned(self, spectrum: Spectrum, shift: Point) -> Spectrum:
        """Return the constrained filter of one example."""
        over_rows, over_columns = fourier_matrices(*self.shape)
        wanted = self.label * np.exp(shift[1] * over_rows)
        wanted *= np.exp(shift[0] * over_columns)
        cross = wanted * spectrum
        energy = spectrum.real**2 + spectrum.imag**2
        penalty, ridge = np.float32(_PENALTY), np.float32(_RIDGE / 2 / math.prod(self.shape))
        confined = self._confined(cross * (1 / (energy + np.float32(_RIDGE))))
        multiplier = np.zeros_like(cross)
        for _ in range(_STEPS):
            free = penalty * confined
            free += cross
            free -= multiplier
            free *= penalty / (energy + penalty)
            multiplier += free
            confined = self._confined(multiplier)
            confined *= 1 / (ridge + penalty)
            multiplier -= penalty * confined
            penalty *= np.float32(_GROWTH)
        answers = inverse_maps(confined.conj() * spectrum).reshape(len(spectrum), -1).max(axis=1)
        reliability = np.maximum(answers, _LEAST)
        confined *= (reliability / reliability.sum())[:, None, None]
        return confined

    def _confined(self, spectrum: Spectrum) -> Spectrum:
        """Return the spectrum of the maps masked by the support."""
        to_rows, within_columns, from_rows = self.support
        within: Spectrum = from_rows @ ((to_rows @ spectrum).view(np.float32)
                                        @ within_columns).view(np.complex64)
        return within


@lru_cache(maxsize=32)
def support_matrices(rows: int, columns: int, width: float, height: float,
                     ) -> tuple[Spectrum, Array32, Spectrum]:
    """
    Return the matrices that mask a spectrum's maps by a box about (0, 0), cyclically.

    They are multiplied in turn: the first from the left, which gives the box's rows alone; the
    second from the right, where real and imaginary parts are interleaved; the third from the left,
    which gives a spectrum again. Sizes are in cells.
    """
    down, across = side_support(rows, height), side_support(columns, width)
    inside = down > 0
    forward = transform_matrices(rows, columns, tapered=False)
    back = inverse_matrices(rows, columns)
    return (back[0][inside], ((back[1] * across) @ forward[0]).astype(np.float32),
            (forward[1][:, inside] * down[inside]).astype(np.complex64))
