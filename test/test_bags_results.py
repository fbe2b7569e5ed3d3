"""A replay's folder: it replaces earlier results, on success only, and nothing else."""

import json
import shutil

from bag_material import write_short_bag
import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from vtrack_ros.bags import BagReader, BagWriter  # noqa: E402
from vtrack_ros.cli.command_line import main  # noqa: E402

OURS = {'results.csv', 'bag', 'video.mp4', 'contact_sheet.png'}


def contents(folder):
    """Return the path and the bytes of every file below a folder."""
    return {path.relative_to(folder): path.read_bytes()
            for path in sorted(folder.rglob('*')) if path.is_file()}


@pytest.fixture
def bag(repository, tmp_path):
    """Return a short bag, in a folder where a replay's bag would go."""
    return write_short_bag(tmp_path / 'work' / 'bag', repository)


def replay(bag, out, *options):
    """Replay with a fast tracker; return the exit code."""
    return main(['replay', str(bag), '--tracker', 'pf', '--out', str(out), *options])


@pytest.mark.parametrize('read, place', [
    ('.', '.'), ('.', '../work'), ('.', 'bag'), ('bag.mcap', '.')])
def test_its_own_input_is_kept(bag, read, place, capsys):
    """A folder whose result bag would be, hold or lie in the input is refused."""
    before = contents(bag.parent)
    assert replay(bag / read, bag.parent / place, '--no-video') == 2
    assert 'the bag that is read' in capsys.readouterr().err
    assert contents(bag.parent) == before


@pytest.mark.parametrize('make', [
    lambda out: BagWriter(out / 'bag').__enter__().__exit__(None, None, None),
    lambda out: (out / 'bag').mkdir(),
    lambda out: (out / 'results.csv').write_text('name,mark\nmine,1\n'),
    lambda out: (out / 'video.mp4').write_bytes(b'my holiday'),
    lambda out: (out / 'bag').write_text('a file'),
])
def test_what_is_not_ours_is_kept(bag, tmp_path, make, capsys):
    """Other people's files of the same names are neither replaced nor removed."""
    out = tmp_path / 'out'
    out.mkdir()
    make(out)
    before = contents(out)
    for options in ([], ['--no-video']):
        assert replay(bag, out, *options) == 2
        assert 'exists already' in capsys.readouterr().err
        assert contents(out) == before


@pytest.mark.parametrize('options', [[], ['--no-video']])
@pytest.mark.parametrize('name', ['video.mp4', 'contact_sheet.png'])
def test_pictures_beside_results_are_kept(bag, tmp_path, name, options, capsys):
    """A picture or video that was put beside a replay's results, or in their place, is kept."""
    out = tmp_path / 'out'
    assert replay(bag, out, *options) == 0
    (out / name).write_bytes(b'my holiday')
    before = contents(out)
    for again in ([], ['--no-video']):
        assert replay(bag, out, *again) == 2
        assert f"{name} exists already and isn't the result" in capsys.readouterr().err
        assert contents(out) == before


def test_other_bags_and_notes_are_kept(bag, tmp_path, capsys):
    """A result bag with a file added, or a bag of images in its place, isn't ours, and is kept."""
    out = tmp_path / 'out'
    assert replay(bag, out, '--no-video') == 0
    (out / 'bag' / 'notes.txt').write_text('looked at on Monday')
    before = contents(out)
    assert replay(bag, out) == 2
    shutil.rmtree(out / 'bag')
    with BagWriter(out / 'bag') as writer:
        writer.write_frame(np.zeros((4, 4), np.uint8), 10 ** 9)
    assert replay(bag, out) == 2
    assert 'exists already' in capsys.readouterr().err
    assert (out / 'results.csv').read_bytes() == before[(out / 'results.csv').relative_to(out)]
    with BagReader(out / 'bag') as kept:
        assert list(kept.topics) == ['/image']


def test_results_stay_until_there_are_new_ones(bag, tmp_path, capsys):
    """A run that fails leaves the earlier results as they were; other files are never touched."""
    out = tmp_path / 'out'
    assert replay(bag, out) == 0
    (out / 'notes.txt').write_text('mine')
    before = contents(out)
    assert replay(bag, out, '--init', '900,900,5,5') == 2
    assert contents(out) == before
    assert replay(bag, tmp_path / 'fresh', '--init', '900,900,5,5') == 2
    assert not (tmp_path / 'fresh').exists()
    assert {path.name for path in out.iterdir()} == OURS | {'notes.txt'}


def test_pictures_of_another_run_go(bag, tmp_path, capsys):
    """A run without pictures removes those of the previous run."""
    out = tmp_path / 'out'
    assert replay(bag, out) == 0
    assert replay(bag, out, '--no-video', '--seed', '3') == 0
    assert {path.name for path in out.iterdir()} == {'results.csv', 'bag'}
    assert replay(bag, out) == 0
    assert {path.name for path in out.iterdir()} == OURS


def test_figures_alone(bag, tmp_path, monkeypatch, capsys):
    """Without a folder for results the figures are printed, and no file is written."""
    monkeypatch.chdir(tmp_path)
    before = contents(tmp_path)
    assert main(['replay', str(bag), '--tracker', 'pf', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['frames'] == 10
    assert contents(tmp_path) == before


@pytest.mark.parametrize('place', ['file', 'file/below', '/proc/nowhere'])
def test_place_that_cannot_be(bag, tmp_path, place, capsys):
    """The path is named in the error, in words instead of an errno."""
    (tmp_path / 'file').write_text('mine')
    assert replay(bag, tmp_path / place) == 2
    error = capsys.readouterr().err
    assert str(tmp_path / place) in error and 'Errno' not in error
    assert (tmp_path / 'file').read_text() == 'mine'


def test_no_image_that_can_be_read(bag, tmp_path, capsys):
    """A bag without a readable image gives an error, and no results."""
    from vtrack_ros.bags import messages
    torn = tmp_path / 'torn'
    with BagWriter(torn) as writer:
        message = messages.image(np.zeros((4, 4), np.uint8), 10 ** 9, 'eye')
        message.data = message.data[:-1]
        writer.write('/image', message, 10 ** 9)
    assert replay(torn, tmp_path / 'out', '--init', '0,0,2,2') == 2
    assert 'image 0 of /image' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()
