"""The demo: three processes on a real bag, every frame accounted for."""

import asyncio
from contextlib import suppress
import itertools
import json
import os
import signal
import subprocess
import sys
import time

import aiohttp
from bag_material import write_short_bag
import cv2
import numpy as np
import pytest
from shared_segments import group, kill, segments

from vtrack_ros.demo.camera_source import images, NoImagesError
from vtrack_ros.demo.demonstration import main, summarise
from vtrack_ros.evaluation.stream_score import figures_table
from vtrack_ros.geometry import Box
from vtrack_ros.ros.recorder import Answer
from vtrack_ros.trackers import Estimate, TrackState

KEYS = {'frames_sent', 'frames_received', 'frames_tracked', 'frames_dropped', 'centre_error_px',
        'mean_iou', 'wrong_tracking', 'ms_per_frame', 'latency_ms_p50', 'latency_ms_p99'}


def demo(repository, *arguments):
    """Run the demo; return the finished process."""
    return subprocess.run(
        [sys.executable, '-m', 'vtrack_ros.demo', *map(str, arguments)], cwd=repository,
        env=dict(os.environ), capture_output=True, text=True, timeout=120)


def test_face_fast(repository, tmp_path):
    """The face is tracked, the figures add up, and the pictures are there."""
    # Slowly enough for a busy machine: the face would be lost with dropped frames.
    out = tmp_path / 'out'
    run = demo(repository, '--out', out, '--json', out / 'figures.json', '--rate', 0.2)
    assert run.returncode == 0, run.stdout + run.stderr
    figures = json.loads((out / 'figures.json').read_text())
    assert set(figures) == KEYS
    assert figures['frames_sent'] == 50
    assert figures['frames_received'] + figures['frames_dropped'] == 50
    assert figures['frames_tracked'] <= figures['frames_received']
    assert figures['mean_iou'] >= 0.5 and figures['centre_error_px'] <= 4
    assert 0 < figures['ms_per_frame'] and 0 < figures['latency_ms_p50'] <= (
        figures['latency_ms_p99'])
    for words in ('frames sent', '50', 'mean IoU', 'ms per frame', 'latency p99'):
        assert words in run.stdout
    sheet = cv2.imread(str(out / 'contact_sheet.png'))
    assert sheet is not None and sheet.shape[1] > 1000
    video = cv2.VideoCapture(str(out / 'video.mp4'))
    assert sum(1 for _ in iter(lambda: video.read()[0], False)) == 50


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGHUP], ids=['Ctrl-C', 'closed'])
def test_interrupted(repository, tmp_path, number):
    """A signal ends all processes: 130, no traceback, no picture of half a run, no memory left."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'vtrack_ros.demo', '--out', str(tmp_path)], cwd=repository,
        env=dict(os.environ), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        start_new_session=True)
    # The first line of progress says that frames are being answered.
    assert 'frames' in process.stderr.readline()
    shared = segments(group(process.pid))
    os.killpg(process.pid, number)
    errors = process.communicate(timeout=60)[1]
    assert 'Traceback' not in errors, errors
    # Ended by the signal itself where it interrupts code from a string: 130 in a shell, too.
    assert process.returncode in (130, -number)
    assert not list(tmp_path.glob('*.mp4')) and not list(tmp_path.glob('*.png'))
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
    # The errors say how each process ended that didn't end cleanly.
    assert shared and not any(one.exists() for one in shared), errors


def test_interrupted_while_it_loads(repository, tmp_path):
    """Ctrl-C during the imports has the same effect: 130, and no traceback."""
    code = ('import signal, sys\n'
            'class Finder:\n'
            '    def find_spec(self, name, *_):\n'
            '        if name == "cv2":\n'
            '            signal.raise_signal(signal.SIGINT)\n'
            'sys.meta_path.insert(0, Finder())\n'
            'sys.argv[1:] = ["--out", sys.argv[1]]\n'
            'import runpy; runpy.run_module("vtrack_ros.demo", run_name="__main__")')
    run = subprocess.run([sys.executable, '-c', code, str(tmp_path)], cwd=repository,
                         env=dict(os.environ), capture_output=True, text=True, timeout=60)
    assert run.returncode == 130
    assert 'Traceback' not in run.stderr, run.stderr


def test_place_that_cannot_be(repository, tmp_path, capsys):
    """An output path that is a file is refused in one line, before anything runs."""
    (tmp_path / 'file').write_text('mine')
    assert main(['--out', str(tmp_path / 'file'),
                 '--bag', str(repository / 'bags' / 'face_fast')]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1 and str(tmp_path / 'file') in error
    assert 'Errno' not in error


def test_untracked_target_is_a_failure(repository, tmp_path, capsys):
    """If the initial box is off the target, the demo fails."""
    bag = write_short_bag(tmp_path / 'bag', repository)
    assert main(['--bag', str(bag), '--out', str(tmp_path / 'out'),
                 '--init-box', '100,70,20,20']) == 1
    assert 'was not tracked' in capsys.readouterr().err


@pytest.mark.parametrize('arguments, words', [
    (['--tracker', 'nobody'], 'gmpf'),
    (['--bag', 'nowhere'], 'nowhere does not exist'),
    (['--seed', '-1'], 'from 0 to'),
    (['--init-box', '1,2,3'], 'X,Y,WIDTH,HEIGHT'),
    (['--topic', '/nothing'], '/nothing'),
    (['--json', 'nowhere/figures.json'], 'no folder'),
    (['--camera', 'film.avi', '--rate', '2', '--json', 'f'], 'combined with --rate, --json'),
])
def test_wrong_arguments(tmp_path, arguments, words, capsys):
    """Wrong arguments end it with code 2, and words that say what's valid."""
    try:
        code = main(['--out', str(tmp_path), *arguments])
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    assert words in capsys.readouterr().err


def test_a_domain_that_is_none(tmp_path, monkeypatch, capsys):
    """What ROS refuses is an error in words, with code 2; Ctrl-C has the effect that it had."""
    monkeypatch.setenv('ROS_DOMAIN_ID', 'seven')
    handler = signal.getsignal(signal.SIGINT)
    assert main(['--out', str(tmp_path)]) == 2
    assert signal.getsignal(signal.SIGINT) is handler
    assert capsys.readouterr().err.splitlines()[-1].startswith('demo: failed to initialize rcl')


def estimate(*box):
    """Return the estimate of a tracked target."""
    return Estimate(Box(*box), 0.0, np.eye(4), 1.0, TrackState.TRACKING)


def test_summary_accounts_for_every_frame():
    """Sent, answered, tracked and dropped add up; a missed target has overlap 0."""
    truth = {1: Box(0, 0, 10, 10), 2: Box(0, 0, 10, 10), 3: None, 4: Box(0, 0, 10, 10)}
    answers = {
        1: Answer(2_000_005, estimate(0, 0, 10, 10), milliseconds=2.0, sent=1_000_005),
        2: Answer(4_000_006, milliseconds=4.0, sent=1_000_006),
        3: Answer(7, estimate(50, 50, 5, 5)),
        4: Answer(state='tracking'),
    }
    assert summarise(answers, truth, sent=6) == pytest.approx({
        'frames_sent': 6, 'frames_received': 3, 'frames_tracked': 2, 'frames_dropped': 3,
        'mean_iou': 0.5, 'centre_error_px': 0.0, 'ms_per_frame': 3.0, 'latency_ms_p50': 2.0,
        'latency_ms_p99': 2.98,
        # Of the two frames that were answered after the first, one has a box but no target.
        'wrong_tracking': 0.5})


def test_summary_without_truth():
    """Without truth there is no error and no overlap."""
    figures = summarise({1: Answer(5, estimate(0, 0, 10, 10))}, {}, sent=1)
    assert [figures[key] for key in ('mean_iou', 'centre_error_px', 'wrong_tracking')] == [
        None, None, None]
    assert 'no truth' in figures_table(figures)


@pytest.mark.parametrize('end', [
    lambda process: os.killpg(process.pid, signal.SIGINT),
    # As `timeout` does, which signals its child and then the whole group.
    lambda process: [process.send_signal(number) for number in (signal.SIGTERM, signal.SIGHUP)]],
    ids=['Ctrl-C', 'terminated'])
def test_camera(repository, tmp_path, end):
    """Without a camera a scene is shown on the page; all processes end, with no memory left."""
    # The page's process prints a warning before the address, as Fast DDS may.
    (tmp_path / 'sitecustomize.py').write_text(
        'import sys\n"select" in sys.orig_argv and print("a warning", file=sys.stderr)\n')
    path = os.pathsep.join((str(tmp_path), os.environ.get('PYTHONPATH', '')))
    process = subprocess.Popen(
        [sys.executable, '-m', 'vtrack_ros.demo', '--camera', '999', '--no-browser', '--out',
         str(tmp_path)], cwd=repository, env={**os.environ, 'PYTHONPATH': path},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
    try:
        assert 'no camera 999' in process.stdout.readline()
        address = process.stdout.readline().split()[-1]

        async def picture():
            async with aiohttp.ClientSession() as session, session.ws_connect(
                    f'{address}ws') as socket:
                while (await socket.receive(60)).type is not aiohttp.WSMsgType.BINARY:
                    pass
        asyncio.run(picture())
        shared = segments(group(process.pid))
        end(process)
        output = process.communicate(timeout=60)[0]
        with pytest.raises(ProcessLookupError):
            os.killpg(process.pid, 0)
    finally:
        # a process that is left would answer the images of other tests
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert process.returncode == 0 and 'Traceback' not in output, output
    # The output says how each process ended that didn't end cleanly.
    assert shared and not any(one.exists() for one in shared), output


@pytest.fixture
def video(tmp_path):
    """Return the path of a video of two images, at 90 Hz."""
    path = tmp_path / 'video.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 90, (64, 48))
    for shade in (40, 200):
        writer.write(np.full((48, 64, 3), shade, np.uint8))
    writer.release()
    return path


def test_video_as_camera(tmp_path, video):
    """A video's images are repeated; a missing file, or one that's no video, is an error."""
    seen = [round(float(image.mean()), -1) for image in itertools.islice(
        images(str(video)), 5)]
    assert seen == [40, 200, 40, 200, 40]
    cv2.imwrite(str(tmp_path / '1.png'), np.full((48, 64, 3), 90, np.uint8))
    assert [image.mean() for image in itertools.islice(
        images(str(tmp_path / '1.png')), 3)] == [90, 90, 90]
    latin = os.fsdecode(b'gr\xfcn.avi')
    for name in ('text.avi', latin):
        (tmp_path / name).write_text('none')
    for name in ('text.avi', latin, 'nowhere.avi'):
        with pytest.raises(NoImagesError, match=name):
            next(images(str(tmp_path / name)))


@pytest.fixture
def camera(video):
    """Start a camera that shows a video; yield its process once it's running."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'vtrack_ros.demo.camera_source', str(video)], env=dict(os.environ),
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
    try:
        while not segments(group(process.pid)):
            assert process.poll() is None
            time.sleep(0.05)
        yield process
    finally:
        kill(process)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=['Ctrl-C', 'terminated'])
def test_a_camera_ends_without_a_word(camera, number):
    """A camera that its terminal or the demo ends has code 0 and prints nothing."""
    camera.send_signal(number)
    assert camera.communicate(timeout=60)[0] == ''
    assert camera.returncode == 0


def test_a_camera_that_is_gone_is_said_so(camera, video):
    """A camera that disappears, as when it's unplugged, is reported in one line, with code 2."""
    video.unlink()
    assert camera.communicate(timeout=60)[0] == f'camera: {video} does not exist\n'
    assert camera.returncode == 2
