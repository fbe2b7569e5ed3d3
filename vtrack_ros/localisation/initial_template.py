"""How similar a place is to the target in the first frame, whatever was learned since."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vtrack_ros.appearance.colour_model import ColourModel
from vtrack_ros.appearance.correlation_filter import CorrelationFilter
from vtrack_ros.frame import Point
from vtrack_ros.localisation.search_window import SearchWindow
from vtrack_ros.localisation.target_model import TargetModel

#: Similarity of the first frame itself. A filter that sees the target alone answers more to
#: anything than one that sees the surroundings too; with this weight the two are on one scale.
_PART_WEIGHT = 0.75
#: The least that the response of the target alone to itself is taken for: where there is less,
#: nothing is to be recognised, and it has to stay little.
_LEAST_PART = 0.1
#: Power of the colours' share, and the least that it's taken for: light takes all colours away.
_COLOUR_POWER, _LEAST_COLOUR = 0.25, 0.3


@dataclass(frozen=True)
class InitialTemplate:
    """
    The verifier: what a target looked like in the first frame.

    The correlation filter of the first frame was learned against the surroundings, so it tells
    the target from them far better than a similarity of features does. But it was learned with
    them too: where the target stood, they still answer when it has gone. So a place has to satisfy
    both the whole filter and the part of it that sees the target alone, and to have the target's
    colours.

    Parameters
    ----------
    filters : CorrelationFilter
        Two in one: the model's, and the part of it that is confined to the target.
    colours : ColourModel
        Of the first frame.
    colour : float
        The target's mean foreground probability in the first frame.

    """

    filters: CorrelationFilter
    colours: ColourModel
    colour: float

    @classmethod
    def of(cls, model: TargetModel, window: SearchWindow) -> InitialTemplate:
        """Keep a model, and the window that it was learned from, the target in its middle."""
        whole = model.correlation
        part = whole.confined(*window.layout.target)
        own = float(part.response(window.spectrum).max())
        gain = _PART_WEIGHT / max(own, _LEAST_PART)
        both = np.stack([whole.numerator, np.complex64(gain) * part.numerator])
        colour = model.colours.mean_probability(window.colours, window.rectangle((0.0, 0.0)))
        return cls(replace(whole, numerator=both), model.colours, colour)

    def similarity(self, window: SearchWindow, shift: Point = (0.0, 0.0)) -> float:
        """
        Return how similar a place is to the target at first: 0.75 if it's the same.

        The lesser of the two filters' highest responses within two cells of the place, times a
        root of the place's share of the target's colours.

        Parameters
        ----------
        window : SearchWindow
            That shows the place.
        shift : tuple of float, [cells]
            The place from the window's centre.

        """
        rows, columns = window.layout.rows, window.layout.columns
        row = min(max(round(shift[1]) + rows // 2, 0), rows - 1)
        column = min(max(round(shift[0]) + columns // 2, 0), columns - 1)
        near = self.filters.response(
            window.spectrum, slice(max(0, row - 2), row + 3),
            slice(max(0, column - 2), column + 3))
        colour = self.colours.mean_probability(
            window.colours, window.rectangle(shift)) / max(self.colour, 1e-6)
        similarity: float = min(near.reshape(2, -1).max(axis=1).tolist())
        similarity *= min(max(colour, _LEAST_COLOUR), 1.0)**_COLOUR_POWER
        return similarity
