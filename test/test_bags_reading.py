"""Bags of every kind, whole and broken."""

import csv
import math
from pathlib import Path
import shutil

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from recorded_bags import (  # noqa: E402
    COUNT, FIRST, frames, read_all, ros1_bag, STEP, SUFFIX)
from rosbags.rosbag2 import Reader as Ros2Reader  # noqa: E402
from rosbags.typesys import get_types_from_msg, get_typestore, Stores  # noqa: E402

from vtrack_ros.bags import BagError, BagReader, BagWriter, messages  # noqa: E402
from vtrack_ros.geometry import Box  # noqa: E402
from vtrack_ros.messages.images import stamp_nanoseconds, to_frame  # noqa: E402


def box(index):
    """Return the true box of a frame; every fourth has none."""
    return None if index % 4 == 3 else Box(index + 0.1, 2 * index, 10 + index / 3, 7)


def write(path, storage='mcap', compression='none', topics=('/image',)):
    """Write a bag of frames with their truth."""
    with BagWriter(path, storage, compression) as writer:
        for index, frame in enumerate(frames()):
            for topic in topics:
                writer.write_frame(frame, FIRST + index * STEP, topic, frame_id='eye')
            writer.write_truth(box(index), FIRST + index * STEP)
    return path


@pytest.mark.parametrize('compression', ['none', 'png'])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('single_file', [False, True])
def test_there_and_back(tmp_path, storage, compression, single_file):
    """Pixels, stamps, frame ids and truth come back; from the folder and from its file."""
    path = write(tmp_path / 'bag', storage, compression)
    if single_file:
        path = next(path.glob('*' + SUFFIX[storage]))
    images, truth = read_all(path)
    assert len(images) == COUNT
    for index, (image, sent) in enumerate(zip(images, frames())):
        assert np.array_equal(image.frame, sent)
        assert image.stamp == image.received == FIRST + index * STEP
        assert image.frame_id == 'eye'
        found = truth[image.stamp]
        if box(index) is None:
            assert found is None
        else:
            assert found.as_array() == pytest.approx(box(index).as_array(), abs=1e-12)


def test_jpeg_is_close(tmp_path):
    """JPEG keeps a smooth picture within a few grey levels."""
    frame = np.tile(np.linspace(30, 200, 64).astype(np.uint8)[None, :, None], (48, 1, 3))
    with BagWriter(tmp_path / 'bag', compression='jpeg') as writer:
        writer.write_frame(frame, FIRST)
    with BagReader(tmp_path / 'bag') as bag:
        assert list(bag.topics) == ['/image/compressed']
        seen = next(bag.frames()).frame
    assert np.abs(seen.astype(int) - frame).max() <= 4


def test_grey_stays_grey(tmp_path):
    """A grey frame is stored as mono8, and read as one."""
    frame = frames()[0][..., 0].copy()
    for compression in ('none', 'png'):
        with BagWriter(tmp_path / compression, compression=compression) as writer:
            writer.write_frame(frame, FIRST)
        with BagReader(tmp_path / compression) as bag:
            assert np.array_equal(next(bag.frames()).frame, frame)


def test_truth_beside_the_bag(tmp_path):
    """The CSV has every box in full precision, and serves where the topic is missing."""
    path = write(tmp_path / 'bag')
    with (path / 'truth.csv').open(newline='') as file:
        rows = list(csv.reader(file))
    assert rows[0] == ['stamp_ns', 'x', 'y', 'width', 'height']
    for index, row in enumerate(rows[1:]):
        assert int(row[0]) == FIRST + index * STEP
        values = [float(text) for text in row[1:]]
        if box(index) is None:
            assert all(math.isnan(value) for value in values)
        else:
            assert values == box(index).as_array().tolist()
    with BagReader(path) as bag:
        truth = bag.truth('/no_such_topic')
    assert [truth[FIRST + index * STEP] for index in range(COUNT)] == list(map(box, range(COUNT)))


@pytest.mark.parametrize('text, words', [
    ('x,y\n', 'first line'), ('stamp_ns,x,y,width,height\n1,2,3\n', 'line 2'),
    ('stamp_ns,x,y,width,height\n1,2,3,4,5\nfive,1,1,1,1\n', 'line 3'),
    ('stamp_ns,x,y,width,height\n1,2,3,4,5,6\n', 'line 2')])
def test_broken_truth_file(tmp_path, text, words):
    """The error names the line and the reason."""
    path = write(tmp_path / 'bag')
    (path / 'truth.csv').write_text(text)
    with BagReader(path) as bag, pytest.raises(BagError, match=words):
        bag.truth('/no_such_topic')


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3', 'ros1'])
@pytest.mark.parametrize('share', [0.0, 0.001, 0.3, 0.6, 0.9, 0.999])
def test_truncated(tmp_path, storage, share):
    """A bag that was cut off after it was finished is reported as broken or empty, at any cut."""
    if storage == 'ros1':
        path = file = ros1_bag(tmp_path / 'one.bag')
    else:
        path = write(tmp_path / 'bag', storage)
        file = next(path.glob('*' + SUFFIX[storage]))
    data = file.read_bytes()
    file.write_bytes(data[:int(share * len(data))])
    with pytest.raises(BagError, match='broken|truncated|empty') as caught:
        read_all(path)
    assert str(path) in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3', 'ros1'])
def test_corrupted(tmp_path, storage):
    """Bytes that were changed never lead to another error than BagError."""
    if storage == 'ros1':
        path = file = ros1_bag(tmp_path / 'one.bag')
    else:
        path = write(tmp_path / 'bag', storage)
        file = next(path.glob('*' + SUFFIX[storage]))
    data = file.read_bytes()
    rng = np.random.default_rng(9)
    refused = 0
    for amount in (3, 30, 300, 3000):
        for _ in range(6):
            changed = bytearray(data)
            for place in rng.integers(0, len(data), amount):
                changed[place] = rng.integers(0, 256)
            file.write_bytes(changed)
            try:
                read_all(path)
            except BagError:
                refused += 1
    assert refused >= 12


@pytest.mark.parametrize('name, content, words', [
    ('missing', None, 'does not exist'),
    ('empty.mcap', b'', 'empty'),
    ('empty.bag', b'', 'empty'),
    ('noise.bag', b'no bag at all', 'broken'),
    ('noise.db3', b'no bag at all', 'broken'),
    ('film.mp4', b'no bag at all', 'not a bag')])
def test_not_a_bag(tmp_path, name, content, words):
    """What isn't a bag is refused with its name and the reason."""
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BagError, match=words) as caught:
        read_all(path)
    assert name in str(caught.value)


@pytest.mark.parametrize('metadata', ['', 'a: [1', 'rosbag2_bagfile_information: 3\n'])
def test_broken_metadata(tmp_path, metadata):
    """A folder with wrong metadata is a broken bag, though its files may be whole."""
    path = write(tmp_path / 'bag')
    (path / 'metadata.yaml').write_text(metadata)
    with pytest.raises(BagError, match='broken'):
        read_all(path)


def test_storage_is_missing(tmp_path):
    """A missing file that the metadata name is an error."""
    path = write(tmp_path / 'bag')
    next(path.glob('*.mcap')).unlink()
    with pytest.raises(BagError, match='missing'):
        read_all(path)


def test_no_message(tmp_path):
    """A bag without messages is empty."""
    with BagWriter(tmp_path / 'bag'):
        pass
    with pytest.raises(BagError, match='empty'):
        read_all(tmp_path / 'bag')


def test_no_image_topic(tmp_path):
    """The error lists the topics that the bag has instead."""
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_truth(Box(1, 2, 3, 4), FIRST)
    with pytest.raises(BagError, match='no image topic.*/truth'):
        read_all(tmp_path / 'bag')


def test_two_image_topics(tmp_path):
    """One must be chosen by name; the leading slash is optional."""
    path = write(tmp_path / 'bag', topics=('/left', '/right'))
    with pytest.raises(BagError, match='several.*/left.*/right.*--topic'):
        read_all(path)
    for name in ('left', '/right'):
        assert len(read_all(path, name)[0]) == COUNT
    with pytest.raises(BagError, match='no topic /middle.*/left'):
        read_all(path, 'middle')
    with pytest.raises(BagError, match='/truth contains vision_msgs'):
        read_all(path, '/truth')


def test_image_that_cannot_be_read(tmp_path):
    """An unreadable image is an error with its index, or it's skipped and reported."""
    with BagWriter(tmp_path / 'bag') as writer:
        for index, frame in enumerate(frames()[:3]):
            message = messages.image(frame, FIRST + index, 'eye')
            if index == 1:
                message.encoding = 'nonsense'
            writer.write('/image', message, FIRST + index)
    with BagReader(tmp_path / 'bag') as bag:
        with pytest.raises(BagError, match='image 1 of /image.*nonsense'):
            list(bag.frames())
        told = []
        assert [image.stamp - FIRST for image in bag.frames(malformed=told)] == [0, 2]
        assert len(told) == 1 and 'nonsense' in told[0]


def test_error_leaves_nothing(tmp_path):
    """After an interruption neither the bag nor any other file is left."""
    with pytest.raises(KeyboardInterrupt), BagWriter(tmp_path / 'bag') as writer:
        writer.write_frame(frames()[0], FIRST)
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path):
    """A path that exists is refused, and kept."""
    write(tmp_path / 'bag')
    with pytest.raises(BagError, match='exists already'):
        write(tmp_path / 'bag')
    assert len(read_all(tmp_path / 'bag')[0]) == COUNT
    (tmp_path / 'link').symlink_to('nowhere')
    with pytest.raises(BagError, match='link exists already'):
        write(tmp_path / 'link')


@pytest.mark.parametrize('arguments, words', [
    (('zip',), 'mcap, sqlite3'), (('mcap', 'gif'), 'none, png, jpeg')])
def test_unknown_formats(tmp_path, arguments, words):
    """The error lists the valid formats."""
    with pytest.raises(BagError, match=words):
        BagWriter(tmp_path / 'bag', *arguments)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_what_ros2_bag_needs(tmp_path, storage):
    """The bag has metadata of version 9, type hashes, whole definitions, quality of service."""
    path = write(tmp_path / 'bag', storage)
    yaml = pytest.importorskip('yaml', reason='needs PyYAML')
    about = yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert about['version'] == 9
    assert about['storage_identifier'] == storage
    assert about['message_count'] == 2 * COUNT
    assert about['duration']['nanoseconds'] == (COUNT - 1) * STEP
    assert (path / about['relative_file_paths'][0]).is_file()
    rows = {row['topic_metadata']['name']: row['topic_metadata']
            for row in about['topics_with_message_count']}
    assert rows['/image']['type'] == 'sensor_msgs/msg/Image'
    assert rows['/truth']['type'] == 'vision_msgs/msg/Detection2DArray'
    for row in rows.values():
        assert row['serialization_format'] == 'cdr'
        assert row['type_description_hash'].startswith('RIHS01_')
        assert row['offered_qos_profiles'][0]['reliability'] == 'reliable'
    with Ros2Reader(path) as bag:
        for connection in bag.connections:
            assert 'MSG: std_msgs/Header' in connection.msgdef.data


def test_definitions_are_those_of_the_interface_package(repository: Path):
    """The types in bags have the same hashes as the definitions that ROS nodes are built from."""
    folder = repository / 'interfaces' / 'vision_msgs' / 'msg'
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for file in sorted(folder.glob('*.msg')):
        types.update(get_types_from_msg(file.read_text(), f'vision_msgs/msg/{file.stem}'))
    store.register(types)
    assert len(types) >= 7
    for name in types:
        assert messages.typestore().hash_rihs01(name) == store.hash_rihs01(name)


def test_cdr_is_that_of_ros(tmp_path):
    """ROS itself reads what the bag holds."""
    serialization = pytest.importorskip('rclpy.serialization', reason='needs rclpy')
    sensor_msgs = pytest.importorskip('sensor_msgs.msg', reason='needs sensor_msgs')
    vision_msgs = pytest.importorskip('vision_msgs.msg', reason='needs vision_msgs')
    path = write(tmp_path / 'bag')
    with BagReader(path) as bag:
        raws = list(bag.raw())
    image = serialization.deserialize_message(bytes(raws[0].data), sensor_msgs.Image)
    assert np.array_equal(to_frame(image), frames()[0])
    assert stamp_nanoseconds(image.header.stamp) == FIRST
    assert image.header.frame_id == 'eye'
    truth = serialization.deserialize_message(bytes(raws[1].data), vision_msgs.Detection2DArray)
    bounds = truth.detections[0].bbox
    assert (bounds.center.position.x, bounds.center.position.y) == box(0).center
    assert (bounds.size_x, bounds.size_y) == (box(0).width, box(0).height)


@pytest.mark.parametrize('name', ['face_fast', 'full_occlusion', 'leave_and_return'])
def test_recorded_bags(repository: Path, name):
    """Those in the repository are whole and have a truth for every image."""
    path = repository / 'bags' / name
    images, truth = read_all(path)
    assert len(images) >= 50
    assert set(truth) == {image.stamp for image in images}
    assert truth[images[0].stamp] is not None
    absent = sum(box is None for box in truth.values())
    assert absent == 0 if name == 'face_fast' else absent > 10


def test_recorded_bags_are_small(repository: Path):
    """All together they stay below ten megabytes."""
    files = [file for file in (repository / 'bags').rglob('*') if file.is_file()]
    assert 0 < sum(file.stat().st_size for file in files) < 10_000_000


def test_moved_bag(tmp_path):
    """A bag may be copied and renamed."""
    path = write(tmp_path / 'bag')
    shutil.move(path, tmp_path / 'other')
    assert len(read_all(tmp_path / 'other')[0]) == COUNT


def test_a_bag_that_is_not_open(tmp_path):
    """Told so, and not as a broken bag or a missing attribute."""
    bag = BagReader(write(tmp_path / 'bag'))
    for _ in range(2):
        for read in (lambda: bag.topics, bag.truth, lambda: next(bag.raw())):
            with pytest.raises(RuntimeError, match='is not open'):
                read()
        with bag:
            assert bag.topics


@pytest.mark.parametrize('frame, stamp, topic, words', [
    (np.zeros((4, 4, 4), np.uint8), 1, '/image', 'must have shape'),
    (np.zeros((4, 4)), 1, '/image', 'uint8'), (np.zeros((4, 4), np.uint8), 1.5, '/image', '1.5'),
    (np.zeros((4, 4), np.uint8), -1, '/image', 'from 0'),
    (np.zeros((4, 4), np.uint8), 2**62, '/image', 'from 0'),
    (np.zeros((4, 4), np.uint8), 1, '/an image', 'not a valid topic')])
def test_what_no_bag_can_hold(tmp_path, frame, stamp, topic, words):
    """It's refused where it's written: four channels became an image that nobody can read."""
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_frame(np.ones((4, 4), np.uint8), 1)
        with pytest.raises((TypeError, ValueError), match=words):
            bag.write_frame(frame, stamp, topic)
    images, _ = read_all(tmp_path / 'bag')
    assert [image.frame.tolist() for image in images] == [[[1] * 4] * 4]
