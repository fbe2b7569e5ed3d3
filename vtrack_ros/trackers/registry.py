"""Trackers by name: one line each, and every front end offers it."""

from __future__ import annotations

from typing import Any

import numpy as np

from vtrack_ros.tracker import Tracker
from vtrack_ros.trackers.affine import (
    AffineKeypointParticleFilter, AffineParticleFilter, SubspaceParticleFilter)
from vtrack_ros.trackers.mean_shift import (
    AdaptiveBandwidthMeanShift, MeanShiftParticleFilter)
from vtrack_ros.trackers.particle import (
    ColourParticleFilter, GreyParticleFilter, KalmanParticleFilter, PrunedQuadratureParticleFilter,
    QuadratureParticleFilter, UnscentedParticleFilter)

_CLASSES: tuple[type[Tracker], ...] = (
    GreyParticleFilter,
    PrunedQuadratureParticleFilter,
    MeanShiftParticleFilter,
    AffineKeypointParticleFilter,
    ColourParticleFilter,
    KalmanParticleFilter,
    UnscentedParticleFilter,
    QuadratureParticleFilter,
    AdaptiveBandwidthMeanShift,
    AffineParticleFilter,
    SubspaceParticleFilter,
)
_REGISTRY = {cls.NAME: cls for cls in _CLASSES}


def tracker_names() -> tuple[str, ...]:
    """Return the names of all trackers."""
    return tuple(_REGISTRY)


def tracker_class(name: str) -> type[Tracker]:
    """
    Return the class of a tracker.

    Raises
    ------
    ValueError
        If there is no tracker of that name; the message lists those that there are.

    """
    if name not in _REGISTRY:
        raise ValueError(f'unknown tracker {name!r}; valid are ' + ', '.join(_REGISTRY))
    return _REGISTRY[name]


def create_tracker(
        name: str, *, seed: int | np.random.Generator | None = None,
        **parameters: Any) -> Tracker:
    """
    Make a tracker.

    Parameters
    ----------
    name : str
        One of `tracker_names()`.
    seed : int, numpy.random.Generator or None
        Where its randomness comes from.
    **parameters
        The tracker's own parameters; the rest have their defaults.

    Raises
    ------
    TypeError, ValueError
        If the name or a parameter is unknown, of the wrong type or out of range.

    """
    return tracker_class(name)(seed, **parameters)
