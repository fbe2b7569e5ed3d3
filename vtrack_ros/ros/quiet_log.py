"""A log that doesn't say the same thing over and over."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any, Protocol

#: The same line comes at most once in that many seconds ...
PERIOD = 2.0
#: ... and no more than that many different ones.
MOST = 30


class Log(Protocol):
    """What `rclpy.node.Node.get_logger` returns."""

    def info(self, message: str) -> Any:
        """Tell."""

    def warning(self, message: str) -> Any:
        """Warn."""

    def error(self, message: str) -> Any:
        """Say that something was wrong."""


class QuietLog:
    """
    Passes a line on unless it was passed on a moment ago.

    A camera that sends thirty broken images a second must not fill a robot's disk.

    Parameters
    ----------
    log : Log
        Where the lines go.
    clock : callable
        Returns the time in seconds.

    """

    def __init__(self, log: Log, clock: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._clock = clock
        self._said: dict[str, float] = {}

    def info(self, text: str) -> None:
        """Tell."""
        if self._is_new(text):
            self._log.info(text)

    def warning(self, text: str) -> None:
        """Warn."""
        if self._is_new(text):
            self._log.warning(text)

    def error(self, text: str) -> None:
        """Say that something was wrong."""
        if self._is_new(text):
            self._log.error(text)

    def _is_new(self, text: str) -> bool:
        now = self._clock()
        self._said = {line: when for line, when in self._said.items() if now - when < PERIOD}
        if text in self._said or len(self._said) >= MOST:
            return False
        self._said[text] = now
        return True
