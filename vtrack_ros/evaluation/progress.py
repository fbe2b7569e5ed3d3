"""A progress bar on a terminal, or a line now and then in a log."""

from __future__ import annotations

import time
from typing import TextIO


class ProgressBar:
    """
    Shows how much is done and how long the rest will take.

    Parameters
    ----------
    stream : file
        Where it's drawn; one that isn't a terminal gets a line for every tenth.
    unit : str
        What is counted.

    """

    def __init__(self, stream: TextIO, unit: str = 'runs') -> None:
        self._stream = stream
        self._unit = unit
        self._live = stream.isatty()
        self._began = time.monotonic()
        self._first = -1
        self._tenth = 0

    def __call__(self, done: int, total: int) -> None:
        """Show that `done` of `total` are done."""
        if self._first < 0:
            self._first = done
        elapsed = time.monotonic() - self._began
        fresh = done - self._first
        left = f', {elapsed / fresh * (total - done):.0f} s left' if 0 < fresh < total else ''
        text = f'{done}/{total} {self._unit}, {elapsed:.0f} s{left}'
        if self._live:
            filled = 30 * done // max(1, total)
            end = '\n' if done == total else ''
            self._stream.write(f'\r[{"#" * filled}{"." * (30 - filled)}] {text}\x1b[K{end}')
        elif done == total or 10 * done // max(1, total) > self._tenth:
            self._tenth = 10 * done // max(1, total)
            self._stream.write(text + '\n')
        self._stream.flush()
