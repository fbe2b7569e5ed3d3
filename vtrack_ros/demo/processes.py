"""The demo's processes: a node, a player, and a recorder in this one."""

from collections.abc import Callable, Sequence
import json
from pathlib import Path
import signal
import subprocess
import sys
import time

from vtrack_ros.dds import give_memory_back
from vtrack_ros.ros.recorder import Answer, Recorder
from vtrack_ros.signals import handling_signals

#: Time-out for a process to start, or to end by itself, in seconds.
PROCESS_TIMEOUT = 30.0
#: Time-out of terminated processes, after which they are killed, in seconds.
KILL_TIMEOUT = 5.0
#: Exit codes of a process that ended as it was told to: 0, 128 + the signal's number, or minus the
#: number if it had no handler for it yet.
_ENDED_WELL = (0, *(code for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
                    for code in (-number, 128 + number)))
#: Time-out without any answer after the last frame was sent, in seconds.
ANSWER_TIMEOUT = 2.0


class DemoError(RuntimeError):
    """A process of the demo failed; the message says which, and quotes its log."""


class Child:
    """A child process of this Python interpreter, with a name for messages and a log file."""

    def __init__(self, name: str, log: Path, *arguments: str) -> None:
        self._name, self._log, self._blamed = name, log, False
        with log.open('w') as file:
            self._process = subprocess.Popen(
                [sys.executable, '-m', *arguments], stdout=file, stderr=subprocess.STDOUT)

    @property
    def running(self) -> bool:
        """Return whether the process has not ended."""
        return self._process.poll() is None

    @property
    def said(self) -> str:
        """Return what's in the log."""
        return self._log.read_text().strip()

    def check(self) -> None:
        """Raise DemoError if the process has ended."""
        if not self.running:
            raise self.failure(f'ended with code {self._process.returncode}')

    def wait(self) -> None:
        """Wait until it ends by itself; raise DemoError at a time-out or a non-zero exit code."""
        try:
            code = self._process.wait(PROCESS_TIMEOUT)
        except subprocess.TimeoutExpired:
            raise self.failure('did not end') from None
        if code:
            raise self.failure(f'ended with code {code}')

    def terminate(self) -> None:
        """Send SIGTERM."""
        self._process.terminate()

    def kill(self, patience: float) -> DemoError | None:
        """Wait, and kill it after `patience` seconds; return an error if not reported before."""
        try:
            code = self._process.wait(patience)
        except subprocess.TimeoutExpired:
            give_memory_back(self._process.pid)
            return self.failure('did not end on request, and was killed')
        finally:
            self._process.kill()
            self._process.wait()
        if self._blamed or code in _ENDED_WELL:
            return None
        return self.failure(f'ended with code {code}')

    def failure(self, what: str) -> DemoError:
        """Return an error that quotes the process's log, and mark it as reported."""
        self._blamed = True
        return DemoError(f'the {self._name} {what}' + (f':\n{self.said}' if self.said else ''))


def end_all(children: Sequence[Child]) -> None:
    """
    Terminate all processes, and kill them only at a time-out, removing their shared memory.

    Errors at their ends are printed on standard error, unless they were reported before.
    """
    # Signals are ignored meanwhile: a second one must not leave processes running.
    with handling_signals(lambda *_: None):
        for child in children:
            child.terminate()
        deadline = time.monotonic() + KILL_TIMEOUT
        for child in children:
            if wrong := child.kill(max(0.0, deadline - time.monotonic())):
                print(wrong, file=sys.stderr, flush=True)


def run(node: Sequence[str], player: Sequence[str], folder: Path,
        answered: Callable[[int], None]) -> tuple[int, dict[int, Answer]]:
    """
    Play a bag to a node, and record its answers.

    Takes the node's ROS arguments and those of `vtrack play`, and a folder for the processes'
    logs; `answered` is called with the number of answered frames, whenever it grows. Returns the
    number of frames that the player published, and the answers by the stamps of the images in
    nanoseconds; DemoError if a process fails or doesn't start.
    """
    children = [Child('node', folder / 'node.log', 'vtrack_ros.ros.main', '--ros-args', *node)]
    try:
        with Recorder() as recorder:
            deadline = time.monotonic() + PROCESS_TIMEOUT
            while not recorder.matched:
                recorder.listen(0.05)
                children[0].check()
                if time.monotonic() > deadline:
                    raise children[0].failure('was not found')
            children.append(Child(
                'player', folder / 'player.log', 'vtrack_ros.cli.command_line', 'play', *player,
                '--json', '--wait', str(PROCESS_TIMEOUT)))
            count, sent, quiet_since = 0, None, time.monotonic()
            while sent is None or (
                    count < sent and time.monotonic() < quiet_since + ANSWER_TIMEOUT):
                recorder.listen(0.05)
                children[0].check()
                if recorder.received > count:
                    answered(count := recorder.received)
                    quiet_since = time.monotonic()
                if sent is None and not children[1].running:
                    sent, quiet_since = _frames_sent(children[1]), time.monotonic()
        children[0].terminate()
        children[0].wait()
        return sent, recorder.answers
    finally:
        end_all(children)


def _frames_sent(player: Child) -> int:
    player.wait()
    try:
        return int(json.loads(player.said.splitlines()[-1])['images'])
    except (IndexError, KeyError, TypeError, ValueError):
        raise player.failure('did not say how many images it published') from None
