"""Progress: a bar on a terminal, or periodic lines in a log."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
import io
import signal
import sys
from types import FrameType
from typing import Any, TypeVar

from vtrack_ros.signals import handling_signals

Frame = TypeVar('Frame')

#: Minimum interval between two lines of a log, in seconds.
_PAUSE = 5.0


class ProgressBar:
    """tqdm's bar on standard error, which appears with the first call."""

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._bar: Any = None

    def __call__(self, done: int, total: int | None) -> None:
        """Show that `done` of `total` are done."""
        from tqdm import tqdm
        if self._bar is None:
            live = sys.stderr.isatty()
            with _interrupt_later():
                self._bar = tqdm(
                    total=total, initial=done, unit=f' {self._unit}', leave=live,
                    dynamic_ncols=live, mininterval=0.1 if live else _PAUSE,
                    file=sys.stderr if live else _LogLines(), bar_format=None if live else
                    '{n_fmt}/{total_fmt}{unit}, {elapsed} < {remaining}')
        elif self._bar.update(done - self._bar.n) is None and done == total:
            self._bar.refresh()
        if done == total:
            self._bar.close()
            self._bar = None


def with_progress(frames: Iterable[Frame], total: int | None) -> Iterator[Frame]:
    """
    Yield what there is of each frame, and show how many of `total` were yielded.

    A Ctrl-C that was lost, as one in a destructor is, ends it at the next frame.
    """
    show = ProgressBar('frames')
    with _interrupts() as came:
        for done, frame in enumerate(frames, start=1):
            if came:
                raise KeyboardInterrupt
            show(done, total)
            yield frame


class _LogLines(io.StringIO):
    """A stream that prints each state of the bar as a line on standard error."""

    def write(self, text: str) -> int:
        if line := text.strip():
            print(line, file=sys.stderr, flush=True)
        return len(text)


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Note each Ctrl-C, whether or not its KeyboardInterrupt gets through."""
    came: list[int] = []
    earlier = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)
        if callable(earlier):
            earlier(number, frame)
    with handling_signals(note, () if earlier is signal.SIG_IGN else (signal.SIGINT,)):
        yield came


@contextmanager
def _interrupt_later() -> Iterator[None]:
    """Defer Ctrl-C to the end of the context: a half-constructed bar raises when destroyed."""
    came: list[int] = []
    try:
        with handling_signals(lambda number, _: came.append(number), (signal.SIGINT,)):
            yield
    finally:
        for number in came[:1]:
            signal.raise_signal(number)
