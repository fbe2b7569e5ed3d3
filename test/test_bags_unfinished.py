"""Bags of recorders that crashed are read as far as they're whole, and never changed."""

from contextlib import closing, suppress
import re
import shutil
import sqlite3
from struct import unpack_from

from bag_material import write_short_bag
from hypothesis import given, strategies
import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from recorded_bags import (  # noqa: E402
    COUNT, FIRST, frames, mcap_records, read_all, recorded, ros1_bag, STEP, SUFFIX)
from rosbags.rosbag2 import CompressionMode  # noqa: E402

from vtrack_ros.bags import BagError, BagReader, BagWriter  # noqa: E402
from vtrack_ros.cli.command_line import main  # noqa: E402

SHARES = [0.2, 0.5, 0.8, 0.9, 0.97]


def read(path):
    """Return all messages and the notice; check that the files don't change."""
    files = [path] if path.is_file() else sorted(path.iterdir())
    before = [(file, file.read_bytes(), file.stat().st_mtime_ns) for file in files]
    try:
        with BagReader(path) as bag:
            return [(raw.topic, raw.received, bytes(raw.data)) for raw in bag.raw()], bag.notice
    finally:
        assert before == [(file, file.read_bytes(), file.stat().st_mtime_ns)
                          for file in (files if path.is_file() else sorted(path.iterdir()))]


def check(path, whole):
    """Check that exactly the whole messages are read, and that the notice counts them."""
    if whole:
        found, notice = read(path)
        assert found == whole
        told = re.fullmatch(f'{path} has no .* \\(an unfinished recording\\); complete '
                            r'messages: (\d+)', notice)
        # ROS 1 bags here have messages of an unknown type as well.
        assert int(told[1]) == len(whole) or path.suffix in ('.bag', '.active')
    else:
        with pytest.raises(BagError, match='no complete message|broken') as caught:
            read(path)
        assert str(path) in str(caught.value)


@pytest.mark.parametrize('in_chunk, compression', [(0, ''), (1, ''), (3, ''), (3, 'lz4')])
@pytest.mark.parametrize('order', [
    range(COUNT), [1, 0, 3, 2, 4, 5, 8, 7, 6, 9, 11, 10]], ids=['sorted', 'mixed'])
def test_mcap_without_an_end(tmp_path, order, in_chunk, compression):
    """Cut anywhere, a file gives its whole messages, in the order of their reception."""
    data, sent = mcap_records(order, in_chunk, compression)
    path = tmp_path / 'cut.mcap'
    # Next to the ends of records, and at some places in between.
    cuts = {end + more for _, end in sent for more in (-1, 0, 1, 9, 30)}
    cuts |= {int(share * len(data)) for share in SHARES}
    cuts |= {20, 60, len(data) - 38, len(data) - 37, len(data) - 8, len(data) - 1}
    for cut in sorted(cuts):
        path.write_bytes(data[:cut])
        whole = [message for message, end in sent if end <= cut]
        check(path, sorted(whole, key=lambda message: message[1]))


@pytest.mark.parametrize('in_chunk', [0, 3])
def test_mcap_with_an_end_of_zeros(tmp_path, in_chunk):
    """Zeros, which a file system may leave at the end, don't count as messages."""
    data, sent = mcap_records(in_chunk=in_chunk)
    path = tmp_path / 'cut.mcap'
    cut = sent[6][1]
    path.write_bytes(data[:cut] + bytes(10_000))
    check(path, [message for message, end in sent if end <= cut])
    # Half of a chunk was written, or of a message.
    cut = sent[6][1] + 4000
    path.write_bytes(data[:cut] + bytes(15_000))
    found, notice = read(path)
    assert found[:7] == [message for message, _ in sent[:7]] and len(found) <= 9 and notice


def test_mcap_that_is_whole(tmp_path):
    """A file with an end has no notice."""
    data, sent = mcap_records(in_chunk=3)
    path = tmp_path / 'whole.mcap'
    path.write_bytes(data)
    assert read(path) == ([message for message, _ in sent], None)


def test_mcap_broken_in_the_middle(tmp_path):
    """Damage that isn't at the end is an error, whether the file has an end or not."""
    data, sent = mcap_records(in_chunk=3, compression='lz4')
    place = sent[0][1] // 2
    path = tmp_path / 'damaged.mcap'
    for end in (len(data), len(data) - 20):
        path.write_bytes(data[:place] + bytes(3000) + data[place + 3000:end])
        with pytest.raises(BagError, match='broken'):
            read(path)


@pytest.mark.parametrize('storage_compression', ['none', 'png'])
def test_cut_bag_of_our_own(tmp_path, storage_compression):
    """Of a bag by `BagWriter`, without its metadata and its end, images and truth are read."""
    path = tmp_path / 'bag'
    rng = np.random.default_rng(3)
    sent = [rng.integers(0, 256, (300, 400, 3)).astype(np.uint8) for _ in range(COUNT)]
    with BagWriter(path, compression=storage_compression) as writer:
        for index, frame in enumerate(sent):
            writer.write_frame(frame, FIRST + index * STEP)
            writer.write_truth(None, FIRST + index * STEP)
    whole, _ = read(path)
    (path / 'metadata.yaml').unlink()
    file = path / 'bag.mcap'
    data = file.read_bytes()
    counts = []
    for share in (*SHARES, 1.0):
        file.write_bytes(data[:int(share * len(data))])
        try:
            found, notice = read(path)
        except BagError as error:
            assert 'no complete message' in str(error)
            found = []
        assert found == whole[:len(found)]
        counts.append(len(found))
    assert counts == sorted(counts) and counts[-1] == len(whole) > counts[2] > 0
    assert f'no metadata.yaml (an unfinished recording); complete messages: {2 * COUNT}' in (
        notice)
    images, truth = read_all(path)
    assert all(np.array_equal(image.frame, frame) for image, frame in zip(images, sent))
    assert len(truth) == COUNT


def unindexed(data):
    """Return a ROS 1 bag whose first record is that of a bag which wasn't closed."""
    for name, size in ((b'index_pos=', 8), (b'conn_count=', 4), (b'chunk_count=', 4)):
        data = re.sub(name + b'.' * size, name + bytes(size), data, count=1, flags=re.DOTALL)
    return data


def chunk_ends(data):
    """Return where the chunks' data of a ROS 1 bag end."""
    places = [found.end() for found in re.finditer(b'compression=....?.{4}size=....', data,
                                                   re.DOTALL)]
    return [place + 4 + unpack_from('<I', data, place)[0] for place in places]


def written_by_roscpp(data):
    """Return a ROS 1 bag with the fields of its chunks' indices in alphabetical order."""
    fields = rb'(\x04\0\0\0op=\x04)(\x08\0\0\0ver=.{4})(\x09\0\0\0conn=.{4})(\x0a\0\0\0count=.{4})'
    return re.sub(fields, rb'\3\4\1\2', data, flags=re.DOTALL)


@pytest.mark.parametrize('name', ['cut.bag', 'cut.bag.active'])
@pytest.mark.parametrize('roscpp', [False, True])
@pytest.mark.parametrize('chunks', ['NONE', 'BZ2', 'LZ4'])
def test_ros1_without_an_index(tmp_path, chunks, roscpp, name):
    """Cut anywhere, it gives the messages of whole chunks; uncompressed, all whole messages."""
    whole, _ = read(ros1_bag(tmp_path / 'one.bag', chunks=chunks))
    data = unindexed((tmp_path / 'one.bag').read_bytes())
    data = written_by_roscpp(data) if roscpp else data
    # The fifth chunk has no image.
    ends = np.repeat(chunk_ends(data)[:4], 3)
    if chunks == 'NONE':
        ends = [data.index(frame.tobytes()) + frame.nbytes for frame in frames()]
    assert len(ends) == len(whole) == COUNT
    path = tmp_path / name
    cuts = {int(end) + more for end in ends[1::3] for more in (-1, 0, 1, 20, 60, 100)}
    cuts |= {int(share * len(data)) for share in SHARES} | {50, 4117, len(data) - 1, len(data)}
    for cut in sorted(cuts):
        path.write_bytes(data[:cut])
        check(path, [message for message, end in zip(whole, ends) if end <= cut])


def test_ros1_with_a_chunk_that_was_not_closed(tmp_path):
    """The last chunk's length isn't written yet; if it isn't compressed, its messages are read."""
    for chunks, more in (('NONE', 2), ('BZ2', 0), ('LZ4', 0)):
        path = ros1_bag(tmp_path / f'{chunks}.bag', chunks=chunks)
        whole, _ = read(path)
        data = unindexed(path.read_bytes())
        end = chunk_ends(data)[2]
        size = data.rindex(b'size=', 0, end - 1000) + 5
        # Zeros are the sizes of the chunk and of its data; two and a half messages follow.
        path.write_bytes(data[:size] + bytes(8) + data[size + 8:end - 3000])
        check(path, whole[:6 + more])


def test_ros1_broken_in_the_middle(tmp_path):
    """A broken chunk before others is an error; so is a cut bag that claims to have an index."""
    data = ros1_bag(tmp_path / 'one.bag', chunks='BZ2').read_bytes()
    path = tmp_path / 'damaged.bag'
    begin, end = chunk_ends(data)[:2]
    for place in (end - 3000, data.index(b'BZh', begin)):
        path.write_bytes(unindexed(data[:place] + bytes(2000) + data[place + 2000:]))
        with pytest.raises(BagError, match='broken'):
            read(path)
    path.write_bytes(data[:-1000])
    with pytest.raises(BagError, match='broken'):
        read(path)


def split_bag(folder, storage='mcap', mode=CompressionMode.NONE):
    """Write a bag in three files, and no metadata; return their paths and their messages."""
    files, found = [], []
    for number, name in enumerate((f'bag_{one}' for one in (0, 2, 10))):
        part = recorded(folder.with_name(name), storage, mode, range(4 * number, 4 * number + 4))
        found.append(read(part)[0])
        file = next(file for file in part.iterdir() if file.suffix != '.yaml')
        folder.mkdir(exist_ok=True)
        files.append(file.rename(folder / file.name))
    return files, found


@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_folder_without_metadata(tmp_path, storage):
    """Its files are read as one bag, sorted by number, 2 before 10."""
    files, found = split_bag(tmp_path / 'bag', storage)
    check(tmp_path / 'bag', sum(found, []))
    with BagReader(tmp_path / 'bag') as bag:
        assert {name: topic.count for name, topic in bag.topics.items()} == {'/image': COUNT}
        assert bag.duration == pytest.approx((COUNT - 1) * STEP / 1e9)
        assert bag.rate('/image') == pytest.approx(1e9 / STEP)
        assert bag.notice.endswith(f'complete messages: {COUNT}')
        images = list(bag.frames())
    assert all(np.array_equal(image.frame, sent) for image, sent in zip(images, frames()))
    assert len(images) == COUNT


@pytest.mark.parametrize('content', [b'', b'noise', bytes(9000)])
@pytest.mark.parametrize('storage', ['sqlite3', 'mcap'])
def test_last_file_that_is_none(tmp_path, storage, content):
    """If the recorder crashed just after it began a file, the notice names it; others are read."""
    files, found = split_bag(tmp_path / 'bag', storage)
    files[2].write_bytes(content)
    messages, notice = read(tmp_path / 'bag')
    assert messages == found[0] + found[1]
    assert notice.endswith(f'complete messages: 8, none of them in bag_10{SUFFIX[storage]}')
    files[0].write_bytes(content)
    with pytest.raises(BagError, match=f'broken.*bag_0{SUFFIX[storage]}'):
        read(tmp_path / 'bag')


def test_last_file_without_an_end(tmp_path):
    """Its whole messages are read, if it has any."""
    files, found = split_bag(tmp_path / 'bag')
    data, sent = mcap_records(range(8, COUNT), in_chunk=1)
    for cut, count in ((sent[1][1] + 40, 2), (70, 0)):
        files[2].write_bytes(data[:cut])
        messages, notice = read(tmp_path / 'bag')
        assert messages == found[0] + found[1] + [message for message, _ in sent[:count]]
        assert notice.endswith(f'complete messages: {8 + count}')


@pytest.mark.parametrize('mode, words', [
    ('FILE', 'decompress each, as with `zstd -d bag_0.mcap.zstd -o bag_0.mcap`'),
    ('MESSAGE', 'compressed message by message')])
def test_compressed_without_metadata(tmp_path, mode, words):
    """The error says so, and how to unpack compressed files: only the metadata have the format."""
    split_bag(tmp_path / 'bag', mode=CompressionMode[mode])
    with pytest.raises(BagError, match=words):
        read(tmp_path / 'bag')


def test_folders_that_are_no_bag(tmp_path):
    """A folder without storage files, or with those of two formats, is refused."""
    (tmp_path / 'truth.csv').touch()
    with pytest.raises(BagError, match='not a rosbag2 folder'):
        read(tmp_path)
    files, _ = split_bag(tmp_path / 'bag')
    files[1].rename(files[1].with_suffix('.db3'))
    with pytest.raises(BagError, match='both .mcap and .db3'):
        read(tmp_path / 'bag')


def test_database_with_a_log(tmp_path):
    """Messages that are still in SQLite's write-ahead log aren't read, and a notice says so."""
    path = recorded(tmp_path / 'bag', 'sqlite3') / 'bag.db3'
    (tmp_path / 'copy').mkdir()
    whole, notice = read(path)
    assert notice is None
    with closing(sqlite3.connect(path)) as database:
        database.execute('PRAGMA journal_mode = WAL')
        database.execute('INSERT INTO messages SELECT 99, topic_id, timestamp + 1, data '
                         'FROM messages ORDER BY timestamp DESC LIMIT 1')
        database.commit()
        for file in path.parent.glob('bag.db3*'):
            shutil.copy(file, tmp_path / 'copy')
    assert (tmp_path / 'copy' / 'bag.db3-wal').stat().st_size
    check(tmp_path / 'copy' / 'bag.db3', whole)
    check(tmp_path / 'copy', whole)


def test_metadata_are_a_promise(tmp_path):
    """With metadata a cut file is an error: it was damaged after it was recorded."""
    path = recorded(tmp_path / 'bag', 'mcap')
    data = (path / 'bag.mcap').read_bytes()
    (path / 'bag.mcap').write_bytes(data[:-9])
    with pytest.raises(BagError, match='broken'):
        read(path)


MCAP = mcap_records([0, 1, 2], 2)[0]
ROS1 = {}


@given(strategies.integers(1, len(MCAP)), strategies.integers(0, len(MCAP) - 1),
       strategies.integers(0, 255))
def test_any_cut_and_damage_of_mcap(tmp_path_factory, cut, place, value):
    """A file with any cut and any changed byte is read, or refused with BagError."""
    path = tmp_path_factory.mktemp('any') / 'any.mcap'
    changed = bytearray(MCAP)
    # Most bytes are pixels: half of the changes are in the first 400 bytes, which have headers.
    changed[place if place % 2 else place % 400] = value
    path.write_bytes(changed[:cut])
    with suppress(BagError):
        read(path)


@given(strategies.sampled_from(['NONE', 'BZ2', 'LZ4']), strategies.floats(0, 1),
       strategies.floats(0, 1), strategies.integers(0, 255))
def test_any_cut_and_damage_of_ros1(tmp_path_factory, chunks, cut, place, value):
    """A file with any cut and any changed byte is read, or refused with BagError."""
    if chunks not in ROS1:
        path = tmp_path_factory.mktemp('whole') / 'whole.bag'
        ROS1[chunks] = unindexed(ros1_bag(path, chunks=chunks).read_bytes())
    changed = bytearray(ROS1[chunks])
    changed[4117 + int(place * (len(changed) - 4118)) // (1 if value % 2 else 90)] = value
    path = tmp_path_factory.mktemp('any') / 'any.bag'
    path.write_bytes(changed[:1 + int(cut * (len(changed) - 1))])
    with suppress(BagError):
        read(path)


@pytest.mark.parametrize('command', ['replay', 'evaluate', 'play'])
def test_one_warning(tmp_path, repository, capsys, command):
    """Each command warns in one line that the bag is unfinished, and succeeds."""
    path = write_short_bag(tmp_path / 'bag', repository)
    (path / 'metadata.yaml').unlink()
    words = {'replay': ['replay', str(path), '--tracker', 'dcf'],
             'evaluate': ['evaluate', '--bags', str(path), '--trackers', 'dcf', '--no-cache',
                          '--jobs', '1'],
             'play': ['play', str(path), '--wait', '0', '--rate', '50']}[command]
    if command == 'play':
        pytest.importorskip('rclpy', reason='needs rclpy')
    assert main(words) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if 'warning' in line]
    assert told == [f'vtrack {command}: warning: {path} has no metadata.yaml (an unfinished '
                    'recording); complete messages: 20']
