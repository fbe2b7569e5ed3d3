"""Runs kept on disk under a hash of all that they depend on."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
import tempfile
from typing import Any
import zipfile

import cv2
import numpy as np

from vtrack_ros.evaluation.running import Run
from vtrack_ros.evaluation.source import source_hash
from vtrack_ros.evaluation.variants import TrackerVariant

_HARNESS = 'vtrack_ros.evaluation.running'


def default_folder() -> Path:
    """Return where runs are kept: below $XDG_CACHE_HOME, or else ~/.cache."""
    base = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(base) / 'vtrack_ros' / 'runs'


def run_key(variant: TrackerVariant, fingerprint: str, seed: int) -> str:
    """
    Return the hash of all that a run depends on.

    The tracker's name and all its parameters, the source that it's made of, the sequence's
    content, the seed, and the versions of NumPy and OpenCV.
    """
    parts = {
        'tracker': variant.name,
        'parameters': {**variant.tracker_class.PARAMETERS.defaults(), **dict(variant.parameters)},
        'source': source_hash(variant.tracker_class.__module__, _HARNESS),
        'sequence': fingerprint,
        'seed': seed,
        'numpy': np.__version__,
        'opencv': cv2.__version__,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


class RunCache:
    """
    A folder of runs by key.

    Parameters
    ----------
    folder : Path
        Made where it isn't there.

    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def get(self, key: str) -> Run | None:
        """Return the run of that key, marked as cached; None where there's none."""
        path = self._path(key)
        try:
            with np.load(path, allow_pickle=False) as arrays:
                return Run(**arrays, cached=True)
        except FileNotFoundError:
            return None
        except (EOFError, OSError, TypeError, ValueError, zipfile.BadZipFile):
            # Whatever can't be read is run again and overwritten.
            return None

    def put(self, key: str, run: Run) -> None:
        """Keep a run; it appears whole or not at all."""
        path = self._path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            arrays: dict[str, Any] = run.arrays()
            np.savez_compressed(file, **arrays)
        os.replace(file.name, path)

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f'{key}.npz'
