"""A cache of runs on disk, under a hash of all that they depend on."""

import ast
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
import hashlib
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec, resolve_name
import json
import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vtrack_ros.evaluation.runner import Run
from vtrack_ros.evaluation.tracker_specification import TrackerSpecification
from vtrack_ros.tracker import Tracker

_PACKAGE = __name__.partition('.')[0]
_ROOT = Path(__file__).resolve().parents[1]
_RUNNER = f'{_PACKAGE}.evaluation.runner'
#: Version of the cache; runs stored under another version are ignored. Some runs of versions 1 and
#: 2 are of the wrong frames, where a folder's or a bag's images had been cut in several ways.
_VERSION = 3


def default_folder() -> Path:
    """Return where runs are kept: below $XDG_CACHE_HOME, or else ~/.cache."""
    base = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(base) / 'vtrack_ros' / 'runs'


def tracker_source(tracker: TrackerSpecification) -> str:
    """
    Return the hash of a tracker's and the runner's source, and of files in parameters.

    The tracker's is that of its class and of the trackers that this is derived from: one of
    another package may be derived from one of a third package, or of another module.
    """
    classes = (one for one in tracker.tracker_class.__mro__ if issubclass(one, Tracker))
    source = source_hash(*(one.__module__ for one in classes), _RUNNER)
    # A path says nothing of the weights in a network's file.
    files = [Path(value) for _, value in tracker.parameters
             if isinstance(value, str) and Path(value).is_file()]
    if not files:
        return source
    digest = hashlib.sha256(source.encode())
    for path in files:
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def run_key(tracker: TrackerSpecification, source: str, fingerprint: str, seed: int) -> str:
    """
    Return the hash of all that a run depends on.

    These are the tracker's name and all its parameters, its source and files (`tracker_source`),
    the sequence's content, the seed, and the versions of NumPy and OpenCV.
    """
    parts = {
        'version': _VERSION,
        'tracker': tracker.name,
        'parameters': tracker.values,
        'source': source,
        'sequence': fingerprint,
        'seed': seed,
        'numpy': np.__version__,
        'opencv': cv2.__version__,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


class RunCache:
    """A folder of runs by key, stored by joblib; created if it doesn't exist."""

    def __init__(self, folder: Path) -> None:
        from joblib import Memory
        self._kept: Any = Memory(folder, verbose=0).cache(_made, ignore=['make'])

    def get(self, key: str) -> Run | None:
        """Return the run of that key, marked as cached; None if none can be read."""
        try:
            run: Run = self._kept(key, _missing)
            return replace(run, cached=True)
        except LookupError:
            return None

    def put(self, key: str, run: Run) -> None:
        """Store a run."""
        self._kept(key, lambda: run)


def _made(key: str, make: Callable[[], Run]) -> Run:
    return make()


def _missing() -> Run:
    raise LookupError


def source_hash(*modules: str) -> str:
    """
    Return a hash of the source of modules and of all that they import from their own packages.

    A module's parent packages aren't included unless they are imported by name, so that a
    tracker's hash doesn't change with another tracker's source.
    """
    digest = hashlib.sha256()
    for name, path in sorted(source_files(*modules).items()):
        digest.update(name.encode() + b'\0' + path.read_bytes() + b'\0')
    return digest.hexdigest()


def source_files(*modules: str) -> dict[str, Path]:
    """
    Return module -> file that `source_hash` reads; ModuleNotFoundError if one given has none.

    Imports without a file are left out: namespace packages, and what need not be installed.
    """
    found: dict[str, Path] = {}
    waiting = list(modules)
    # The source of another package's tracker is in that package and in this one.
    packages = frozenset((_PACKAGE, *(name.partition('.')[0] for name in modules)))
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        path = _module_file(name)
        if path is None:
            if name in modules:
                raise ModuleNotFoundError(f'no module named {name!r}', name=name)
            continue
        found[name] = path
        package = name if path.name == '__init__.py' else name.rpartition('.')[0]
        if path.suffix == '.py':
            waiting.extend(_imports(path.read_bytes(), package, packages))
    return found


@lru_cache(maxsize=1000)
def _imports(source: bytes, package: str, packages: frozenset[str]) -> tuple[str, ...]:
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.extend(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = resolve_name('.' * node.level + (node.module or ''), package)
            if base.partition('.')[0] not in packages:
                continue
            inner = [f'{base}.{alias.name}' for alias in node.names]
            modules = [name for name in inner if _module_file(name)]
            # `from package import module` needs the package only for names that aren't modules.
            names.extend(modules if len(modules) == len(inner) else [*modules, base])
    return tuple(name for name in names if name.partition('.')[0] in packages)


def _module_file(name: str) -> Path | None:
    package, *parts = name.split('.')
    for place in _places(package):
        place = place.joinpath(*parts)
        for path in (place / '__init__.py', *(
                place.with_name(place.name + suffix) for suffix in ('.py', *EXTENSION_SUFFIXES))):
            if path.is_file():
                return path
    return None


@lru_cache
def _places(package: str) -> tuple[Path, ...]:
    """Return the folder of a package, several of a namespace's, or a module without its suffix."""
    if package == _PACKAGE:
        return (_ROOT,)
    spec = find_spec(package)
    if spec is not None and spec.submodule_search_locations is not None:
        return tuple(map(Path, spec.submodule_search_locations))
    if spec is None or not spec.has_location or spec.origin is None:
        return ()
    return (Path(spec.origin).parent / package,)
