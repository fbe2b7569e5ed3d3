"""Statistics of a camera's frames: received, late and missing ones, and restarts of a stream."""

from collections import deque
from enum import Enum

from vtrack_ros.session.frame_interval import FrameIntervalEstimator

#: Number of the latest latencies and processing times that are kept.
MEMORY = 300
#: A step in the stamps by more frames than this is a pause, and none of them counts as missing.
LONGEST_GAP = 30
#: How much earlier than the newest a late frame may be stamped, in nanoseconds; what is earlier
#: belongs to a clock that was set back or a stream that begins again.
MAX_LATENESS = 1_000_000_000
#: How much more time may pass between two frames by their stamps than on our clock, in
#: nanoseconds; a frame that is stamped further ahead counts as late.
MAX_AHEAD = 60_000_000_000
#: From this many frames in a row that are stamped before the newest, or too far ahead, their
#: stamps are believed. If the first stamp recurs after this many frames in order, the stream
#: begins again.
RECOVERY_COUNT = 3


class Arrival(Enum):
    """What a frame's stamp says of it."""

    #: The next one.
    NEXT = 'next'
    #: One that others overtook, or whose stamp is wrong: not to be used.
    LATE = 'late'
    #: The clock of the stamps was set back.
    RESET = 'reset'
    #: The stream begins again, as that of a bag that loops.
    BEGINNING = 'beginning'


class FrameFlow:
    """
    Counts frames, and times them.

    `missing` frames never came, by the gaps between the stamps; `late` ones came after later ones,
    or are stamped far ahead. `fault` describes the last malformed one, `largest` is the size of
    the largest image in bytes; `processing` and `latency` are the latest times in ms.
    """

    def __init__(self) -> None:
        self.received = self.malformed = self.late = self.missing = self.largest = 0
        self.fault = ''
        self.processing: deque[float] = deque(maxlen=MEMORY)
        self.latency: deque[float] = deque(maxlen=MEMORY)
        self._first = 0
        self._newest: int | None = None
        self._late_in_a_row = self._in_order = self._ahead_in_a_row = 0
        self._malformed_stamps: deque[int] = deque(maxlen=LONGEST_GAP)
        self._interrupted = False
        self._interval = FrameIntervalEstimator()
        self._first_arrival = self._last_arrival = self._last_frame = 0
        self._since = 0
        self._reported = (0, 0, 0)

    def arrived(self, stamp: int, now: int) -> Arrival:
        """Count a frame that came at `now` [ns], on a clock that never jumps; judge its stamp."""
        self.received += 1
        self._since += 1
        self._first_arrival = self._first_arrival or now
        elapsed = now - self._last_frame
        self._last_arrival = self._last_frame = now
        newest, interrupted = self._newest, self._interrupted
        if newest is None:
            self._begin(stamp, stamp)
            return Arrival.NEXT
        self._ahead_in_a_row += 1
        if stamp <= newest + elapsed + MAX_AHEAD:
            self._ahead_in_a_row = 0
        elif self._ahead_in_a_row < RECOVERY_COUNT:
            self.late += 1
            return Arrival.LATE
        else:
            # a first stamp of 0 was left out, and isn't that of the stream's beginning
            self._first = self._first or stamp
        if stamp < newest:
            self._late_in_a_row += 1
            # Some drivers leave out the stamp of some frames.
            unset = stamp == 0 < self._first
            # After frames in order, only the stream's first frame itself can have its stamp.
            first_again = stamp <= self._first and self._in_order >= RECOVERY_COUNT and not unset
            if ((unset or stamp >= newest - MAX_LATENESS) and self._late_in_a_row < RECOVERY_COUNT
                    and not first_again):
                self.late += 1
                return Arrival.LATE
            again = stamp <= self._first + MAX_LATENESS
            self._begin(stamp if again else min(self._first, stamp), stamp)
            return Arrival.BEGINNING if again else Arrival.RESET
        if stamp > newest and not interrupted:
            gap = self._interval.missing(stamp - newest)
            if gap < LONGEST_GAP:
                came = sum(newest < one < stamp for one in self._malformed_stamps)
                self.missing += max(0, gap - came)
        self._newest, self._late_in_a_row, self._interrupted = stamp, 0, False
        self._in_order += 1
        self._malformed_stamps.clear()
        return Arrival.NEXT

    def count_malformed(self, stamp: int, now: int, fault: str) -> None:
        """
        Count a malformed frame, which came and so isn't missing; the arguments as for `arrived`.

        Its stamp is used only if it's between those of the good frames before and after it.
        """
        self.malformed += 1
        self.fault = fault
        self._last_arrival = now
        self._malformed_stamps.append(stamp)

    def interrupt(self) -> None:
        """Note that no frames are taken for a while: those sent meanwhile aren't missing."""
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

    def _begin(self, first: int, newest: int) -> None:
        self._first, self._newest = first, newest
        self._late_in_a_row, self._in_order = 0, 1
        self._interval = FrameIntervalEstimator()
        self._interrupted = False
        self._malformed_stamps.clear()
