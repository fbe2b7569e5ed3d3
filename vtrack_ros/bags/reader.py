"""Reading bags: rosbag2 in mcap and sqlite3, and ROS 1."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
import sqlite3
from statistics import median
import struct
from typing import Any, Self

from rosbags.interfaces import (
    Connection, ConnectionExtRosbag1, ConnectionExtRosbag2, Qos, QosDurability, QosReliability)
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import ReaderError as Ros1ReaderError
from rosbags.rosbag2 import ReaderError as Ros2ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError

from vtrack_ros.bags import messages
from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.ros1_types import is_convertible
from vtrack_ros.bags.storage_files import open_storage, Storage, storage_files
from vtrack_ros.bags.topics import absolute, Topic
from vtrack_ros.bags.truth import read_truth, TRUTH_FILE, TRUTH_TOPIC
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.messages.images import decoded, stamp_nanoseconds

# The exceptions that rosbags and the storage below it raise on invalid data.
_BROKEN = (
    Ros1ReaderError, Ros2ReaderError, SerdeError, TypesysError, sqlite3.Error, struct.error,
    AssertionError, AttributeError, EOFError, IndexError, KeyError,
    MemoryError, OverflowError, RuntimeError, TypeError, ValueError)
#: The magic number that zstd data begin with; no message does.
_ZSTD = b'\x28\xb5\x2f\xfd'


@dataclass(frozen=True)
class StampedFrame:
    """
    A frame of a bag, of shape (H, W, 3) in BGR order or (H, W).

    `stamp` and `frame_id` are from the message's header; `received` is when it was recorded. Both
    times are in nanoseconds.
    """

    stamp: int
    received: int
    frame_id: str
    frame: Frame


@dataclass(frozen=True)
class RawMessage:
    """A serialised message: topic, type, time of reception in nanoseconds, and ROS 2 CDR."""

    topic: str
    message_type: str
    received: int
    data: bytes | memoryview


class BagReader:
    """
    Reads a rosbag2 folder, a single .mcap or .db3 file, or a ROS 1 .bag; a context manager.

    A bag whose recorder died is read as far as possible: a file without an end or an index, and a
    folder without metadata.yaml, whose last file may be unreadable. Then `notice` says so.
    BagError if a bag is missing, empty or broken, or holds fewer messages than its metadata.yaml
    or index says: when it's opened, or when reading reaches that. RuntimeError if it isn't open.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        #: After opening, a line about a bag that its recorder didn't finish; else None.
        self.notice: str | None = None
        self._storages: list[Storage] = []

    def __enter__(self) -> Self:
        """Open the bag."""
        self._storages = []
        with ExitStack() as opened:
            try:
                missing, left_out = self._open_files(opened)
            except OSError as error:
                raise BagError(f"{self.path} can't be read: {error.strerror or error}") from None
            self._is_ros1 = isinstance(self._storages[0], Ros1Reader)
            count = self._message_count()
            unfinished = f'has no {missing} (an unfinished recording)'
            if not count:
                raise BagError(f'{self.path} {unfinished}, and no complete message' if missing else
                               f'{self.path} is empty: it contains no message')
            if missing:
                self.notice = f'{self.path} {unfinished}; complete messages: {count}{left_out}'
            self._opened = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bag."""
        self._storages = []
        self._opened.close()

    def _open_files(self, opened: ExitStack) -> tuple[str, str]:
        """Open all files; return what's missing, and a note about an unreadable last file."""
        files = storage_files(self.path)
        missing = '' if files == [self.path] else 'metadata.yaml'
        for file in files:
            try:
                reader, missing_there = open_storage(file)
            except Exception as error:
                # The storages, and the compression below them, may raise anything; bz2 raises an
                # OSError without errno, which isn't the system's.
                if isinstance(error, OSError) and error.errno is not None:
                    raise
                if file == files[-1] and self._message_count():
                    # The recorder may have died just after creating the file.
                    return missing, f', none of them in {file.name}'
                raise self._broken(error, '' if file == self.path else f'in {file.name}'
                                   ) from error
            opened.callback(reader.close)
            self._storages.append(reader)
            missing = missing or missing_there
        return missing, ''

    def _message_count(self) -> int:
        return sum(reader.message_count for reader in self._storages)

    @property
    def _readers(self) -> list[Storage]:
        if not self._storages:
            raise RuntimeError(f'{self.path} is not open: use `with BagReader(path) as bag`')
        return self._storages

    @property
    def topics(self) -> dict[str, Topic]:
        """Return the topics by name, with a leading slash even if it was recorded without."""
        found: dict[str, Topic] = {}
        for connection in self._connections():
            # ROS 1 records relative names as they are; playing resolves them.
            name = absolute(connection.topic)
            earlier = found.get(name)
            count = connection.msgcount + (earlier.count if earlier else 0)
            reliable = all(one.reliability is not QosReliability.BEST_EFFORT
                           for one in _profiles(connection))
            found[name] = Topic(name, connection.msgtype, count, reliable, _is_latched(connection),
                                self._known(connection))
        return found

    @property
    def duration(self) -> float:
        """Return the time from the first message to the last, in seconds."""
        first = min(reader.start_time for reader in self._readers)
        # The end_time of rosbags is a nanosecond after the last message.
        return max(0, max(reader.end_time for reader in self._readers) - 1 - first) / 1e9

    @property
    def notes(self) -> dict[str, str]:
        """Return the custom data of the bag's metadata.yaml; empty where there is none."""
        reader = self._readers[0]
        custom = None if isinstance(reader, Ros1Reader) else reader.storage.metadata.custom
        return custom if isinstance(custom, dict) else {}

    def image_topic(self, name: str | None = None) -> Topic:
        """Return the topic of that name, or the only image topic there is; BagError for none."""
        images = [topic for topic in self.topics.values()
                  if topic.message_type in messages.IMAGE_TYPES and topic.count
                  and topic.convertible]
        listed = ', '.join(f'{topic.name} ({topic.count})' for topic in images)
        if not images:
            others = ', '.join(
                f'{topic.name} ({topic.message_type})' for topic in self.topics.values())
            raise BagError(f'{self.path} has no image topic with messages; it has {others}')
        if name is None:
            if len(images) > 1:
                raise BagError(f'{self.path} has several image topics: choose one of {listed} '
                               'with --topic')
            return images[0]
        wanted = absolute(name)
        for topic in images:
            if topic.name == wanted:
                return topic
        if wanted in self.topics:
            raise BagError(f'{self.path}: topic {wanted} contains '
                           f'{self.topics[wanted].message_type}, no images; image topics are '
                           f'{listed}')
        raise BagError(f'{self.path} has no topic {wanted}; image topics are {listed}')

    def raw(self, topics: set[str] | None = None) -> Iterator[RawMessage]:
        """
        Iterate over the messages of some topics, or of all, in the order of reception.

        Those of a ROS 1 bag are converted to ROS 2 messages; topics that aren't `convertible` are
        left out.
        BagError if the bag is broken, or holds fewer messages than it promises.
        """
        wanted = None if topics is None else set(map(absolute, topics))
        chosen = [[connection for connection in reader.connections
                   if (wanted is None or absolute(connection.topic) in wanted)
                   and self._known(connection)] for reader in self._readers]
        promised = sum(connection.msgcount for connection in chain(*chosen))
        count = 0
        source = chain.from_iterable(
            reader.messages(some) for reader, some in zip(self._readers, chosen) if some)
        while True:
            try:
                connection, received, recorded = next(source)
                data: bytes | memoryview = recorded
                if self._is_ros1:
                    data = messages.typestore().ros1_to_cdr(recorded, connection.msgtype)
            except StopIteration:
                break
            except Exception as error:
                # The storages may raise anything, and only code of theirs runs here.
                raise self._broken(error, f'after {count} messages') from error
            if data[:4] == _ZSTD:
                raise BagError(f'{self.path} is compressed message by message: give the folder '
                               'of the bag, with its metadata.yaml, instead of this file')
            count += 1
            yield RawMessage(absolute(connection.topic), connection.msgtype, received, data)
        if count < promised:
            raise BagError(f'{self.path} is truncated: {promised} messages were recorded, but '
                           f'only {count} are present')

    def frames(self, topic: str | None = None,
               malformed: list[str] | None = None) -> Iterator[StampedFrame]:
        """
        Iterate over the images of a topic, chosen as by `image_topic`; errors as there and `raw`.

        An image that can't be decoded is a BagError too, unless `malformed` is given: then it's
        left out, and an error message is appended to that list.
        """
        chosen = self.image_topic(topic)
        for number, raw in enumerate(self.raw({chosen.name})):
            message = self._deserialized(raw)
            try:
                frame = decoded(message)
            except ValueError as error:
                text = f'{self.path}: image {number} of {chosen.name}: {error}'
                if malformed is None:
                    raise BagError(text) from None
                malformed.append(text)
                continue
            yield StampedFrame(stamp_nanoseconds(message.header.stamp), raw.received,
                               message.header.frame_id, frame)

    def rate(self, topic: str) -> float:
        """Return a topic's rate, in Hz, by its median interval; 25 where that is unknown."""
        times = [raw.received for raw in self.raw({topic})]
        intervals = [late - early for early, late in zip(times, times[1:]) if late > early]
        return 1e9 / median(intervals) if intervals else 25.0

    def truth(self, topic: str = TRUTH_TOPIC) -> dict[int, Box | None]:
        """
        Return the true boxes by stamp in nanoseconds; None where the target is absent.

        They come from the topic, or else from the CSV beside the bag; empty where there's neither.
        """
        known = self.topics.get(absolute(topic))
        if known is not None and known.message_type == messages.DETECTIONS:
            read = map(self._deserialized, self.raw({topic}))
            return {stamp_nanoseconds(message.header.stamp): messages.detected_box(message)
                    for message in read}
        folder = self.path if self.path.is_dir() else self.path.parent
        return read_truth(folder / TRUTH_FILE) if (folder / TRUTH_FILE).is_file() else {}

    def _connections(self) -> Iterator[Connection]:
        return chain.from_iterable(reader.connections for reader in self._readers)

    def _known(self, connection: Connection) -> bool:
        return not self._is_ros1 or is_convertible(connection.msgtype, connection.msgdef.data)

    def _deserialized(self, raw: RawMessage) -> Any:
        try:
            return messages.typestore().deserialize_cdr(raw.data, raw.message_type)
        except _BROKEN as error:
            raise self._broken(error, f'in a message of {raw.topic}') from error

    def _broken(self, error: Exception, where: str = '') -> BagError:
        reason = str(error).strip().splitlines()
        # the text of a KeyError is the key alone
        text = 'unknown ' * isinstance(error, KeyError) + (
            reason[0] if reason else type(error).__name__)
        place = f' {where}' if where else ''
        return BagError(f'{self.path} is broken or truncated{place}: {text}')


def _profiles(connection: Connection) -> Sequence[Qos]:
    """Return the QoS that the publishers offered; empty where it isn't known."""
    extension = connection.ext
    return extension.offered_qos_profiles if isinstance(extension, ConnectionExtRosbag2) else ()


def _is_latched(connection: Connection) -> bool:
    """Return whether late subscribers got the latest messages too."""
    extension = connection.ext
    if isinstance(extension, ConnectionExtRosbag1):
        return bool(extension.latching)
    return any(one.durability is QosDurability.TRANSIENT_LOCAL for one in _profiles(connection))
