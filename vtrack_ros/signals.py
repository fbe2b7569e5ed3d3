"""The signals that tell a program to end."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
from types import FrameType


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return Ctrl-C, a request to end, and a closed terminal unless `nohup` made that harmless."""
    asked = signal.SIGINT, signal.SIGTERM
    return asked if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (*asked, signal.SIGHUP)


@contextmanager
def heard_by(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Have another handler hear them meanwhile."""
    earlier = {number: signal.signal(number, handler) for number in ending_signals()}
    try:
        yield
    finally:
        for number, one in earlier.items():
            signal.signal(number, one)
