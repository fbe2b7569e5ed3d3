"""A full disk: the error says where, and no partial file is left or replaces anything."""

from contextlib import contextmanager
import resource

from bag_material import write_short_bag
import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from vtrack_ros.bags import BagError, BagWriter  # noqa: E402
from vtrack_ros.cli.command_line import main  # noqa: E402


@contextmanager
def files_of(size):
    """Limit the size of every file, in bytes: the system refuses the rest, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(scope='module')
def results(repository, tmp_path_factory):
    """Return the folder of earlier results, their files, and the command that made them."""
    folder = tmp_path_factory.mktemp('replayed')
    out = folder / 'out'
    command = ['replay', str(write_short_bag(folder / 'bag', repository)), '--tracker', 'dcf',
               '--out', str(out)]
    assert main([*command, '--no-video']) == 0
    return out, contents(out), command


def contents(folder):
    """Return the files below a folder, hidden ones too."""
    return {path: path.read_bytes() for path in folder.rglob('*') if path.is_file()}


# The table alone has some 1 kB, the bag 4 kB, the video 100 kB, the sheet more.
@pytest.mark.parametrize('size', [0, 500, 2500, 30_000, 500_000])
def test_results(results, capsys, size):
    """The earlier results stay, the folder is named, and there is no traceback."""
    out, before, command = results
    with files_of(size):
        assert main(command) == 2
    error = capsys.readouterr().err
    assert f"vtrack replay: can't write {out}: " in error and 'Errno' not in error
    assert contents(out) == before


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_bag(tmp_path, storage):
    """A bag that can't be finished leaves nothing."""
    image = np.random.default_rng(0).integers(0, 256, (200, 200, 3), np.uint8)
    with files_of(100_000), pytest.raises(BagError, match=f"can't write {tmp_path}/new: "):
        with BagWriter(tmp_path / 'new', storage) as writer:
            for number in range(20):
                writer.write_frame(image, 10**9 + number)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('option', ['--json', '--html'])
def test_evaluation(two_sequences, capsys, option):
    """The file that can't be written is named."""
    assert main(['evaluate', '--sequences', str(two_sequences), '--trackers', 'dcf', '--jobs', '1',
                 '--no-cache', option, '/dev/full']) == 2
    assert "can't write /dev/full: No space left" in capsys.readouterr().err
