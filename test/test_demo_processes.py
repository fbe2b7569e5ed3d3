"""The demo's processes: how they end, and what is reported."""

import os
import signal
import textwrap

import pytest
from shared_segments import segments

from vtrack_ros.demo import processes
from vtrack_ros.demo.processes import Child, DemoError, end_all


@pytest.fixture
def child(tmp_path, monkeypatch):
    """Return a function that starts a child with some code, and waits until that runs."""
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))

    def make(code):
        (tmp_path / 'lines.py').write_text(
            'import os, signal, time\n' + textwrap.dedent(code)
            + 'print("here", flush=True)\ntime.sleep(60)\n')
        made = Child('worker', tmp_path / 'log', 'lines')
        while made.running and 'here' not in made.said:
            os.sched_yield()
        return made
    return make


def test_children_that_end_well_are_not_spoken_of(child, capsys):
    """A child that ends by SIGTERM, or cleanly after it, isn't reported."""
    end_all([child(''), child('signal.signal(signal.SIGTERM, lambda *_: os._exit(0))\n')])
    assert capsys.readouterr().err == ''


def test_a_crash_at_the_end_is_said(child, capsys):
    """A child that crashes at SIGTERM is reported, with its exit code and its log."""
    end_all([child('signal.signal(signal.SIGTERM, lambda *_: os.abort())\n')])
    error = capsys.readouterr().err
    assert f'the worker ended with code {-signal.SIGABRT}:\nhere' in error


def test_a_process_that_ignores_sigterm_is_killed_and_named(child, capsys, monkeypatch):
    """A child that ignores SIGTERM is killed after a time-out, and reported."""
    monkeypatch.setattr(processes, 'KILL_TIMEOUT', 0.2)
    deaf = child('signal.signal(signal.SIGTERM, signal.SIG_IGN)\n')
    end_all([deaf])
    assert not deaf.running
    assert 'the worker did not end on request, and was killed' in capsys.readouterr().err


def test_a_killed_process_leaves_no_memory(child):
    """A node that ignores SIGTERM is killed, and its shared memory is freed."""
    deaf = child('import rclpy\n'
                 'rclpy.init()\n'
                 'node = rclpy.create_node("deaf")\n'
                 'signal.signal(signal.SIGTERM, signal.SIG_IGN)\n'
                 'print(os.getpid())\n')
    shared = segments([int(deaf.said.split()[-2])])
    assert deaf.kill(0.0) is not None
    assert shared and not any(one.exists() for one in shared)


def test_a_failure_is_said_once(child, capsys):
    """A failure that `check` has raised isn't reported again."""
    broken = child('raise SystemExit(3)\n')
    with pytest.raises(DemoError, match='ended with code 3'):
        broken.check()
    end_all([broken])
    assert capsys.readouterr().err == ''
