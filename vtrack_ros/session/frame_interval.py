"""The usual interval between frames, and how many frames passed or never came in a longer one."""

from collections import deque
from statistics import median_low

import numpy as np

#: Number of the latest intervals; their median is the usual one.
_MEDIAN_COUNT = 15
#: Longest usual interval [ns] that counts as one: trackers were made on videos of 25 to 30 frames
#: per second, and at a lower rate more changes from one frame to the next.
_LONGEST = 40_000_000
#: Upper bound of a time step, in frames: a longer gap says no more about the target's movement.
LONGEST_STEP = 30.0
#: Number of the latest intervals that the camera's own one is fitted to, where frames are lost.
_MEMORY = 100
#: Largest median deviation of intervals from whole multiples of the camera's, as a share of it,
#: with which stamps count as regular.
_REGULAR = 0.15
#: An interval that exceeds the camera's by less than this many median deviations is explained by
#: jitter.
_BEYOND_JITTER = 6.0


class FrameIntervalEstimator:
    """Tells how many frame intervals passed between two stamps, and how many frames never came."""

    def __init__(self) -> None:
        self._intervals: deque[int] = deque(maxlen=_MEMORY)
        self._period = self._jitter = 0.0

    @property
    def interval(self) -> float | None:
        """Return the usual interval [ns], robust to jitter and lost frames; the lower of two."""
        return median_low(list(self._intervals)[-_MEDIAN_COUNT:]) if self._intervals else None

    def add(self, interval: int) -> None:
        """Take the next interval between two stamps, in nanoseconds."""
        self._intervals.append(interval)

    def steps(self, interval: int) -> float:
        """
        Take the next interval; return the frame intervals in it, from 1 to `LONGEST_STEP`.

        A whole number of usual intervals; if these are longer than 40 ms, of 40 ms each. Stamps
        that stand still or go back count as one interval.
        """
        if interval <= 0:
            return 1.0
        self.add(interval)
        usual = max(1, self.interval or 1)
        passed = max(1, round(interval / usual)) * max(1.0, usual / _LONGEST)
        return min(passed, LONGEST_STEP)

    def missing(self, interval: int) -> int:
        """
        Take the next interval; return how many frames never came in it.

        The camera's own interval is a short one among the latest: even where most frames are lost,
        some consecutive ones arrive. Where the jitter of the stamps is so large that one frame
        can't be told from two, only gaps beyond the jitter count.
        """
        self.add(interval)
        if not 0.6 * self._period < interval < 1.4 * self._period:
            self._fit()
        if interval < self._period + _BEYOND_JITTER * self._jitter:
            return 0
        return max(0, round(interval / self._period) - 1)

    def _fit(self) -> None:
        """Fit the camera's interval to the latest ones, each a whole multiple of it."""
        intervals = np.sort(np.asarray(self._intervals, np.float64))
        period = max(1.0, float(intervals[len(intervals) // 10]))
        for _ in range(10):
            frames = np.maximum(1, np.round(intervals / period))
            previous, period = period, max(1.0, float(intervals.sum() / frames.sum()))
            if period == previous:
                break
        jitter = float(np.median(np.abs(intervals - frames * period)))
        if jitter > _REGULAR * period:
            period = max(1.0, float(np.median(intervals)))
            jitter = float(np.median(np.abs(intervals - period)))
        self._period, self._jitter = period, jitter
