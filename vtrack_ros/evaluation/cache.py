"""Runs kept on disk under a hash of all that they depend on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vtrack_ros.evaluation.runner import Run
from vtrack_ros.evaluation.source_hash import source_hash
from vtrack_ros.evaluation.tracker_specification import TrackerSpecification

_RUNNER = 'vtrack_ros.evaluation.runner'


def default_folder() -> Path:
    """Return where runs are kept: below $XDG_CACHE_HOME, or else ~/.cache."""
    base = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(base) / 'vtrack_ros' / 'runs'


def run_key(tracker: TrackerSpecification, fingerprint: str, seed: int) -> str:
    """
    Return the hash of all that a run depends on.

    The tracker's name and all its parameters, the source that it's made of, the sequence's
    content, the seed, and the versions of NumPy and OpenCV.
    """
    parts = {
        'tracker': tracker.name,
        'parameters': {**tracker.tracker_class.PARAMETERS.defaults(), **dict(tracker.parameters)},
        'source': source_hash(tracker.tracker_class.__module__, _RUNNER),
        'sequence': fingerprint,
        'seed': seed,
        'numpy': np.__version__,
        'opencv': cv2.__version__,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


class RunCache:
    """A folder of runs by key, kept by joblib; made where it isn't there."""

    def __init__(self, folder: Path) -> None:
        from joblib import Memory
        self._kept: Any = Memory(folder, verbose=0).cache(_made, ignore=['make'])

    def get(self, key: str) -> Run | None:
        """Return the run of that key, marked as cached; None where none can be read."""
        try:
            run: Run = self._kept(key, _missing)
            return replace(run, cached=True)
        except LookupError:
            return None

    def put(self, key: str, run: Run) -> None:
        """Keep a run."""
        self._kept(key, lambda: run)


def _made(key: str, make: Callable[[], Run]) -> Run:
    return make()


def _missing() -> Run:
    raise LookupError
