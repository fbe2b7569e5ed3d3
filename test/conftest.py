"""Shared by all tests: a DDS domain of their own, the real sequences, the repository's files."""

from __future__ import annotations

from collections.abc import Callable
import importlib
import os
from pathlib import Path
import signal
import sys
from types import ModuleType

from hypothesis import settings
import pytest
from vtrack_ros.dds import reserve_domain

REPOSITORY = Path(__file__).resolve().parents[1]

# Before any test module imports NumPy or OpenCV: one thread per worker, as in the node itself.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
os.environ.setdefault('OPENCV_FOR_THREADS_NUM', '1')
# Before any test module imports rclpy.
_domain_guard = reserve_domain()

# A shell starts background jobs with SIGINT ignored, which all child processes would inherit.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# nohup likewise ignores SIGHUP. With a handler that does nothing, it still doesn't end the tests,
# but does end the processes that they start: handlers, unlike ignored signals, aren't inherited.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda *_: None)

# Hypothesis: a few examples, always the same ones, or many others (see CONTRIBUTING.md).
settings.register_profile('quick', derandomize=True, deadline=None, database=None)
settings.register_profile('long', max_examples=6000, deadline=None, database=None)
settings.load_profile(os.environ.get('HYPOTHESIS_PROFILE', 'quick'))


class _Missing:
    """Skips tests that import what isn't installed, and what rosdep doesn't install."""

    def find_spec(self, name: str, *_: object) -> None:
        """Skip the module, or the test; it's called where nothing else finds a package."""
        if name in ('onnx', 'rosbags'):
            pytest.skip(f'needs {name}', allow_module_level=True)


sys.meta_path.append(_Missing())


@pytest.fixture(scope='session')
def repository() -> Path:
    """Return the root of the source tree."""
    return REPOSITORY


@pytest.fixture
def from_benchmarks(repository: Path, monkeypatch: pytest.MonkeyPatch,
                    ) -> Callable[[str], ModuleType]:
    """Return an import of a benchmark's module by its name."""
    monkeypatch.syspath_prepend(repository / 'benchmarks')
    return importlib.import_module


@pytest.fixture(scope='session')
def sequences() -> Path:
    """Return the folder of the real sequences; skip the test where there is none."""
    named = os.environ.get('VTRACK_SEQUENCES')
    folder = Path(named) if named else REPOSITORY.parent / 'shared' / 'sequences'
    if not folder.is_dir():
        where = f'VTRACK_SEQUENCES={named}' if named else '../shared/sequences'
        pytest.skip(f'needs the real sequences: {where} is absent (VTRACK_SEQUENCES names them)')
    return folder


@pytest.fixture
def two_sequences(tmp_path: Path) -> Path:
    """Return a folder of two good sequences, First and Second."""
    # it imports NumPy
    from evaluation_material import write_sequence
    write_sequence(tmp_path / 'data' / 'First')
    write_sequence(tmp_path / 'data' / 'Second', frames=8)
    return tmp_path / 'data'
