"""The documentation as Sphinx builds it."""

from pathlib import Path
import subprocess
import sys

import pytest

pytest.importorskip('sphinx', reason='needs Sphinx')
pytest.importorskip('myst_parser', reason='needs myst-parser')

pytestmark = pytest.mark.lint


def test_sphinx(repository: Path, tmp_path: Path) -> None:
    """There is no warning: each page is in a table of contents, each reference leads somewhere."""
    run = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-W', '--keep-going', '-q', '-b', 'dummy',
         '-d', tmp_path / 'doctrees', repository / 'docs', tmp_path / 'pages'],
        capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
