"""What flows through the node: rates, latency, and frames that never came."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np

#: Share of missing frames from which on it's worth a warning.
NOTABLE_LOSS = 0.01
#: How many latencies and processing times are remembered.
MEMORY = 300
#: A step in the stamps of more frames than this is a pause, not a loss.
LONGEST_GAP = 30


class Metronome:
    """
    Tells from the stamps alone how many frames never came.

    The camera's interval is a short one among the latest: even where most frames are lost, some
    neighbours come through. (A median would take a stream that lost every other frame for whole.)

    Parameters
    ----------
    memory : int
        How many intervals are remembered.

    """

    def __init__(self, memory: int = 100) -> None:
        self._intervals: deque[int] = deque(maxlen=memory)

    def missing(self, interval: int) -> int:
        """Return the frames that are missing in an interval of nanoseconds between two stamps."""
        self._intervals.append(interval)
        shortest = sorted(self._intervals)[len(self._intervals) // 10]
        return max(0, round(interval / max(1, shortest)) - 1)


class FrameFlow:
    """
    Counts frames, and times them.

    Attributes
    ----------
    received, malformed, missing : int
        Frames that came, that came broken, and that never came, as the gaps between the stamps
        tell.
    fault : str
        What was wrong with the last malformed one.

    """

    def __init__(self) -> None:
        self.received = 0
        self.malformed = 0
        self.missing = 0
        self.fault = ''
        self.processing: deque[float] = deque(maxlen=MEMORY)
        self.latency: deque[float] = deque(maxlen=MEMORY)
        self._stamp: int | None = None
        self._spoilt: deque[int] = deque(maxlen=LONGEST_GAP)
        self._interrupted = False
        self._metronome = Metronome()
        self._first_arrival = self._last_arrival = self._last_frame = 0
        self._since = 0
        self._reported = (0, 0, 0)

    def arrived(self, stamp: int, now: int) -> bool:
        """
        Count a frame.

        Parameters
        ----------
        stamp : int, [ns]
            The image's.
        now : int, [ns]
            When it arrived, on a clock that never jumps.

        Returns
        -------
        bool
            Whether the stamps went backwards: another stream begins.

        """
        self.received += 1
        self._since += 1
        self._first_arrival = self._first_arrival or now
        self._last_arrival = self._last_frame = now
        previous, self._stamp = self._stamp, stamp
        interrupted, self._interrupted = self._interrupted, False
        spoilt = list(self._spoilt)
        self._spoilt.clear()
        if previous is None:
            return False
        if stamp < previous:
            self._metronome = Metronome()
            return True
        if stamp > previous and not interrupted:
            gap = self._metronome.missing(stamp - previous)
            if gap < LONGEST_GAP:
                self.missing += max(0, gap - sum(previous < one < stamp for one in spoilt))
        return False

    def spoilt(self, stamp: int, now: int, fault: str) -> None:
        """
        Count a malformed frame, which came and so isn't missing.

        Parameters
        ----------
        stamp : int, [ns]
            The image's; it's believed only if the next good frame's fits.
        now : int, [ns]
            As for `arrived`.
        fault : str
            What is wrong with it.

        """
        self.malformed += 1
        self.fault = fault
        self._last_arrival = now
        self._spoilt.append(stamp)

    def interrupt(self) -> None:
        """Note that nobody takes frames for a while: what is sent meanwhile isn't missing."""
        self._interrupted = True
        self._first_arrival = self._since = 0

    def rate(self, now: int) -> float:
        """Return the frames per second since the last call; `now` in ns as for `arrived`."""
        elapsed = now - self._first_arrival
        rate = self._since * 1e9 / elapsed if self._first_arrival and elapsed > 0 else 0.0
        self._first_arrival, self._since = now, 0
        return rate

    def recent(self) -> tuple[int, int, int]:
        """Return how many frames were received, malformed and missing since the last call."""
        totals = (self.received, self.malformed, self.missing)
        before, self._reported = self._reported, totals
        return (totals[0] - before[0], totals[1] - before[1], totals[2] - before[2])

    def silence(self, now: int) -> float:
        """Return the seconds since anything came; infinite before the first frame."""
        return (now - self._last_arrival) / 1e9 if self._last_arrival else float('inf')

    def age(self, now: int) -> float:
        """Return the seconds since the last frame that wasn't malformed; infinite before it."""
        return (now - self._last_frame) / 1e9 if self._last_frame else float('inf')


def percentiles(values: Sequence[float]) -> tuple[float, float]:
    """Return the median and the 99th percentile; NaN for no values."""
    if not values:
        return float('nan'), float('nan')
    p50, p99 = np.percentile(np.asarray(values), (50, 99))
    return float(p50), float(p99)


def report(flow: FrameFlow, now: int, faults: Sequence[str], publishers: int,
           topic: str) -> tuple[int, str, dict[str, str]]:
    """
    Judge the flow of the last period.

    Parameters
    ----------
    flow : FrameFlow
        What came and what didn't.
    now : int, [ns]
        On the clock that `FrameFlow.arrived` was given.
    faults : sequence of str
        QoS mismatches.
    publishers : int
        How many the image topic has.
    topic : str
        The image topic.

    Returns
    -------
    level : int
        0 well, 1 a warning, 2 an error.
    message : str
    values : dict of str to str

    """
    rate = flow.rate(now)
    received, malformed, missing = flow.recent()
    processing, latency = percentiles(flow.processing), percentiles(flow.latency)
    values = {
        'frame rate': f'{rate:.1f} Hz',
        'frames received': str(flow.received),
        'frames missing': str(flow.missing),
        'frames malformed': str(flow.malformed),
        'processing p50': f'{processing[0]:.2f} ms', 'processing p99': f'{processing[1]:.2f} ms',
        'latency p50': f'{latency[0]:.2f} ms', 'latency p99': f'{latency[1]:.2f} ms',
    }
    if faults:
        return 2, faults[0], values
    if not publishers:
        return 1, f'nobody publishes {topic}', values
    if malformed:
        return 1, (f'{malformed} of the last {received + malformed} images were malformed: '
                   f'{flow.fault}'), values
    if not received:
        silence = flow.silence(now)
        since = 'yet' if silence == float('inf') else f'for {silence:.0f} s'
        return 1, f'no image on {topic} {since}', values
    share = missing / (received + missing)
    if share > NOTABLE_LOSS:
        interval = 1e3 / rate * (1 - share) if rate else 0.0
        slow = processing[0] > interval
        reason = (f'a frame takes {processing[0]:.1f} ms: choose a faster tracker or fewer '
                  'particles' if slow else
                  'lost before they came here: use the Fast DDS profile config/fastdds.xml on '
                  'both sides')
        text = f'{missing} of the last {received + missing} frames are missing, {reason}'
        return 1, text, values
    return 0, f'{rate:.1f} Hz', values


def array(stamp: Any, rows: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    """Return a message for /diagnostics; the stamp is the node's time."""
    message = DiagnosticArray(status=list(rows))
    message.header.stamp = stamp
    return message


def status(name: str, level: int, message: str, values: dict[str, str]) -> DiagnosticStatus:
    """Return one row of /diagnostics."""
    return DiagnosticStatus(
        level=bytes([level]), name=name, message=message,
        values=[KeyValue(key=key, value=value) for key, value in values.items()])
