"""The signals that request a program's end."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
from types import FrameType


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return SIGINT, SIGTERM, and SIGHUP (closed terminal) unless ignored, as by `nohup`."""
    asked = signal.SIGINT, signal.SIGTERM
    return asked if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (*asked, signal.SIGHUP)


@contextmanager
def handling_signals(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Install a handler for these signals; on exit, the earlier handlers are restored."""
    earlier = {number: signal.signal(number, handler) for number in ending_signals()}
    try:
        yield
    finally:
        for number, one in earlier.items():
            signal.signal(number, one)
