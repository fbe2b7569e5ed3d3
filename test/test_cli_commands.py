"""The command line: what it makes, and its errors for wrong arguments."""

import os
from pathlib import Path
import signal
import subprocess
import sys

from bag_material import write_short_bag
from conftest import REPOSITORY
import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from vtrack_ros.bags import BagError, BagReader, BagWriter  # noqa: E402
from vtrack_ros.bags.importing import record  # noqa: E402
from vtrack_ros.cli.command_line import main  # noqa: E402
from vtrack_ros.scenes import render, scene_names  # noqa: E402
from vtrack_ros.signals import StopRequest  # noqa: E402

COMMANDS = ('synth', 'import', 'play', 'replay', 'evaluate', 'doctor', 'layout', 'select')


def complaint(arguments, capsys):
    """Run a wrong command line; return its only line of output."""
    code = main([str(argument) for argument in arguments])
    printed = capsys.readouterr()
    assert code == 2, printed.err
    assert printed.out == ''
    lines = printed.err.splitlines()
    assert len(lines) == 1, printed.err
    return lines[0]


def test_help(capsys):
    """The overview names every command; each has its own page with examples."""
    assert main(['--help']) == 0
    overview = capsys.readouterr().out
    for name in COMMANDS:
        assert f'\n    {name} ' in overview
        assert main([name, '--help']) == 0
        page = capsys.readouterr().out
        assert page.startswith(f'usage: vtrack {name}')
    for name in ('synth', 'import', 'play', 'replay'):
        main([name, '--help'])
        assert f'  vtrack {name} ' in capsys.readouterr().out


@pytest.mark.parametrize('line, words', [
    ('vtrack re', {'replay'}), ('vtrack synth --f', {'--frames', '--format'})])
def test_completion(tmp_path, line, words):
    """Argcomplete offers commands and options to the shell."""
    pytest.importorskip('argcomplete', reason='needs argcomplete')
    subprocess.run(
        [sys.executable, '-m', 'vtrack_ros.cli.command_line'], check=True, env={
            **os.environ, '_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': '\n', 'COMP_LINE': line,
            'COMP_POINT': str(len(line)), '_ARGCOMPLETE_STDOUT_FILENAME': str(tmp_path / 'said')})
    said = (tmp_path / 'said').read_text()
    assert set(map(str.strip, said.split('\n'))) == words


def test_help_needs_no_heavy_import():
    """The overview imports none of NumPy, OpenCV, rosbags and rclpy."""
    code = ('import sys; from vtrack_ros.cli.command_line import main; main(["--help"]); '
            'sys.exit(bool({"numpy", "cv2", "rosbags", "rclpy"} & set(sys.modules)))')
    assert subprocess.run([sys.executable, '-c', code], stdout=subprocess.DEVNULL).returncode == 0


@pytest.mark.parametrize('module, arguments, hint', [
    ('cv2', ['synth', '--list'],
     'pip install opencv-python-headless, or apt install python3-opencv'),
    ('vision_msgs', ['select'], 'apt install ros-jazzy-vision-msgs, or run scripts/setup')])
def test_a_package_that_is_missing(module, arguments, hint):
    """What installs it is named: not OpenCV's module, nor what neither PyPI nor Ubuntu has."""
    code = (f'import sys; sys.modules[{module!r}] = None; '
            f'from vtrack_ros.cli.command_line import main; sys.exit(main({arguments}))')
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert run.returncode == 1
    assert run.stderr.endswith(f'install it: {hint}\n')


def test_one_thread():
    """Commands compute in one thread, as the node does, which is set before NumPy is loaded."""
    pytest.importorskip('threadpoolctl', reason='needs threadpoolctl')
    code = ('import os; from vtrack_ros.cli.command_line import main; main(["synth", "--list"]); '
            'from threadpoolctl import threadpool_info; '
            'print({pool["num_threads"] for pool in threadpool_info() '
            'if pool["user_api"] == "blas"})')
    environment = {name: value for name, value in os.environ.items() if 'THREADS' not in name}
    run = subprocess.run([sys.executable, '-c', code], env=environment, capture_output=True,
                         text=True, check=True)
    assert run.stdout.splitlines()[-1] == '{1}'


def test_the_node_needs_none_of_the_tools():
    """The node imports neither the tools nor the libraries that only they use."""
    code = 'import sys; import vtrack_ros.ros.main, vtrack_ros.ros.lifecycle; print(*sys.modules)'
    modules = set(subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                                 check=True).stdout.split())
    assert 'vtrack_ros.session' in modules
    assert not modules & {'jinja2', 'matplotlib', 'joblib', 'tqdm', 'threadpoolctl', 'dask',
                          'distributed', 'rosbags'}
    assert not {'bags', 'cli', 'demo', 'evaluation', 'scenes'} & {
        name.split('.')[1] for name in modules if name.startswith('vtrack_ros.')}


@pytest.mark.parametrize('arguments, words', [
    ([], 'synth, import, play, replay'),
    (['sinth'], 'did you mean synth?'),
    (['frobnicate'], 'valid are synth'),
    (['--loud'], 'unknown command'),
    (['synth'], 'face_fast, football'),
    (['synth', 'face_fast'], '--out'),
    (['synth', 'face_slow', '--out', 'x'], 'face_fast, football'),
    (['synth', 'face_fast', '--out', 'x', '--size', '640'], '640x480'),
    (['synth', 'face_fast', '--out', 'x', '--size', '9999x9999'], '1920x1080'),
    (['synth', 'face_fast', '--out', 'x', '--frames', '0'], 'at least 1'),
    (['synth', 'face_fast', '--out', 'x', '--frames', '9' * 400], 'at least 1'),
    (['synth', 'face_fast', '--out', 'x', '--rate', 'nan'], 'a positive number'),
    (['synth', 'face_fast', '--out', 'x', '--seed', '-1'], 'from 0'),
    (['synth', 'face_fast', '--out', 'x', '--format', 'zip'], 'mcap'),
    (['synth', 'face_fast', '--out', 'x', '--colour', 'red'], '--colour'),
    (['synth', 'face_fast', '--out', 'x', '--topic', '/bad topic'], "'/bad topic'"),
    (['synth', 'face_fast', '--out', 'x', '--topic', ''], 'valid topic name'),
    (['synth', 'face_fast', '--out', 'x', '--topic', 'left/', '--compress', 'png'], "'left/'"),
    (['synth', 'face_fast', '--out', 'x', '--topic', 'x' * 240, '--compress', 'png'],
     "x/compressed' is not a valid topic name"),
    (['synth', 'face_fast', '--out', 'x', '--topic', 'truth'], 'is that of the ground truth'),
    (['import', 'pictures'], '--out'),
    (['import', 'no/such/folder', '--out', 'x'], 'does not exist'),
    (['play'], 'BAG'),
    (['play', 'no/such/bag'], 'does not exist'),
    (['doctor', '--seconds', '1e12'], 'from 0 to'),
    (['replay', 'no/such/bag', '--out', 'x'], 'does not exist'),
    (['replay', 'no/such/bag'], 'does not exist'),
    (['replay', 'b', '--tracker', 'magic', '--out', 'x'], 'gmpf'),
    (['replay', 'b', '--tracker', 'pf', '--out', 'x', '--set', 'colour=red'], 'particles'),
    (['replay', 'b', '--tracker', 'pf', '--out', 'x', '--set', 'particles=many'], 'integer'),
    (['replay', 'b', '--tracker', 'pf', '--out', 'x', '--set', 'particles=0'], 'from'),
    (['replay', 'b', '--tracker', 'pf', '--out', 'x', '--set', 'particles'], 'NAME=VALUE'),
    (['replay', 'b', '--tracker', 'pf', '--set', 'gmpf.particles=40'], "'gmpf.particles'"),
    (['replay', 'b', '--out', 'x', '--init', '-1,2,3'], 'X,Y,WIDTH,HEIGHT'),
    (['replay', 'b', '--out', 'x', '--init', '1,2,3'], 'X,Y,WIDTH,HEIGHT'),
    (['replay', 'b', '--out', 'x', '--init', '1,2,3,-4'], 'positive'),
    (['replay', 'b', '--out', 'x', '--init', '1,2,3,nan'], 'finite'),
])
def test_wrong_arguments(arguments, words, tmp_path, monkeypatch, capsys):
    """One line that says what is valid, exit code 2, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    assert words in complaint(arguments, capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('arguments', [
    ['play', REPOSITORY / 'bags' / 'face_fast'], ['select', '--port', '0'], ['doctor']],
    ids=lambda words: words[0])
def test_a_domain_that_is_none(arguments, monkeypatch, capsys):
    """What ROS refuses is an error in one line, with code 1."""
    pytest.importorskip('rclpy', reason='needs rclpy')
    monkeypatch.setenv('ROS_DOMAIN_ID', 'seven')
    assert main(list(map(str, arguments))) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f'vtrack {arguments[0]}: ') and 'ROS_DOMAIN_ID' in line


@pytest.mark.parametrize('command', [['select'], ['layout', 'rviz']])
@pytest.mark.parametrize('name', [
    '', '/', '/arm/', '//tracker', 'arm//tracker', '2nd', '/arm/2nd', '/träcker', 'tracker٣',
    'my tracker', 'tracker\n', 'a' * 60 + '!', '/a' * 60 + '/', '/' + 'a' * 221])
def test_names_that_no_node_has(command, name, capsys):
    """They are refused at once, in one line, however long they are."""
    assert f'the name of a node, such as /tracker, not {name!r}' in complaint(
        [*command, name], capsys)


def test_the_longest_name_of_a_node(capsys):
    """A name is accepted up to the length at which ROS can start a node."""
    name = '/arm/' + 'a' * 216
    assert main(['layout', 'rviz', name]) == 0
    assert f'{name}/debug_image' in capsys.readouterr().out


def test_wrong_bags(tmp_path, repository: Path, capsys):
    """A bag with two image topics asks for --topic, one without truth for --init."""
    picture = np.zeros((20, 30, 3), np.uint8)
    with BagWriter(tmp_path / 'two') as writer:
        for topic in ('/left', '/right'):
            writer.write_frame(picture, 10 ** 9, topic)
    out = ['--out', tmp_path / 'out']
    assert '--topic' in complaint(['replay', tmp_path / 'two', *out], capsys)
    assert '--init' in complaint(['replay', tmp_path / 'two', '--topic', 'left', *out], capsys)
    # as the node would refuse them
    for init, why in (('90,90,5,5', 'no pixel'), ('5,5,1,1', 'at least 2 px'),
                      ('-9,5,12,8', 'centre must be inside')):
        wrong = ['--topic', 'left', '--init', init]
        assert why in complaint(['replay', tmp_path / 'two', *out, *wrong], capsys)


def test_import_to_no_topic(tmp_path, capsys):
    """A topic that ROS doesn't accept, or the truth's, is refused before anything is written."""
    cv2 = pytest.importorskip('cv2')
    cv2.imwrite(str(tmp_path / '1.png'), np.zeros((4, 4, 3), np.uint8))
    arguments = ['import', tmp_path, '--out', tmp_path / 'bag', '--topic']
    assert "'1st' is not a valid topic name" in complaint([*arguments, '1st'], capsys)
    assert '/truth is that of the ground truth' in complaint([*arguments, '/truth'], capsys)
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('rate', ['1e-9', '1e12'])
def test_rates_that_stamps_cannot_have(rate, tmp_path, capsys):
    """The valid rates are named, and nothing is written."""
    for command in (['synth', 'face_fast'], ['import', tmp_path]):
        (tmp_path / '1.png').write_bytes(b'')
        words = complaint([*command, '--out', tmp_path / 'bag', '--rate', rate], capsys)
        assert 'the rate must be from 1e-06 to 1e+06 Hz' in words
        assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('rate', [1e-6, 1e6])
def test_the_lowest_and_the_highest_rate(rate, tmp_path, capsys):
    """Stamps are as far apart as the rate says."""
    assert main(['synth', 'face_fast', '--frames', '3', '--rate', str(rate),
                 '--out', str(tmp_path / 'bag')]) == 0
    with BagReader(tmp_path / 'bag') as bag:
        stamps = [image.stamp for image in bag.frames()]
    assert [late - early for early, late in zip(stamps, stamps[1:])] == 2 * [round(1e9 / rate)]


def test_more_frames_than_there_are_stamps(tmp_path):
    """An error says how many frames a bag can have at such a rate, and no bag is left."""
    frames = ((np.zeros((4, 4), np.uint8), None) for _ in range(3000))
    with pytest.raises(BagError, match='at 1e-06 Hz a bag holds up to 2148 frames'):
        record(frames, tmp_path / 'bag', rate=1e-6)
    assert not (tmp_path / 'bag').exists()


def test_list(capsys):
    """Every scene has a line with its size and length."""
    assert main(['synth', '--list']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(scene_names())
    assert '128x96' in lines[0] and ' 50 frames' in lines[0]


@pytest.mark.parametrize('options, storage', [
    ([], '.mcap'), (['--format', 'sqlite3'], '.db3'), (['--compress', 'png'], '.mcap')])
def test_synth(tmp_path, options, storage, capsys):
    """The bag has the scene's frames at the rate, and its truth; two runs write the same bytes."""
    for name in ('one', 'two'):
        assert main(['synth', 'face_fast', '--out', str(tmp_path / name), '--frames', '5',
                     '--rate', '50', '--seed', '2', '--size', '80x60', *options]) == 0
    with BagReader(tmp_path / 'one') as bag:
        images, truth = list(bag.frames()), bag.truth()
    shots = list(render('face_fast', (80, 60), 5, 2))
    assert len(images) == 5
    for image, shot in zip(images, shots):
        assert np.array_equal(image.frame, shot.frame)
        assert truth[image.stamp].as_array() == pytest.approx(shot.truth.as_array(), abs=1e-9)
    assert np.diff([image.stamp for image in images]).tolist() == [20_000_000] * 4
    files = [next((tmp_path / name).glob('*' + storage)) for name in ('one', 'two')]
    if storage == '.mcap':
        content = [file.read_bytes().replace(b'two.mcap', b'one.mcap') for file in files]
        assert content[0] == content[1]


def test_existing_bag_is_kept(tmp_path, capsys):
    """A path that exists is refused."""
    arguments = ['synth', 'face_fast', '--frames', '1', '--out', str(tmp_path / 'bag')]
    assert main(arguments) == 0
    capsys.readouterr()
    assert main(arguments) == 2
    assert 'exists already' in capsys.readouterr().err


def test_parameters_are_listed(capsys):
    """Each one is listed with its default, range and description."""
    assert main(['replay', '-', '--tracker', 'pf', '--list-parameters']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith('particles = ') and 'integer from' in line for line in lines)


def test_a_box_may_begin_with_a_minus(repository, tmp_path, capsys):
    """A negative number after --init is accepted, with or without an equals sign."""
    results, bag = [], write_short_bag(tmp_path / 'short', repository)
    for box in (['--init', '-10,5,40,30'], ['--init=-10,5,40,30']):
        assert main(['replay', str(bag), '--tracker', 'pf', '--out',
                     str(tmp_path / str(len(results))), '--no-video', *box]) == 0
        results.append((tmp_path / str(len(results)) / 'results.csv').read_bytes())
    assert results[0] == results[1]
    assert b',-10.0,5.0,' in results[0]


def test_a_parameter_may_have_its_node_name(repository, tmp_path, capsys):
    """--set takes a parameter's name with the tracker's prefix, as in the node, or without it."""
    results, bag = [], write_short_bag(tmp_path / 'short', repository)
    for name in ('pf.particles', 'particles'):
        assert main(['replay', str(bag), '--tracker', 'pf', '--set',
                     f'{name}=30', '--out', str(tmp_path / name),
                     '--no-video']) == 0
        results.append((tmp_path / name / 'results.csv').read_bytes())
    assert results[0] == results[1]


def test_places_that_cannot_be(repository, tmp_path, capsys):
    """The path is named in the error, in words instead of an errno."""
    bag = str(repository / 'bags' / 'face_fast')
    (tmp_path / 'file').write_text('mine')
    for arguments in (
            ['synth', 'face_fast', '--frames', '1', '--out', '/proc/nowhere'],
            ['synth', 'face_fast', '--frames', '1', '--out', str(tmp_path / 'file' / 'bag')],
            ['evaluate', '--bags', bag, '--trackers', 'pf', '--html', str(tmp_path)],
            ['evaluate', '--bags', bag, '--trackers', 'pf', '--json', '/proc/nowhere',
             '--no-cache', '--jobs', '1']):
        assert main(arguments) in (1, 2)
        line = capsys.readouterr().err.splitlines()[-1]
        assert line.startswith('vtrack ') and 'Errno' not in line
        assert any(word in line for word in ('/proc/nowhere', str(tmp_path)))
    (tmp_path / 'letters').mkdir()
    assert 'no sequences' in complaint(['evaluate', '--sequences', tmp_path], capsys)


def command(*arguments, **options):
    """Start vtrack in a process of its own."""
    return subprocess.Popen([sys.executable, '-m', 'vtrack_ros.cli.command_line', *arguments],
                            stderr=subprocess.PIPE, text=True, env=dict(os.environ), **options)


def test_interrupted(tmp_path):
    """Ctrl-C: exit code 130, no traceback, no partial bag."""
    process = command('synth', 'face_fast', '--frames', '100000', '--out', str(tmp_path / 'bag'),
                      start_new_session=True)
    # The first line of progress shows that it's running.
    assert 'frames' in process.stderr.readline()
    process.send_signal(signal.SIGINT)
    assert 'Traceback' not in process.communicate(timeout=30)[1]
    # If it interrupts code that a library executes from a string, Python ends itself by the
    # signal, though KeyboardInterrupt was caught: a shell reports 130 for both.
    assert process.returncode in (130, -signal.SIGINT)
    assert list(tmp_path.iterdir()) == []


def test_playing_at_a_rate_of_almost_nothing():
    """The wait for the second image is longer than the system can wait, and ends on request."""
    stop = StopRequest()
    stop.make()
    assert stop.wait(1e300) and stop.wait(float('inf'))


def test_closed_pipe():
    """When the reader closes the pipe, it ends with code 141, without a traceback."""
    read, write = os.pipe()
    os.close(read)
    process = command('synth', '--list', stdout=write)
    os.close(write)
    assert process.communicate(timeout=30)[1] == ''
    assert process.returncode == 141


def test_import_then_replay(tmp_path, capsys):
    """A folder becomes a bag, and the bag a result."""
    cv2 = pytest.importorskip('cv2')
    folder = tmp_path / 'pictures'
    folder.mkdir()
    rows = []
    for shot in render('face_fast', frames=8):
        cv2.imwrite(str(folder / f'{shot.index:03d}.png'), shot.frame)
        rows.append(','.join(f'{value:.2f}' for value in shot.truth.as_array()))
    (folder / 'groundtruth_rect.txt').write_text('\n'.join(rows))
    bag, out = tmp_path / 'bag', tmp_path / 'out'
    assert main(['import', str(folder), '--out', str(bag), '--rate', '10']) == 0
    assert '8 frames at 10 Hz, with ground truth' in capsys.readouterr().out
    assert main(['replay', str(bag), '--tracker', 'pf', '--out', str(out)]) == 0
    assert 'mean IoU' in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {
        'results.csv', 'bag', 'video.mp4', 'contact_sheet.png'}
