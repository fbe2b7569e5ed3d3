"""Progress of a command: a Ctrl-C at any moment ends it, and leaves no partial bar."""

import io
import signal
import sys

import pytest

from vtrack_ros.cli.progress import ProgressBar, with_progress


@pytest.fixture(autouse=True)
def ctrl_c():
    """Let Ctrl-C have its usual effect, whatever handler other tests of the process have left."""
    earlier = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, earlier or signal.default_int_handler)


def test_interrupted_at_the_first_line_of_progress(monkeypatch):
    """A Ctrl-C while the bar is being created isn't lost, and leaves no partial bar."""
    class Terminal(io.StringIO):

        def write(self, text):
            signal.raise_signal(signal.SIGINT)
            return len(text)

    failures, interrupted = [], False
    monkeypatch.setattr(sys, 'unraisablehook', failures.append)
    monkeypatch.setattr(sys, 'stderr', Terminal())
    try:
        ProgressBar('frames')(1, 10)
    except KeyboardInterrupt:
        # Not pytest.raises, which would keep the traceback, and with it the bar.
        interrupted = True
    assert interrupted and failures == []


def test_an_interrupt_that_is_lost_ends_it_at_the_next_frame(monkeypatch, capsys):
    """Where a destructor is interrupted, the exception is ignored by Python."""
    class Fragile:

        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(sys, 'unraisablehook', lambda _: None)
    seen, handler = [], signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        for index in with_progress(range(9), 9):
            seen.append(index)
            if index == 2:
                Fragile()
    assert seen == [0, 1, 2] and signal.getsignal(signal.SIGINT) is handler
