"""Making bags of frames that come with their truth: from scenes, image folders and videos."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.topics import checked_topic
from vtrack_ros.bags.writer import BagWriter
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box

#: The stamp of the first frame, in nanoseconds: not zero, which ROS takes for "no time".
FIRST_STAMP = 1_000 * 1_000_000_000

#: What's known of a frame: a box, None where the target is absent, or nothing at all.
Truth = Box | None


def record(frames: Iterable[tuple[Frame, Truth]], path: str | Path, *, rate: float = 25.0,
           storage: str = 'mcap', compression: str = 'none', topic: str = 'image',
           with_truth: bool = True) -> int:
    """
    Write frames at an even rate into a bag.

    Parameters
    ----------
    frames : iterable of (ndarray, Box or None)
        Each frame and the target's true box, None where it's absent.
    path, storage, compression
        As `BagWriter` takes them.
    rate : float, [Hz]
        How many frames a second has.
    topic : str
        Of the images.
    with_truth : bool
        Whether the truth is known; without, no truth is written.

    Returns
    -------
    count : int
        The number of frames written.

    Raises
    ------
    BagError
        If there's no frame, the topic has no name for ROS, or the bag can't be written.

    """
    count, topic = 0, checked_topic(topic)
    with BagWriter(path, storage, compression) as writer:
        for frame, truth in frames:
            stamp = FIRST_STAMP + round(count * 1e9 / rate)
            writer.write_frame(frame, stamp, topic)
            if with_truth:
                writer.write_truth(truth, stamp)
            count += 1
        if count == 0:
            raise BagError('there is no frame to write')
    return count
