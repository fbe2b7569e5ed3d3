"""Writing bags that `ros2 bag play` can play as well."""

import operator
import os
from pathlib import Path
import shutil
import tempfile
from typing import Any, Self

from rosbags.interfaces import (
    Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

from vtrack_ros.bags import messages
from vtrack_ros.bags.errors import BagError, writing
from vtrack_ros.bags.topics import absolute, checked_topic
from vtrack_ros.bags.truth import TRUTH_FILE, TRUTH_TOPIC, write_truth
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.tracker import checked_frame

#: The storage formats of rosbag2 that we write.
STORAGES = ('mcap', 'sqlite3')
#: How images can be stored.
COMPRESSIONS = ('none', 'png', 'jpeg')
#: The last stamp that a message can have: its seconds have 32 bits, one of them the sign.
LAST_STAMP = 2 ** 31 * 1_000_000_000 - 1

_FOREVER = QosTime(9223372036, 854775807)
_RELIABLE = Qos(
    QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, QosDurability.VOLATILE, _FOREVER, _FOREVER,
    QosLiveliness.AUTOMATIC, _FOREVER, False)


class BagWriter:
    """
    Writes a rosbag2 bag; a context manager.

    The bag appears under its name when it's complete: an error or interruption leaves no bag.
    `storage` is one of `STORAGES`; with a compression, one of `COMPRESSIONS`, images are stored as
    CompressedImage. BagError if the path exists, or can't be written.
    """

    def __init__(self, path: str | Path, storage: str = 'mcap', compression: str = 'none') -> None:
        self._path = Path(path)
        if storage not in STORAGES:
            raise BagError(f'unknown storage {storage!r}; valid are ' + ', '.join(STORAGES))
        if compression not in COMPRESSIONS:
            raise BagError(
                f'unknown compression {compression!r}; valid are ' + ', '.join(COMPRESSIONS))
        # a link to nowhere exists as well
        if os.path.lexists(self._path):
            raise BagError(f'{self._path} exists already: give another path, or remove it first')
        self._storage = storage
        self._compression = compression
        self._truth: dict[int, Box | None] = {}
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> Self:
        """Begin to write."""
        parent = self._path.absolute().parent
        try:
            parent.mkdir(parents=True, exist_ok=True)
            self._scratch = Path(tempfile.mkdtemp(dir=parent, prefix='.vtrack-'))
        except OSError as error:
            raise BagError(f"can't write {self._path}: {error.strerror}") from None
        plugin = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}[self._storage]
        self._writer = Writer(self._scratch / self._path.name, version=9, storage_plugin=plugin)
        if self._storage == 'mcap':
            # Compresses chunks within the file, which every MCAP reader decompresses by itself.
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the bag, or remove it after an error."""
        try:
            if kind is None:
                with writing(self._path):
                    self._writer.close()
                    finished = self._scratch / self._path.name
                    if self._truth:
                        write_truth(finished / TRUTH_FILE, self._truth)
                    finished.rename(self._path)
            else:
                self._writer.abort()
        finally:
            shutil.rmtree(self._scratch, ignore_errors=True)

    def note(self, name: str, text: str) -> None:
        """Add an entry to the custom data in the bag's metadata.yaml."""
        self._writer.set_custom_data(name, text)

    def write(self, topic: str, message: Any, stamp: int) -> None:
        """
        Write a message made by `bags.messages` as received at `stamp` in nanoseconds.

        BagError if the topic's name isn't valid in ROS, or the stamp is negative or has more than
        63 bits.
        """
        name, topic = message.__msgtype__, absolute(topic)
        stamp = _checked_stamp(stamp, 2 ** 63 - 1)
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                checked_topic(topic), name, typestore=messages.typestore(),
                offered_qos_profiles=[_RELIABLE])
        data = messages.typestore().serialize_cdr(message, name)
        with writing(self._path):
            self._writer.write(self._connections[topic], stamp, data)

    def write_frame(self, frame: Frame, stamp: int, topic: str = '/image',
                    frame_id: str = 'camera_optical_frame') -> None:
        """
        Write a frame as an Image, or as a CompressedImage on ``<topic>/compressed``.

        The stamp, in nanoseconds, is the image's own and that of its reception. BagError as
        `write`, or if the stamp is after `LAST_STAMP`; TypeError or ValueError if it's no frame.
        """
        frame, stamp = checked_frame(frame), _checked_stamp(stamp)
        if self._compression == 'none':
            self.write(topic, messages.image(frame, stamp, frame_id), stamp)
        else:
            message = messages.compressed_image(frame, stamp, frame_id, self._compression)
            self.write(compressed_topic(topic), message, stamp)

    def write_truth(self, box: Box | None, stamp: int,
                    frame_id: str = 'camera_optical_frame') -> None:
        """Write the true box of the image of that stamp; None where the target is absent."""
        stamp = _checked_stamp(stamp)
        self._truth[stamp] = box
        self.write(TRUTH_TOPIC, messages.detections(box, stamp, frame_id), stamp)


def compressed_topic(topic: str) -> str:
    """Return the name of the topic with the compressed images of a topic."""
    return f'{topic}/compressed'


def _checked_stamp(stamp: int, last: int = LAST_STAMP) -> int:
    try:
        number = operator.index(stamp)
    except TypeError:
        raise BagError(f'a stamp must be an integer number of nanoseconds, not {stamp!r}'
                       ) from None
    if not 0 <= number <= last:
        raise BagError(f'a stamp must be from 0 to {last} ns, not {number}')
    return number
