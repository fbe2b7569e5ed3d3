"""Bags as recorders of ROS 1 and ROS 2 write them, of frames that are always the same."""

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
        writer.set_compression(Ros1Writer.CompressionFormat[chunks])
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
    """Write the bag that a recorder would, with its compression."""
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
