"""The style of every Python file, as ament_flake8 and ament_pep257 check it."""

from importlib.resources import files
from pathlib import Path
import subprocess
import sys

import pytest

pytest.importorskip('ament_flake8', reason='needs ament_flake8')

pytestmark = pytest.mark.lint

# Syntax trees have few cycles: without the garbage collector, which would visit all, it's faster.
SCRIPT = 'import gc, sys; gc.disable(); from ament_flake8.main import main; sys.exit(main())'


def test_flake8(repository: Path, tmp_path: Path) -> None:
    """Neither flake8 nor pydocstyle finds anything."""
    # With this line flake8 finds in docstrings what ament_pep257 finds: both ignore the same codes
    # of pydocstyle. Each file is read once then.
    official = files('ament_flake8') / 'configuration' / 'ament_flake8.ini'
    config = tmp_path / 'flake8.ini'
    config.write_text(official.read_text() + '\ndocstring-convention = all\n')
    # In its own process: flake8 forks, which isn't safe with the threads of earlier tests' nodes.
    run = subprocess.run(
        [sys.executable, '-c', SCRIPT, *python_paths(repository), '--config', str(config)],
        capture_output=True, text=True)
    errors = run.stdout.partition('Checked files:')[0] + run.stderr
    assert run.returncode == 0, errors


def python_paths(repository: Path) -> list[str]:
    """Return the files and folders with Python code that belong to the package."""
    names = ('setup.py', 'vtrack_ros', 'launch', 'test', 'benchmarks')
    return [str(repository / name) for name in names if (repository / name).exists()]
