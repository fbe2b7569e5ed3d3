"""The style of every Python file, as ament_flake8 checks it."""

from pathlib import Path

import pytest

ament_flake8 = pytest.importorskip('ament_flake8.main', reason='needs ament_flake8')

pytestmark = pytest.mark.lint


def test_flake8(repository: Path) -> None:
    """Nothing is found."""
    code, errors = ament_flake8.main_with_errors(argv=python_paths(repository))
    assert code == 0, f'{len(errors)} style errors:\n' + '\n'.join(errors)


def python_paths(repository: Path) -> list[str]:
    """Return the files and folders with Python code that belong to the package."""
    names = ('setup.py', 'vtrack_ros', 'launch', 'test', 'benchmarks')
    return [str(repository / name) for name in names if (repository / name).exists()]
