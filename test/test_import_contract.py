"""Which packages import which (the contract in .importlinter), and unique names."""

from collections import Counter
from pathlib import Path
import re
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


def test_names(repository: Path) -> None:
    """Names of modules and classes are unique in the whole package."""
    paths = [path for path in (repository / 'vtrack_ros').rglob('*.py')
             if path.stem not in ('__init__', '__main__')]
    classes = [name for path in paths
               for name in re.findall(r'^class (\w+)', path.read_text(), re.MULTILINE)]
    names = Counter([path.stem for path in paths]) + Counter(classes)
    assert [name for name, count in names.items() if count > 1] == []
