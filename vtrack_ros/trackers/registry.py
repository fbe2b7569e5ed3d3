"""
Trackers by name, as every front end offers them: this package's own and other packages'.

This package's own are in `_PRODUCT`, one line each. Other packages add theirs by an entry point of
the group `vtrack_ros.trackers`, whose name is the tracker's and whose value is its class
(docs/adding_a_tracker.md).
"""

from functools import cache
from importlib.metadata import entry_points
import inspect
from typing import Any
import warnings

import numpy as np

from vtrack_ros.parameters import ParameterTable
from vtrack_ros.replicas import REPLICAS
from vtrack_ros.tracker import Tracker
from vtrack_ros.trackers.abmspf import MeanShiftParticleFilter
from vtrack_ros.trackers.appf import AffineParticleFilter
from vtrack_ros.trackers.dcf import CorrelationTracker
from vtrack_ros.trackers.opencv_trackers import OPENCV_TRACKERS
from vtrack_ros.trackers.particle_tracker import (
    GreyParticleFilter, PriorParticleFilter, PrunedQuadratureParticleFilter)

_PRODUCT: tuple[type[Tracker], ...] = (
    GreyParticleFilter,
    PrunedQuadratureParticleFilter,
    MeanShiftParticleFilter,
    AffineParticleFilter,
    PriorParticleFilter,
    CorrelationTracker,
)
_OWN = {cls.NAME: cls for cls in (*_PRODUCT, *OPENCV_TRACKERS, *REPLICAS)}
#: The group of entry points in which other packages name their trackers.
GROUP = 'vtrack_ros.trackers'


def tracker_names(replicas: bool = True, installed: bool = True) -> tuple[str, ...]:
    """
    Return the names of all trackers.

    Without `replicas` those for comparison are left out: the papers', and OpenCV's, which are
    listed whether the installed OpenCV has them or not. Without `installed` other packages' are
    left out.
    """
    return (*(cls.NAME for cls in _PRODUCT), *(_installed() if installed else ()),
            *(cls.NAME for cls in (*OPENCV_TRACKERS, *REPLICAS) if replicas))


def available_peers() -> tuple[str, ...]:
    """Return the names of OpenCV's trackers that the installed one has, and that need no file."""
    return tuple(cls.NAME for cls in OPENCV_TRACKERS if cls.available() and not cls.PARAMETERS)


def tracker_class(name: str) -> type[Tracker]:
    """Return the class of a tracker; the ValueError for an unknown name lists the valid ones."""
    found = _OWN.get(name) or _installed().get(name)
    if found is None:
        raise ValueError(f'unknown tracker {name!r}; valid are ' + ', '.join(tracker_names()))
    return found


def create_tracker(name: str, /, *, seed: int | np.random.Generator | None = None,
                   **parameters: Any) -> Tracker:
    """Make a tracker by its name, with parameters of its own; errors as `Tracker`."""
    return tracker_class(name)(seed, **parameters)


@cache
def _installed() -> dict[str, type[Tracker]]:
    """Return other packages' trackers; one that can't be used is left out, with a warning."""
    found: dict[str, type[Tracker]] = {}
    for entry in entry_points(group=GROUP):
        try:
            cls = entry.load()
            _check(entry.name, cls)
            if found.get(entry.name, cls) is not cls:
                raise ValueError('another package has a tracker of that name')
        # Whatever error another package's module raises, the other trackers must stay available.
        except Exception as error:  # noqa: B902
            warnings.warn(f'tracker {entry.name!r} of {entry.value} is ignored: '
                          f'{type(error).__name__}: {error}', RuntimeWarning, stacklevel=1)
        else:
            found[entry.name] = cls
    return found


def _check(name: str, cls: Any) -> None:
    """Raise TypeError or ValueError if an entry point's value isn't a tracker of that name."""
    if not (isinstance(cls, type) and issubclass(cls, Tracker)) or inspect.isabstract(cls):
        raise TypeError('it is not a subclass of vtrack_ros.tracker.Tracker with all its methods')
    if getattr(cls, 'NAME', None) != name:
        raise ValueError(f"the class's NAME is {getattr(cls, 'NAME', None)!r}")
    if name in _OWN or not name.isidentifier():
        raise ValueError('the name must be an identifier, and not that of another tracker')
    if not isinstance(getattr(cls, 'SUMMARY', None), str):
        raise TypeError('SUMMARY must be a line of text')
    if not isinstance(getattr(cls, 'PARAMETERS', None), ParameterTable):
        raise TypeError('PARAMETERS must be a ParameterTable')
    if 'seed' in cls.PARAMETERS:
        raise ValueError("PARAMETERS must not have a parameter 'seed': every tracker has a seed")
