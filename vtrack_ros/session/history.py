"""A buffer of the latest frames, for selections that were drawn on them and come late."""

from collections import deque

from vtrack_ros.frame import Frame
from vtrack_ros.session.frame_interval import FrameIntervalEstimator

#: How far a selection's stamp may be from that of its frame, in frame intervals.
TOLERANCE = 1.5
#: Frame interval that is assumed until one was measured, in nanoseconds.
USUAL_INTERVAL = 100_000_000


class FrameHistory:
    """
    The latest frames: none older than `seconds`, and no more of them than `megabytes` hold.

    The newest one is always kept, whatever its size.
    """

    def __init__(self, seconds: float, megabytes: float) -> None:
        self.seconds = seconds
        self.megabytes = megabytes
        self._frames: deque[tuple[int, Frame]] = deque()
        self._bytes = 0
        self._interval = FrameIntervalEstimator()
        self._limit = ''

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._frames)

    @property
    def nbytes(self) -> int:
        """Return the memory that the frames take, in bytes."""
        return self._bytes

    @property
    def newest(self) -> int | None:
        """Return the newest frame's stamp in nanoseconds; None where there is no frame."""
        return self._frames[-1][0] if self._frames else None

    @property
    def oldest(self) -> int | None:
        """Return the oldest frame's stamp in nanoseconds; None where there is no frame."""
        return self._frames[0][0] if self._frames else None

    @property
    def tolerance(self) -> float:
        """Return how far a selection's stamp may be from that of its frame, in nanoseconds."""
        return TOLERANCE * (self._interval.interval or USUAL_INTERVAL)

    def instead(self, stamp: int) -> str:
        """Return a text: which frames are kept, and how to get one of `stamp`, which isn't."""
        oldest, newest = self._frames[0][0], self._frames[-1][0]
        more = f'raise {self._limit} to keep more, ' if stamp < oldest and self._limit else ''
        return (f'frames are kept from {seconds(oldest)} to {seconds(newest)} s; {more}'
                'a stamp of 0 takes the next frame')

    def append(self, stamp: int, frame: Frame) -> None:
        """Add a frame; a stamp that goes backwards, or another shape, clears what came before."""
        if self._frames:
            newest, last = self._frames[-1]
            if stamp < newest or frame.shape != last.shape:
                self.clear()
            elif stamp > newest:
                self._interval.add(stamp - newest)
        self._frames.append((stamp, frame))
        self._bytes += frame.nbytes
        while len(self._frames) > 1:
            if self._bytes > self.megabytes * 1e6:
                self._limit = 'history_megabytes'
            elif stamp - self._frames[0][0] > self.seconds * 1e9:
                self._limit = 'history_seconds'
            else:
                break
            self._bytes -= self._frames.popleft()[1].nbytes

    def clear(self) -> None:
        """Forget all frames."""
        self._frames.clear()
        self._interval = FrameIntervalEstimator()
        self._bytes = 0
        self._limit = ''

    def since(self, stamp: int | None) -> list[tuple[int, Frame]]:
        """Return the frame nearest to `stamp` and all later ones; None: the newest frame alone."""
        frames = list(self._frames)
        if stamp is None:
            return frames[-1:]
        nearest = min(range(len(frames)), key=lambda i: abs(frames[i][0] - stamp), default=0)
        return frames[nearest:]


def seconds(stamp: int) -> str:
    """Return a stamp in nanoseconds as text in seconds, to the last digit."""
    return f'{stamp // 10**9}.{stamp % 10**9:09d}'
