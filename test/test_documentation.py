"""The documentation: its examples run, its links lead somewhere."""

from contextlib import redirect_stdout
import io
from pathlib import Path
import re
import textwrap
from types import SimpleNamespace as Of
from typing import Any

from builtin_interfaces.msg import Time
import numpy as np
import pytest
from std_msgs.msg import Header

from vtrack_ros.geometry import Box
from vtrack_ros.localisation.search_window import WindowLayout
from vtrack_ros.messages.selections import best_detection
from vtrack_ros.scenes import render


@pytest.fixture(scope='module')
def examples(repository: Path) -> dict[str, object]:
    """Return the names that the examples of adding_a_tracker.md define, and what they printed."""
    text = (repository / 'docs' / 'adding_a_tracker.md').read_text()
    names: dict[str, object] = {}
    with redirect_stdout(io.StringIO()) as output:
        for block in re.findall(r'```python\n(.*?)```', text, re.DOTALL):
            exec(block, names)
    return {**names, 'printed': output.getvalue()}


def test_example_trackers(examples):
    """The example trackers follow a target."""
    words = examples['printed'].split()
    assert words[::2] == ['broad', 'steady', 'edges'] and min(map(float, words[1::2])) > 0.7


def test_example_cue(examples):
    """The example cue adds to the response where edges are, in its tracker too."""
    shot = next(render('pose_change'))
    size = (shot.truth.width, shot.truth.height)
    window = WindowLayout.around(*size).window(shot.frame, shot.truth.center, size)
    plain = examples['TargetModel'].create(window).response(window)
    edges = examples['edge_cue'](window)
    assert edges.shape == plain.shape and edges.max() > 0
    added = examples['EdgeModel'].create(window).response(window) - plain
    assert added == pytest.approx(np.float32(0.05) * edges, abs=1e-6)
    center = shot.truth.center
    plain, preferred = (
        examples[name](shot.frame, center, size, np.random.default_rng(0)).localise(
            shot.frame, center).values for name in ('Localiser', 'EdgeLocaliser'))
    assert (preferred >= plain).all() and (preferred > plain).any()


def test_example_files(repository):
    """The page shows the example's files as they are; they have fewer than 60 lines in all."""
    page = (repository / 'docs' / 'adding_a_tracker.md').read_text()
    texts = [(repository / 'docs' / 'examples' / 'steady_tracker' / name).read_text()
             for name in ('steady_tracker.py', 'pyproject.toml')]
    assert all(f'\n{text}```' in page for text in texts)
    assert sum(len(text.splitlines()) for text in texts) < 60


def test_yolo_detections(repository):
    """The example converts yolo_msgs to vision_msgs, and its page shows it as it is."""
    text = (repository / 'docs' / 'examples' / 'yolo_detections.py').read_text()
    assert f'```python\n{text}```' in (repository / 'docs' / 'detector.md').read_text()
    names: dict[str, Any] = {'__name__': 'example'}
    exec(text, names)
    center = Of(position=Of(x=40.0, y=30.0), theta=0.0)
    one = Of(class_id=3, class_name='dog', score=0.75, id='7',
             bbox=Of(center=center, size=Of(x=20.0, y=10.0)))
    header = Header(stamp=Time(sec=5), frame_id='camera')
    found = best_detection(
        names['converted'](Of(header=header, detections=[one])), 'dog', 0.5, 'detector')
    assert found.box == Box(30, 25, 20, 10)
    assert (found.stamp, found.class_id, found.target_id) == (5 * 10**9, 'dog', '7')


def test_readme_example(repository):
    """The Python example in README starts a tracker and follows the target."""
    text = (repository / 'README.md').read_text()
    [block] = re.findall(r'(?:^    (?:from|tracker|estimate) .*\n|^    tracker\..*\n)+', text,
                         re.MULTILINE)
    first, second, *_ = render('face_fast', frames=2)
    names = {'frame': first.frame, 'next_frame': second.frame,
             **{name: getattr(first.truth, name) for name in ('x', 'y', 'width', 'height')}}
    exec(textwrap.dedent(block), names)
    assert names['estimate'].box.iou(second.truth) > 0.6
    assert all(hasattr(names['estimate'], word)
               for word in ('state', 'confidence', 'covariance', 'angle'))


def test_links(repository):
    """Every link to a file of the repository is to one that exists."""
    pages = [*repository.glob('*.md'), *(repository / 'docs').rglob('*.md')]
    for page in pages:
        for link in re.findall(r'\]\(([^)#:]+)(?:#[^)]*)?\)', page.read_text()):
            assert (page.parent / link.strip()).exists(), f'{page.name}: {link}'


def test_decisions(repository):
    """Decisions have unique numbers, and those that are referred to exist."""
    text = (repository / 'docs' / 'decisions.md').read_text()
    numbers = re.findall(r'^### (\d+)\. ', text, re.MULTILINE)
    assert len(set(numbers)) == len(numbers)
    for page in (*repository.glob('*.md'), *(repository / 'docs').rglob('*.md')):
        for one, other in re.findall(r'decisions? (\d+)(?: and (\d+))?', page.read_text()):
            assert {one, other or one} <= {*numbers}, page.name
