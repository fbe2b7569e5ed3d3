"""The documentation: its examples run, its links lead somewhere."""

from contextlib import redirect_stdout
import io
from pathlib import Path
import re

import numpy as np
import pytest

from vtrack_ros.localisation.search_window import WindowLayout
from vtrack_ros.scenes import render


@pytest.fixture(scope='module')
def overview(repository: Path) -> dict[str, object]:
    """Return the names that the overview's examples define, and what they printed."""
    text = (repository / 'docs' / 'overview.md').read_text()
    names: dict[str, object] = {}
    with redirect_stdout(io.StringIO()) as output:
        for block in re.findall(r'```python\n(.*?)```', text, re.DOTALL):
            exec(block, names)
    return {**names, 'printed': output.getvalue()}


def test_example_trackers(overview):
    """The trackers of the overview follow a target."""
    overlaps = [float(word) for word in overview['printed'].split()]
    assert len(overlaps) == 2 and min(overlaps) > 0.7


def test_example_cue(overview):
    """The cue of the overview adds to the response where edges are."""
    shot = next(render('pose_change'))
    size = (shot.truth.width, shot.truth.height)
    window = WindowLayout.around(*size).window(shot.frame, shot.truth.center, size)
    plain = overview['TargetModel'].create(window).response(window)
    edges = overview['edge_cue'](window)
    assert edges.shape == plain.shape and edges.max() > 0
    added = overview['EdgeModel'].create(window).response(window) - plain
    assert added == pytest.approx(np.float32(0.05) * edges, abs=1e-6)


def test_links(repository):
    """Every link to a file of the repository has one, at its end."""
    pages = [*repository.glob('*.md'), *(repository / 'docs').rglob('*.md')]
    for page in pages:
        for link in re.findall(r'\]\(([^)#:]+)(?:#[^)]*)?\)', page.read_text()):
            assert (page.parent / link.strip()).exists(), f'{page.name}: {link}'
