"""Ending the node."""

import signal
import time

from node_harness import Client, NodeProcess, PATIENCE, Scene, STEP
import pytest

#: The last one is a closed terminal's.
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


def test_who_was_started_by_nohup_outlives_the_terminal():
    """What ignores a closed terminal from the start goes on doing so."""
    scene = Scene()
    process = NodeProcess(prelude='import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)',
                          init_box='[20, 30, 24, 24]')
    with process, Client() as client:
        client.ready()
        client.play(scene, range(3))
        process.process.send_signal(signal.SIGHUP)
        client.play(scene, range(3, 6))
