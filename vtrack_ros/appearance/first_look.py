"""How much a place looks like the target at first, whatever was learned since."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vtrack_ros.appearance.correlation import CorrelationFilter, Spectrum
from vtrack_ros.appearance.target import Point, TargetModel, View

#: Likeness of the first look itself. A filter that sees the target alone answers more to anything
#: than one that sees the surroundings too; with this weight the two are on one scale.
_PART_WEIGHT = 0.75
#: The least that the response of the target alone to itself is taken for: where there is less,
#: nothing is to be recognised, and it has to stay little.
_LEAST_PART = 0.1
#: Power of the colours' evidence, and the least that it's taken for: light takes all colours away.
_COLOUR_POWER, _LEAST_COLOUR = 0.25, 0.3


@dataclass(frozen=True)
class FirstLook:
    """
    What a target looked like in the first frame.

    The correlation filter of the first frame was learned against the surroundings, so it tells
    the target from them far better than a likeness of features does. But it was learned with them
    too: where the target stood, they still answer when it has gone. So a place has to satisfy
    both the whole filter and the part of it that looks at the target alone, and to have the
    target's colours.

    Parameters
    ----------
    model : TargetModel
        As it was learned from the first frame.
    filters : CorrelationFilter
        Two in one: the model's, and the part of it that is confined to the target.
    colour : float
        The target's mean foreground probability in the first frame.

    """

    model: TargetModel
    filters: CorrelationFilter
    colour: float

    @classmethod
    def of(cls, model: TargetModel, view: View) -> FirstLook:
        """Remember a model, and the view that it was learned from, the target in its middle."""
        whole = model.correlation
        part = whole.confined(*model.layout.target)
        own = float(part.response(model.transform(view)).max())
        gain = _PART_WEIGHT / max(own, _LEAST_PART)
        both = np.stack([whole.numerator, np.complex64(gain) * part.numerator])
        return cls(model, replace(whole, numerator=both), model.mean_probability(view))

    def likeness(self, view: View, spectrum: Spectrum, shift: Point = (0.0, 0.0)) -> float:
        """
        Return how much a place looks like the target at first: 0.75 if it's the same.

        The lesser of the two filters' highest responses within two cells of the place, times a
        root of the place's share of the target's colours.

        Parameters
        ----------
        view : View
            The window that is looked at.
        spectrum : ndarray of complex64
            The view's.
        shift : tuple of float, [cells]
            The place from the view's centre.

        """
        layout = self.model.layout
        row = min(max(round(shift[1]) + layout.rows // 2, 0), layout.rows - 1)
        column = min(max(round(shift[0]) + layout.columns // 2, 0), layout.columns - 1)
        near = self.filters.response(
            spectrum, slice(max(0, row - 2), row + 3), slice(max(0, column - 2), column + 3))
        colour = self.model.mean_probability(view, shift) / max(self.colour, 1e-6)
        likeness: float = min(near.reshape(2, -1).max(axis=1).tolist())
        likeness *= min(max(colour, _LEAST_COLOUR), 1.0)**_COLOUR_POWER
        return likeness
