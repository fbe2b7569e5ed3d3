"""Requests to end a program, which signals make."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import queue
import signal
from threading import TIMEOUT_MAX
from types import FrameType


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return SIGINT, SIGTERM, and SIGHUP (closed terminal) unless ignored, as by `nohup`."""
    asked = signal.SIGINT, signal.SIGTERM
    return asked if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (*asked, signal.SIGHUP)


@contextmanager
def handling_signals(handler: Callable[[int, FrameType | None], object],
                     numbers: Sequence[signal.Signals] | None = None) -> Iterator[None]:
    """Install a handler for `ending_signals`, or those given; on exit the earlier is restored."""
    earlier = {number: signal.signal(number, handler)
               for number in (ending_signals() if numbers is None else numbers)}
    try:
        yield
    finally:
        for number, one in earlier.items():
            signal.signal(number, one)


class StopRequest:
    """
    A request to stop that can be waited for, like `threading.Event`, but safe in signal handlers.

    The lock of a `threading.Event` may be held by the code that a handler interrupts, which may
    even be another handler.
    """

    def __init__(self) -> None:
        self._requests: queue.SimpleQueue[None] = queue.SimpleQueue()

    def make(self) -> None:
        """Make the request."""
        self._requests.put(None)

    def made(self) -> bool:
        """Return whether the request was made."""
        return not self._requests.empty()

    def wait(self, seconds: float) -> bool:
        """Wait until it's made, for `seconds` at most; return whether it was made."""
        try:
            self._requests.put(self._requests.get(timeout=min(seconds, TIMEOUT_MAX)))
        except queue.Empty:
            return False
        return True
