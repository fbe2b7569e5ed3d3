"""Which packages import which: the contract in .importlinter."""

from pathlib import Path
import subprocess
import sys

import pytest

pytest.importorskip('importlinter', reason='needs import-linter')

pytestmark = pytest.mark.lint

SCRIPT = 'from importlinter.cli import lint_imports_command as main; main()'


def test_import_contract(repository: Path) -> None:
    """Packages import only downwards, and ROS only where it belongs."""
    run = subprocess.run(
        [sys.executable, '-c', SCRIPT, '--no-cache', '--no-logo'], cwd=repository,
        capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
