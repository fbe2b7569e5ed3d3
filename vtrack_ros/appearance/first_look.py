"""How much a place looks like the target at first, whatever was learned since."""

from __future__ import annotations

from dataclasses import dataclass

from vtrack_ros.appearance.correlation import CorrelationFilter, Spectrum
from vtrack_ros.appearance.target import Point, TargetModel, View

#: Likeness of the first look itself. A filter that sees the target alone answers more to anything
#: than one that sees the surroundings too; with this weight the two are on one scale.
_PART_WEIGHT = 0.75
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
    part : CorrelationFilter
        The model's, confined to the target.
    gain : float
        What the part's response is multiplied with.
    colour : float
        The target's mean foreground probability in the first frame.

    """

    model: TargetModel
    part: CorrelationFilter
    gain: float
    colour: float

    @classmethod
    def of(cls, model: TargetModel, view: View) -> FirstLook:
        """Remember a model, and the view that it was learned from, the target in its middle."""
        part = model.correlation.confined(*model.layout.target)
        peak = float(part.response(model.transform(view)).max())
        return cls(model, part, _PART_WEIGHT / max(peak, 1e-6), model.mean_probability(view))

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
        near = slice(max(0, row - 2), row + 3), slice(max(0, column - 2), column + 3)
        whole = float(self.model.correlation.response(spectrum, *near).max())
        part = self.gain * float(self.part.response(spectrum, *near).max())
        colour = self.model.mean_probability(view, shift) / max(self.colour, 1e-6)
        likeness: float = min(whole, part)
        likeness *= min(max(colour, _LEAST_COLOUR), 1.0)**_COLOUR_POWER
        return likeness
