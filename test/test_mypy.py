"""The types of the package."""

from pathlib import Path
import subprocess
import sys

import pytest

pytest.importorskip('mypy', reason='needs mypy')

pytestmark = pytest.mark.lint


def test_mypy(repository: Path) -> None:
    """Nothing is found with --strict."""
    run = subprocess.run(
        [sys.executable, '-m', 'mypy', '--strict', 'vtrack_ros'], cwd=repository,
        capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
