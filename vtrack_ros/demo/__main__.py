"""`python -m vtrack_ros.demo`: the demo, which Ctrl-C ends at any time."""

import signal
import sys
from types import FrameType

from vtrack_ros.dds import end_process
from vtrack_ros.signals import ending_signals

_SIGNALS = ending_signals()


def _end(number: int, frame: FrameType | None) -> None:
    """End the demo at the first signal; ignore further ones, so that it ends its processes."""
    for each in _SIGNALS:
        signal.signal(each, lambda *_: None)
    raise KeyboardInterrupt


if __name__ == '__main__':
    try:
        for each in _SIGNALS:
            signal.signal(each, _end)
        # Imported only now: it takes a second, during which Ctrl-C must end it cleanly too.
        from vtrack_ros.demo.demonstration import main
        code = main()
    except KeyboardInterrupt:
        code = 130
    sys.exit(end_process(code))
