"""The demo's three processes: node, player and recorder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import json
import os
from pathlib import Path
import queue
import signal
import subprocess
import sys
import threading
import time
from typing import Any

from vtrack_ros.dds import with_profile

#: How long a process may take to start or to end, in seconds.
PATIENCE = 30.0
#: How long no answer may come after the last frame was sent, in seconds.
SILENCE = 2.0


class DemoError(RuntimeError):
    """A process of the demo didn't do its part; the message says which and what it said."""


class Child:
    """
    A process whose output is read line by line.

    Parameters
    ----------
    name : str
        For messages.
    arguments : sequence of str
        Of this Python interpreter.

    """

    def __init__(self, name: str, arguments: Sequence[str]) -> None:
        self.name = name
        self.lines: queue.Queue[str] = queue.Queue()
        self._log: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, env=with_profile(os.environ))
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def log(self) -> str:
        """Return the lines that weren't protocol."""
        return '\n'.join(self._log)

    @property
    def running(self) -> bool:
        """Return whether the process has not ended."""
        return self.process.poll() is None

    def end(self) -> int:
        """End the process, and return its exit code."""
        if self.running and self.process.stdin is not None:
            self.process.stdin.close()
            if self.name != 'recorder':
                self.process.send_signal(signal.SIGTERM)
        code = self.wait()
        self._reader.join(PATIENCE)
        return code

    def wait(self, patience: float = PATIENCE) -> int:
        """Wait for the process to end by itself, and return its exit code."""
        try:
            return self.process.wait(patience)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise self.failure('did not end') from None

    def failure(self, what: str) -> DemoError:
        """Return an error that quotes the process."""
        return DemoError(f'the {self.name} {what}' + (f':\n{self.log}' if self.log else ''))

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            text = line.rstrip('\n')
            self.lines.put(text)
            if text not in ('ready', 'frame'):
                self._log.append(text)


def run(node: Sequence[str], player: Sequence[str], record: Path,
        answered: Callable[[int], None]) -> tuple[int, dict[int, dict[str, Any]], str]:
    """
    Play a bag to a node, and record what it answers.

    Parameters
    ----------
    node : sequence of str
        The node's ROS arguments.
    player : sequence of str
        The arguments of `vtrack play`.
    record : Path
        Where the recorder leaves its JSON.
    answered : callable
        Called with the number of answered frames, whenever it grows.

    Returns
    -------
    sent : int
        How many frames the player published.
    frames : dict
        The record by stamp.
    log : str
        What the node said.

    Raises
    ------
    DemoError
        If a process fails or doesn't start.

    """
    children: list[Child] = []
    try:
        tracker = Child('node', ['-m', 'vtrack_ros.ros.main', '--ros-args', *node])
        children.append(tracker)
        recorder = Child('recorder', ['-m', 'vtrack_ros.ros.recorder', '--out', str(record)])
        children.append(recorder)
        deadline = time.monotonic() + PATIENCE
        while _next(recorder, 0.1) != 'ready':
            for child in children:
                if not child.running:
                    raise child.failure(f'ended with code {child.wait()}')
            if time.monotonic() > deadline:
                raise recorder.failure('found no node')
        source = Child('player', ['-m', 'vtrack_ros.cli.main', 'play', *player,
                                  '--json', '--wait', str(PATIENCE)])
        children.append(source)
        count = 0
        quiet_since = time.monotonic()
        while source.running or time.monotonic() < quiet_since + SILENCE:
            if _next(recorder, 0.05) == 'frame':
                count += 1
                answered(count)
                quiet_since = time.monotonic()
            if source.running:
                quiet_since = time.monotonic()
            elif count >= _frames_sent(source):
                break
            if not tracker.running:
                raise tracker.failure(f'ended with code {tracker.wait()} while frames came')
        if source.wait():
            raise source.failure(f'ended with code {source.wait()}')
        if recorder.end():
            raise recorder.failure('failed')
        if tracker.end():
            raise tracker.failure('did not end cleanly')
        rows = json.loads(record.read_text())['frames']
        frames = {int(stamp): row for stamp, row in rows.items()}
        return _frames_sent(source), frames, tracker.log
    finally:
        for child in children:
            if child.running:
                child.process.kill()
                child.process.wait()


def _next(child: Child, patience: float) -> str:
    try:
        return child.lines.get(timeout=patience)
    except queue.Empty:
        return ''


def _frames_sent(player: Child) -> int:
    """Return how many images the player says it published."""
    player.end()
    try:
        return int(json.loads(player.log.splitlines()[-1])['images'])
    except (IndexError, KeyError, TypeError, ValueError):
        raise player.failure('did not say how many images it published') from None
