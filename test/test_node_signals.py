"""Ending the node by signals."""

import os
import shutil
import signal
import subprocess
import sys
import time

from node_harness import Client, NodeProcess, PATIENCE, Scene, STEP
import pytest
from shared_segments import kill, segments
from vtrack_ros.dds import SHARED_MEMORY

#: Signals that end the node; closing a terminal sends the last one.
ENDING = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.mark.parametrize('number', ENDING)
def test_signal_ends_it_cleanly(number):
    """In mid-stream a signal ends the node with code 0, and no traceback."""
    scene = Scene()
    process = NodeProcess(init_box='[20, 30, 24, 24]', prelude='')
    with Client() as client:
        client.ready()
        client.play(scene, range(3))
        for index in range(3, 8):
            client.send(scene.frame(index), 10**9 + STEP * index, answered=False)
        assert process.stop(number) == 0, process.log
    assert 'Traceback' not in process.log


@pytest.mark.parametrize('number', ENDING)
def test_signal_while_loading(number):
    """A signal that comes while ROS is being loaded ends it as cleanly."""
    process = NodeProcess(prelude='')
    deadline = time.monotonic() + PATIENCE
    while process.process.poll() is None and time.monotonic() < deadline:
        with open(f'/proc/{process.process.pid}/status') as status:
            caught = next(line for line in status if line.startswith('SigCgt')).split()[1]
        if int(caught, 16) >> (number - 1) & 1 and int(caught, 16) >> (signal.SIGTERM - 1) & 1:
            break
        time.sleep(0.01)
    assert process.stop(number) == 0, process.log
    assert 'Traceback' not in process.log


def test_a_node_that_was_started_by_nohup_outlives_the_terminal():
    """A node that is started with SIGHUP ignored goes on tracking after that signal."""
    scene = Scene()
    process = NodeProcess(prelude='import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)',
                          init_box='[20, 30, 24, 24]')
    with process, Client() as client:
        client.ready()
        client.play(scene, range(3))
        process.process.send_signal(signal.SIGHUP)
        client.play(scene, range(3, 6))


@pytest.fixture
def hanging(tmp_path):
    """Return an environment in which the middleware hangs when a node is destroyed."""
    if not shutil.which('cc'):
        pytest.skip('needs a C compiler')
    library = tmp_path / 'hanging.so'
    source = ('#include <unistd.h>\n'
              'int rmw_destroy_node(void *node) { for (;;) pause(); }')
    subprocess.run(['cc', '-shared', '-fPIC', '-x', 'c', '-', '-o', library], input=source,
                   text=True, check=True)
    return {**os.environ, 'LD_PRELOAD': str(library)}


@pytest.mark.parametrize('program, code', [
    (['ros.main'], 0), (['cli.command_line', 'play', 'bags/face_fast'], 128 + signal.SIGINT)],
    ids=['node', 'player'])
def test_a_middleware_that_hangs_does_not_keep_it(hanging, repository, program, code):
    """If the middleware hangs, the process ends all the same, and frees its shared memory."""
    process = subprocess.Popen(
        [sys.executable, '-m', f'vtrack_ros.{program[0]}', *program[1:]], cwd=repository,
        env=hanging, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        # The first line is printed once it runs.
        process.stdout.readline()
        shared = segments([process.pid])
        process.send_signal(signal.SIGINT)
        output = process.communicate(timeout=PATIENCE)[0]
    finally:
        kill(process)
    assert process.returncode == code and 'Traceback' not in output, output
    assert shared and not any(one.exists() for one in shared)
    assert not any((SHARED_MEMORY / f'{one.name}_el').exists() for one in shared)
