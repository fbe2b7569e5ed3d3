"""Trackers by name: one line each, and every front end offers it."""

from typing import Any

import numpy as np

from vtrack_ros.replicas import REPLICAS
from vtrack_ros.tracker import Tracker
from vtrack_ros.trackers.abmspf import MeanShiftParticleFilter
from vtrack_ros.trackers.appf import AffineKeypointParticleFilter
from vtrack_ros.trackers.dcf import CorrelationTracker
from vtrack_ros.trackers.particle_tracker import (
    GreyParticleFilter, PriorParticleFilter, PrunedQuadratureParticleFilter)

_PRODUCT: tuple[type[Tracker], ...] = (
    GreyParticleFilter,
    PrunedQuadratureParticleFilter,
    MeanShiftParticleFilter,
    AffineKeypointParticleFilter,
    PriorParticleFilter,
    CorrelationTracker,
)
_REGISTRY = {cls.NAME: cls for cls in (*_PRODUCT, *REPLICAS)}


def tracker_names(replicas: bool = True) -> tuple[str, ...]:
    """Return the names of all trackers, or without the replicas of the papers."""
    return tuple(_REGISTRY) if replicas else tuple(cls.NAME for cls in _PRODUCT)


def tracker_class(name: str) -> type[Tracker]:
    """Return the class of a tracker; the ValueError of an unknown one lists those there are."""
    if name not in _REGISTRY:
        raise ValueError(f'unknown tracker {name!r}; valid are ' + ', '.join(_REGISTRY))
    return _REGISTRY[name]


def create_tracker(
        name: str, *, seed: int | np.random.Generator | None = None,
        **parameters: Any) -> Tracker:
    """Make a tracker by its name, with parameters of its own; errors as `Tracker`."""
    return tracker_class(name)(seed, **parameters)
