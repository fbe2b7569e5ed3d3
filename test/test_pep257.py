"""The docstrings of every Python file, as ament_pep257 checks them."""

from contextlib import redirect_stderr, redirect_stdout
import io
import logging
from pathlib import Path

import pytest
from test_flake8 import python_paths

ament_pep257 = pytest.importorskip('ament_pep257.main', reason='needs ament_pep257')

pytestmark = pytest.mark.lint


def test_pep257(repository: Path) -> None:
    """Nothing is found."""
    logging.getLogger('pydocstyle.utils').setLevel(logging.WARNING)
    errors = io.StringIO()
    with redirect_stderr(errors), redirect_stdout(io.StringIO()):
        code = ament_pep257.main(argv=python_paths(repository))
    assert code == 0, errors.getvalue()
