"""What recorders write: ROS 1, compressed, and split over files."""

from unittest.mock import Mock

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
import recorded_bags  # noqa: E402
from recorded_bags import (  # noqa: E402
    COUNT, FIRST, frames, mcap_records, read_all, recorded, ros1_bag, STEP, SUFFIX)
from rosbags.convert.converter import default_message  # noqa: E402
from rosbags.rosbag1 import Writer as Ros1Writer  # noqa: E402
from rosbags.rosbag2 import CompressionMode  # noqa: E402
from rosbags.typesys import get_typestore, Stores  # noqa: E402

from vtrack_ros.bags import BagError, BagReader, messages  # noqa: E402


@pytest.mark.parametrize('compressed', [False, True])
def test_ros1(tmp_path, compressed):
    """A ROS 1 bag gives the same frames; messages of unknown types are ignored."""
    images, truth = read_all(ros1_bag(tmp_path / 'one.bag', compressed))
    assert truth == {}
    assert [image.stamp for image in images] == [FIRST + i * STEP for i in range(COUNT)]
    assert all(image.received == image.stamp + 1000 for image in images)
    assert all(np.array_equal(image.frame, sent) for image, sent in zip(images, frames()))
    with BagReader(tmp_path / 'one.bag') as bag:
        assert {raw.topic for raw in bag.raw()} == {'/camera'}


def bag_of_a_robot(path):
    """Write a ROS 1 bag of an image, a latched and an unlatched topic, and an older Range."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types = {'/image': messages.IMAGE, '/robot_description': 'std_msgs/msg/String',
             '/odometer': 'std_msgs/msg/Int32', '/sonar': 'sensor_msgs/msg/Range'}
    with Ros1Writer(path) as writer:
        for topic, kind in types.items():
            connection = writer.add_connection(
                topic, kind, typestore=store, latching=int(topic == '/robot_description'))
            message = default_message(store, kind)
            if kind == messages.IMAGE:
                message.height, message.width, message.step, message.encoding = 1, 1, 1, 'mono8'
                message.data = np.zeros(1, np.uint8)
            writer.write(connection, FIRST, store.serialize_ros1(message, kind))
    return path


def test_ros1_types_that_have_changed(tmp_path):
    """A type with other fields in ROS 2 doesn't make the whole bag unreadable; it's left out."""
    with BagReader(bag_of_a_robot(tmp_path / 'robot.bag')) as bag:
        assert [name for name, topic in bag.topics.items() if not topic.convertible] == ['/sonar']
        assert {raw.topic for raw in bag.raw()} == {'/image', '/robot_description', '/odometer'}
        assert len(list(bag.frames())) == 1


def test_ros1_latched(tmp_path):
    """A topic that was latched reaches late subscribers, who don't match others in ROS 2."""
    with BagReader(bag_of_a_robot(tmp_path / 'robot.bag')) as bag:
        assert {name for name, topic in bag.topics.items() if topic.transient_local} == {
            '/robot_description'}


def test_ros1_types_that_have_changed_are_told(tmp_path):
    """The player says which topics it can't play, and why."""
    pytest.importorskip('rclpy', reason='needs rclpy')
    from vtrack_ros.bags.player import Player
    with BagReader(bag_of_a_robot(tmp_path / 'robot.bag')) as bag:
        player = Player(Mock(), bag)
    assert [topic.name for topic in player.topics] == ['/image', '/robot_description', '/odometer']
    assert player.skipped == [
        '/sonar: sensor_msgs/msg/Range of ROS 1 has other fields than that of ROS 2']


@pytest.mark.parametrize('chunks', ['BZ2', 'LZ4'])
def test_ros1_in_compressed_chunks(tmp_path, chunks):
    """A recorder's --bz2 and --lz4, several chunks of either, give the same frames."""
    images, _ = read_all(ros1_bag(tmp_path / 'one.bag', chunks=chunks))
    assert [image.stamp for image in images] == [FIRST + i * STEP for i in range(COUNT)]
    assert all(np.array_equal(image.frame, sent) for image, sent in zip(images, frames()))


@pytest.mark.parametrize('storage, mode', [
    ('sqlite3', 'FILE'), ('sqlite3', 'MESSAGE'), ('mcap', 'FILE'), ('mcap', 'MESSAGE'),
    ('mcap', 'STORAGE')])
def test_compressed_by_the_recorder(tmp_path, storage, mode):
    """The modes of `ros2 bag record --compression-format zstd`, and mcap's own chunks."""
    path = recorded(tmp_path / 'bag', storage, CompressionMode[mode])
    images, _ = read_all(path)
    assert [image.stamp for image in images] == [FIRST + i * STEP for i in range(COUNT)]
    assert all(np.array_equal(image.frame, sent) for image, sent in zip(images, frames()))
    file = next(file for file in path.iterdir() if file.name != 'metadata.yaml')
    if mode == 'STORAGE':
        assert len(read_all(file)[0]) == COUNT
    else:
        # The metadata tell that it's compressed; the file alone doesn't.
        with pytest.raises(BagError, match='is compressed.*folder'):
            read_all(file)


@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_split_over_files(tmp_path, storage):
    """A recorder's --max-bag-size: one folder, several files, one stream."""
    half = COUNT // 2
    path = recorded(tmp_path / 'bag', storage, indices=range(half))
    second = recorded(tmp_path / 'more', storage, indices=range(half, COUNT))
    name, more = f'bag{SUFFIX[storage]}', f'more{SUFFIX[storage]}'
    (second / more).rename(path / more)
    text = (path / 'metadata.yaml').read_text()
    text = text.replace(f'  - {name}\n', f'  - {name}\n  - {more}\n')
    text = text.replace(f'message_count: {half}', f'message_count: {COUNT}')
    text = text.replace(str((half - 1) * STEP), str((COUNT - 1) * STEP))
    (path / 'metadata.yaml').write_text(text)
    images, _ = read_all(path)
    assert [image.stamp for image in images] == [FIRST + i * STEP for i in range(COUNT)]
    assert all(np.array_equal(image.frame, sent) for image, sent in zip(images, frames()))
    (path / more).unlink()
    with pytest.raises(BagError, match=f'missing.*{more}'):
        read_all(path)


@pytest.mark.parametrize('with_metadata', [False, True])
@pytest.mark.parametrize('in_chunk', [0, 3])
def test_mcap_without_an_index(tmp_path, monkeypatch, in_chunk, with_metadata):
    """
    The preset `fastwrite` writes no chunks: messages are sorted by reception all the same.

    Those of several topics are often written in another order.
    """
    monkeypatch.setattr(recorded_bags, 'TOPICS', ('/image',))
    path = recorded(tmp_path / 'bag', 'mcap')
    data, sent = mcap_records([1, 0, 3, 2, 4, 5, 8, 7, 6, 9, 11, 10], in_chunk)
    file = path / 'bag.mcap'
    file.write_bytes(data)
    with BagReader(path if with_metadata else file) as bag:
        assert bag.notice is None
        read = [(raw.topic, raw.received, bytes(raw.data)) for raw in bag.raw()]
    assert read == sorted((message for message, _ in sent), key=lambda message: message[1])
    # a whole file is a promise: a broken last message isn't the end of a recording
    place = sent[-1][1] - len(sent[-1][0][2]) - 30
    file.write_bytes(data[:place] + bytes([255] * 4) + data[place + 4:])
    with pytest.raises(BagError, match='broken'):
        read_all(path if with_metadata else file)


@pytest.mark.parametrize('recorded', ['/camera/image', 'camera/image'])
@pytest.mark.parametrize('wanted', [None, '/camera/image', 'camera/image'])
def test_relative_topics(tmp_path, recorded, wanted):
    """ROS 1 records names without a slash too; they are found with and without one."""
    with BagReader(ros1_bag(tmp_path / 'one.bag', topic=recorded)) as bag:
        topic = bag.image_topic(wanted)
        assert topic.name == '/camera/image'
        assert len(list(bag.frames(wanted))) == topic.count == COUNT
        assert {raw.topic for raw in bag.raw({wanted or recorded})} == {'/camera/image'}
        assert bag.rate(recorded) == pytest.approx(1e9 / STEP)
