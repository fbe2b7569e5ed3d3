"""Making bags of frames with their truth, from image folders, video files and scenes."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
import math
import os
from pathlib import Path

import cv2
import numpy as np

from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.image_folder import GROUND_TRUTH, image_files, read_ground_truth, read_image
from vtrack_ros.bags.topics import checked_topic
from vtrack_ros.bags.truth import TRUTH_TOPIC
from vtrack_ros.bags.writer import BagWriter, compressed_topic, LAST_STAMP
from vtrack_ros.file_names import is_utf8
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box

#: The stamp of the first frame, in nanoseconds; not 0, which means "no time" to ROS.
FIRST_STAMP = 1_000 * 1_000_000_000
#: Bounds of the rate of frames, in Hz: at higher ones stamps would soon be too close together.
LOWEST_RATE, HIGHEST_RATE = 1e-6, 1e6

#: The truth of a frame: a box; None where the target is absent, or no truth is known.
Truth = Box | None


@dataclass(frozen=True)
class Source:
    """
    A source of frames: image files or, if `images` is empty, a video at `path`.

    `truth` has the box of each frame, None where the target is absent; it's None as a whole where
    no truth is known. `rate` is the video's, in Hz, `announced` the number of frames that its
    header gives, an estimate in some formats; None where they're unknown.
    """

    path: Path
    images: tuple[Path, ...]
    truth: tuple[Truth, ...] | None
    rate: float | None
    announced: int | None

    @property
    def count(self) -> int | None:
        """Return the number of frames; None where it isn't known before they are read."""
        return len(self.images) or (None if self.truth is None else len(self.truth))

    def frames(self) -> Iterator[tuple[Frame, Truth]]:
        """Decode the frames; SequenceError if one can't be, or their number isn't the truth's."""
        count = 0
        for frame in _decoded(self.images) if self.images else _video_frames(self.path):
            count += 1
            if self.truth is not None and count > len(self.truth):
                raise BagError(f'{self.path} has more frames than the {len(self.truth)} rows of '
                               'its truth')
            yield frame, None if self.truth is None else self.truth[count - 1]
        if self.truth is not None and count < len(self.truth):
            raise BagError(f'{self.path} has {count} frames, but {len(self.truth)} rows of truth')


def open_source(path: Path, truth: Path | None = None, without_truth: bool = False) -> Source:
    """
    Open a video file, or a folder with images or with ``img/`` and ``groundtruth_rect.txt``.

    `truth` is a file of boxes, one ``x,y,width,height`` a row; by default it's
    ``groundtruth_rect.txt`` in the folder or its parent. SequenceError if nothing can be read, or
    the truth has another number of rows than there are images.
    """
    if not path.exists():
        raise BagError(f'{path} does not exist')
    if truth is not None and not truth.is_file():
        raise BagError(f'{truth} is not a file')
    images: tuple[Path, ...] = ()
    rate = announced = None
    if path.is_dir():
        images = image_files(path)
        # `.` and `..` are their own parents to Path
        parent = Path(os.path.abspath(path)).parent
        places = (path / f'{GROUND_TRUTH}.txt', parent / f'{GROUND_TRUTH}.txt')
        truth = truth or next((place for place in places if place.is_file()), None)
    else:
        rate, announced = _video_header(path)
    if truth is None or without_truth:
        return Source(path, images, None, rate, announced)
    boxes = tuple(read_ground_truth(truth))
    if images and len(boxes) != len(images):
        raise BagError(f'{truth} has {len(boxes)} rows, but {path} has {len(images)} images; give '
                       'another --truth FILE, or --no-truth')
    return Source(path, images, boxes, rate, announced)


def record(frames: Iterable[tuple[Frame, Truth]], path: str | Path, *, rate: float = 25.0,
           storage: str = 'mcap', compression: str = 'none', topic: str = 'image',
           with_truth: bool = True) -> int:
    """
    Write frames with their truth, at `rate` in Hz, into a bag; return the number of frames.

    The truth isn't written without `with_truth`; `path`, `storage` and `compression` are those of
    `BagWriter`. BagError if there's no frame, the topic isn't a valid name in ROS or is that of
    the truth, the rate isn't from 1e-6 to 1e6, or the bag can't be written.
    """
    count, topic = 0, checked_topic(topic)
    if topic == TRUTH_TOPIC:
        raise BagError(
            f'the topic {TRUTH_TOPIC} is that of the ground truth: give the images another one')
    if not LOWEST_RATE <= rate <= HIGHEST_RATE:
        raise BagError(
            f'the rate must be from {LOWEST_RATE:g} to {HIGHEST_RATE:g} Hz, not {rate:g}')
    if compression != 'none':
        checked_topic(compressed_topic(topic))
    with BagWriter(path, storage, compression) as writer:
        for frame, truth in frames:
            stamp = FIRST_STAMP + round(count * 1e9 / rate)
            if stamp > LAST_STAMP:
                raise BagError(
                    f'at {rate:g} Hz a bag holds up to {count} frames: ROS has no later stamps')
            writer.write_frame(frame, stamp, topic)
            if with_truth:
                writer.write_truth(truth, stamp)
            count += 1
        if count == 0:
            raise BagError('there are no frames to write')
    return count


def _decoded(images: tuple[Path, ...]) -> Iterator[Frame]:
    size = None
    for path in images:
        frame = read_image(path)
        size = size or frame.shape
        if frame.shape != size:
            height, width = frame.shape[:2]
            raise BagError(f'{path} is {width} x {height} pixels, but the images before it '
                           f'are {size[1]} x {size[0]}: all images must have the same size')
        yield frame


def _video_header(path: Path) -> tuple[float | None, int | None]:
    """Return the rate [Hz] and the number of frames that a video claims; BagError for no video."""
    if not is_utf8(path):
        raise BagError(f'{path} has a name that is not UTF-8, which OpenCV cannot open: rename it')
    capture = cv2.VideoCapture(str(path))
    if not capture.isOpened():
        raise BagError(f'{path} is neither a folder of images nor a video that can be read')
    rate, count = (capture.get(key) for key in (cv2.CAP_PROP_FPS, cv2.CAP_PROP_FRAME_COUNT))
    return (float(rate) if math.isfinite(rate) and 0 < rate <= 1000 else None,
            round(count) if math.isfinite(count) and count >= 1 else None)


def _video_frames(path: Path) -> Iterator[Frame]:
    capture = cv2.VideoCapture(str(path))
    while True:
        found, frame = capture.read()
        if not found:
            return
        yield np.asarray(frame, np.uint8)
