"""The signals that request a program's end."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import signal
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
