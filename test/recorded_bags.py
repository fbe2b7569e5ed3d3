"""Bags as recorders of ROS 1 and ROS 2 write them, of frames that are always the same."""

from struct import pack

import lz4.frame
import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from vtrack_ros.bags import BagReader, messages

COUNT = 12
STEP = 40_000_000
FIRST = 5_000_000_123
SUFFIX = {'mcap': '.mcap', 'sqlite3': '.db3'}
TOPICS = ('/left', '/right')
MCAP_MARK = b'\x89MCAP0\r\n'
COMPRESSORS = {'': bytes, 'lz4': lz4.frame.compress}


def frames():
    """Return noise that compresses badly, so that bytes in the middle of a file matter."""
    rng = np.random.default_rng(1)
    return [rng.integers(0, 256, (36, 48, 3)).astype(np.uint8) for _ in range(COUNT)]


def read_all(path, topic=None):
    """Read everything there is to read."""
    with BagReader(path) as bag:
        return list(bag.frames(topic)), bag.truth()


def ros1_bag(path, compressed=False, topic='/camera', chunks=None):
    """Write a ROS 1 bag of one image topic and of a type that Jazzy doesn't know."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg('uint8 level\n', 'my_msgs/msg/Level'))
    kind = store.types
    writer = Ros1Writer(path)
    if chunks is not None:
        if chunks != 'NONE':
            writer.set_compression(Ros1Writer.CompressionFormat[chunks])
        # Three images in each.
        writer.chunk_threshold = 3 * 36 * 144
    with writer:
        name = 'sensor_msgs/msg/CompressedImage' if compressed else 'sensor_msgs/msg/Image'
        images = writer.add_connection(topic, name, typestore=store)
        levels = writer.add_connection('/level', 'my_msgs/msg/Level', typestore=store)
        for index, frame in enumerate(frames()):
            seconds, nanoseconds = divmod(FIRST + index * STEP, 10 ** 9)
            header = kind['std_msgs/msg/Header'](
                index, kind['builtin_interfaces/msg/Time'](seconds, nanoseconds), 'eye')
            if compressed:
                data = messages.compressed_image(frame, 0, '', 'png').data
                sent = kind[name](header, 'png', data)
            else:
                sent = kind[name](header, 36, 48, 'bgr8', 0, 144, frame.ravel())
            received = FIRST + index * STEP + 1000
            writer.write(images, received, store.serialize_ros1(sent, name))
            level = kind['my_msgs/msg/Level'](index)
            writer.write(levels, received, store.serialize_ros1(level, 'my_msgs/msg/Level'))
    return path


def recorded(path, storage, mode=CompressionMode.NONE, indices=range(COUNT)):
    """Write a bag as a ROS 2 recorder would, with a storage format and a compression mode."""
    writer = Ros2Writer(path, version=8, storage_plugin=StoragePlugin[storage.upper()])
    writer.set_compression(mode, CompressionFormat.ZSTD)
    store = messages.typestore()
    with writer:
        images = writer.add_connection('/image', messages.IMAGE, typestore=store)
        for index in indices:
            stamp = FIRST + index * STEP
            sent = messages.image(frames()[index], stamp, 'eye')
            writer.write(images, stamp, store.serialize_cdr(sent, messages.IMAGE))
    return path


def mcap_records(order=range(COUNT), in_chunk=0, compression=''):
    """
    Return the bytes of an MCAP file, and (message, file size from which it's whole) of each.

    `order` is that of the frames; a chunk has `in_chunk` messages, 0 means no chunks. A message is
    (topic, time of reception, data). The file has no summary.
    """
    schema = record(0x03, pack('<H', 1) + text('sensor_msgs/msg/Image') + text('ros2msg') +
                    text(''))
    file = MCAP_MARK + record(0x01, text('ros2') + text(''))
    pending, sent = schema, []
    for number, topic in enumerate(TOPICS):
        pending += record(0x04, pack('<HH', number, 1) + text(topic) + text('cdr') + text(''))
    chunk = []
    for count, index in enumerate(order, start=1):
        number, time = count % len(TOPICS), FIRST + index * STEP
        data = bytes(messages.typestore().serialize_cdr(
            messages.image(frames()[index], time, 'eye'), messages.IMAGE))
        chunk.append((TOPICS[number], time, data))
        pending += record(0x05, pack('<HIQQ', number, 0, time, time) + data)
        if count % max(1, in_chunk) == 0 or count == len(order):
            if in_chunk:
                times = [time for _, time, _ in chunk]
                packed = COMPRESSORS[compression](pending)
                pending = record(0x06, pack('<QQQI', min(times), max(times), len(pending), 0) +
                                 text(compression) + pack('<Q', len(packed)) + packed)
            file += pending
            sent += [(message, len(file)) for message in chunk]
            if in_chunk:
                # An index, which is too short and never read.
                file += record(0x07, pack('<HI', 0, 0))
            pending, chunk = b'', []
    return file + record(0x0F, bytes(4)) + record(0x02, bytes(20)) + MCAP_MARK, sent


def record(kind, content):
    """Return a record of MCAP."""
    return pack('<BQ', kind, len(content)) + content


def text(content):
    """Return a string as MCAP has it."""
    return pack('<I', len(content)) + content.encode()
