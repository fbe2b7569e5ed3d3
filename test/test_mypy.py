"""The types of the package."""

from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip('mypy', reason='needs mypy')

pytestmark = pytest.mark.lint


def test_mypy(repository: Path) -> None:
    """Nothing is found with --strict."""
    if np.lib.NumpyVersion(np.__version__) < '2.5.0':
        pytest.skip('needs the types of NumPy 2.5 (Python 3.12): older ones say less')
    run = subprocess.run(
        [sys.executable, '-m', 'mypy', '--strict', 'vtrack_ros'], cwd=repository,
        capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
