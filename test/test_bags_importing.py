"""Bags of image folders and of videos."""

import io
import os
from pathlib import Path
import sys

import cv2
import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from vtrack_ros.bags import BagError, BagReader, SequenceError  # noqa: E402
from vtrack_ros.bags.importing import FIRST_STAMP, open_source, record  # noqa: E402
from vtrack_ros.cli.command_line import main  # noqa: E402
from vtrack_ros.evaluation.sequences import read_folder  # noqa: E402
from vtrack_ros.geometry import Box  # noqa: E402

COUNT = 11


def pictures(grey=False):
    """Return small random pictures."""
    shape = (20, 30) if grey else (20, 30, 3)
    rng = np.random.default_rng(1)
    return [rng.integers(0, 256, shape).astype(np.uint8) for _ in range(COUNT)]


def write_folder(folder, names='{:04d}.png', grey=False):
    """Write pictures named by their number, from 1 on."""
    folder.mkdir(parents=True)
    for number, picture in enumerate(pictures(grey), start=1):
        cv2.imwrite(str(folder / names.format(number)), picture)
    return folder


@pytest.mark.parametrize('separator', [',', '\t', ' ', ', '])
@pytest.mark.parametrize('inner', ['img', ''])
def test_sequence_folder(tmp_path, inner, separator):
    """Pictures and boxes come through; NaN rows say that the target is absent."""
    root = tmp_path / 'sequence'
    write_folder(root / inner if inner else root)
    boxes = [None if index == 4 else Box(index, 2.5, 7, 9) for index in range(COUNT)]
    rows = [separator.join(['NaN'] * 4) if box is None else
            separator.join(f'{value:g}' for value in box.as_array()) for box in boxes]
    (root / 'groundtruth_rect.txt').write_text('\r\n'.join(rows) + '\n\n')
    source = open_source(root)
    assert record(source.frames(), tmp_path / 'bag', rate=20) == COUNT
    with BagReader(tmp_path / 'bag') as bag:
        images, truth = list(bag.frames()), bag.truth()
    stamps = [FIRST_STAMP + index * 50_000_000 for index in range(COUNT)]
    assert [image.stamp for image in images] == stamps
    assert all(np.array_equal(image.frame, sent) for image, sent in zip(images, pictures()))
    assert [truth[stamp] for stamp in stamps] == boxes


@pytest.mark.parametrize('inside, path', [('img', '.'), ('img/deeper', '..'), ('', 'img')])
def test_a_relative_folder(tmp_path, monkeypatch, inside, path):
    """The truth beside a folder is found however its path is written."""
    write_folder(tmp_path / 'img')
    (tmp_path / 'img' / 'deeper').mkdir()
    (tmp_path / 'groundtruth_rect.txt').write_text('1,2,3,4\n' * COUNT)
    monkeypatch.chdir(tmp_path / inside)
    assert open_source(Path(path)).truth == (Box(1, 2, 3, 4),) * COUNT


def test_plain_folder(tmp_path):
    """Without a truth file there's no truth; names are sorted by number, 2 before 10."""
    source = open_source(write_folder(tmp_path / 'plain', 'shot {}.png'))
    assert source.truth is None
    found = [frame for frame, _ in source.frames()]
    assert all(np.array_equal(frame, sent) for frame, sent in zip(found, pictures()))
    record(source.frames(), tmp_path / 'bag', with_truth=False)
    with BagReader(tmp_path / 'bag') as bag:
        assert list(bag.topics) == ['/image']
        assert bag.truth() == {}


def test_truth_can_be_chosen(tmp_path):
    """Another truth file is used if it's given, or none."""
    root = write_folder(tmp_path / 'sequence')
    (root / 'groundtruth_rect.txt').write_text('1,2,3,4\n' * COUNT)
    other = root / 'groundtruth_rect.2.txt'
    other.write_text('5,6,7,8\n' * COUNT)
    assert open_source(root).truth[0] == Box(1, 2, 3, 4)
    assert open_source(root, other).truth[0] == Box(5, 6, 7, 8)
    assert open_source(root, without_truth=True).truth is None


def write_film(path):
    """Write an AVI of grey frames at 12.5 Hz; return its path and their shades."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*'MJPG'), 12.5, (64, 48))
    if not writer.isOpened():
        pytest.skip('this OpenCV writes no AVI')
    shades = [20 + 15 * index for index in range(COUNT)]
    for shade in shades:
        writer.write(np.full((48, 64, 3), shade, np.uint8))
    writer.release()
    return path, shades


def test_video(tmp_path):
    """All frames come through, nearly unchanged, at the video's rate; the truth must fit them."""
    path, shades = write_film(tmp_path / 'film.avi')
    source = open_source(path)
    assert source.rate == 12.5
    means = [frame.mean() for frame, truth in source.frames() if truth is None]
    assert means == pytest.approx(shades, abs=4)
    boxes = tmp_path / 'boxes.txt'
    boxes.write_text('1,2,3,4\n' * COUNT)
    assert {truth for _, truth in open_source(path, boxes).frames()} == {Box(1, 2, 3, 4)}
    for rows, words in ((COUNT - 1, 'more frames'), (COUNT + 1, f'{COUNT} frames')):
        boxes.write_text('1,2,3,4\n' * rows)
        with pytest.raises(BagError, match=words):
            list(open_source(path, boxes).frames())


def test_a_truncated_video_is_told(tmp_path, capsys):
    """What can be read is imported, with a warning that names the numbers; without loss none."""
    path, _ = write_film(tmp_path / 'film.avi')
    assert open_source(path).announced == COUNT
    assert main(['import', str(path), '--out', str(tmp_path / 'whole')]) == 0
    told = capsys.readouterr().err
    assert 'warning' not in told and f'{COUNT}/{COUNT} frames' in told and '/?' not in told
    data = path.read_bytes()
    place = 0
    for _ in range(7):
        place = data.index(b'00dc', place + 1)
    path.write_bytes(data[:place + 50])
    assert main(['import', str(path), '--out', str(tmp_path / 'bag')]) == 0
    with BagReader(tmp_path / 'bag') as bag:
        count = len(list(bag.frames()))
    assert 0 < count < COUNT
    assert (f'vtrack import: warning: {path} has {COUNT} frames by its header, but only {count} '
            'could be read') in capsys.readouterr().err


@pytest.mark.parametrize('truth, words', [
    ('1,2,3,4\n' * (COUNT - 1), '10 rows.*11 images'), ('1,2,3\n' * COUNT, 'four numbers'),
    ('a,b,c,d\n' * COUNT, 'four numbers'), ('', 'no boxes')])
def test_truth_that_does_not_fit(tmp_path, truth, words):
    """The message says what's wrong with it."""
    root = write_folder(tmp_path / 'sequence')
    (root / 'groundtruth_rect.txt').write_text(truth)
    with pytest.raises(ValueError, match=words):
        open_source(root)


def test_nothing_to_import(tmp_path):
    """Missing paths, empty folders and files that are no video are refused with the reason."""
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'text.mp4').write_text('no video')
    for name, words in (('missing', 'does not exist'), ('empty', 'no images'),
                        ('text.mp4', 'neither')):
        with pytest.raises(ValueError, match=words):
            open_source(tmp_path / name)


def test_a_name_that_is_not_utf8(tmp_path):
    """Such pictures are read; such a video is refused, for OpenCV would end the process."""
    folder = tmp_path / os.fsdecode(b'\xff')
    folder.mkdir()
    (folder / os.fsdecode(b'1\xfc.png')).write_bytes(cv2.imencode('.png', pictures()[0])[1])
    assert record(open_source(folder).frames(), tmp_path / 'bag') == 1
    video = tmp_path / os.fsdecode(b'\xff.mp4')
    video.write_bytes(b'')
    with pytest.raises(BagError, match='not UTF-8'):
        open_source(video)


def test_an_output_whose_name_is_not_utf8(tmp_path, monkeypatch):
    """The command succeeds; before, it ended with 2 where the terminal's encoding is strict."""
    shown = io.BytesIO()
    monkeypatch.setattr(sys, 'stdout', io.TextIOWrapper(shown, 'utf-8', 'strict'))
    bag = tmp_path / os.fsdecode(b'\xfc')
    folder = write_folder(tmp_path / 'pictures')
    assert main(['import', str(folder), '--out', str(bag)]) == 0
    assert f'{COUNT} frames'.encode() in shown.getvalue()


def test_broken_image(tmp_path):
    """A broken image is named, and no bag is left behind."""
    root = write_folder(tmp_path / 'sequence')
    (root / '0007.png').write_bytes(b'no picture')
    with pytest.raises(SequenceError, match='0007.png'):
        record(open_source(root).frames(), tmp_path / 'bag')
    assert not (tmp_path / 'bag').exists()


def test_real_sequence(sequences, tmp_path):
    """A published sequence becomes a bag with all its frames and boxes."""
    source = open_source(sequences / 'Crossing')
    assert record(source.frames(), tmp_path / 'bag') == 120
    with BagReader(tmp_path / 'bag') as bag:
        assert len(list(bag.frames())) == len(bag.truth()) == 120


@pytest.mark.parametrize('names', ['{}.png', 'shot{}_a.png', '{:04d}.png'])
@pytest.mark.parametrize('grey', [False, True])
def test_imported_as_evaluated(tmp_path, names, grey):
    """Evaluation and import take the same pictures in the same order: 2 before 10."""
    root = write_folder(tmp_path / 'sequence' / 'img', names, grey).parent
    (root / 'groundtruth_rect.txt').write_text('1,2,3,4\n' * COUNT)
    [sequence] = read_folder(root)
    evaluated = list(sequence.frames())
    imported = [frame for frame, _ in open_source(root).frames()]
    wanted = [cv2.cvtColor(one, cv2.COLOR_GRAY2BGR) if grey else one for one in pictures(grey)]
    for frames in (evaluated, imported):
        assert [frame.shape for frame in frames] == [(20, 30, 3)] * COUNT
        assert all(np.array_equal(frame, one) for frame, one in zip(frames, wanted))
    np.testing.assert_array_equal(sequence.pick([9])[9], wanted[9])


def test_turned_pictures_are_upright_everywhere(tmp_path):
    """Evaluation and import both turn a picture upright by the EXIF orientation in its file."""
    root = tmp_path / 'sequence'
    (root / 'img').mkdir(parents=True)
    data = cv2.imencode('.jpg', pictures()[0])[1].tobytes()
    # An APP1 segment with one entry, orientation (0x112), a short of value 6: turn clockwise.
    exif = (b'Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0')
    segment = b'\xff\xe1' + (len(exif) + 2).to_bytes(2, 'big') + exif
    (root / 'img' / '1.jpg').write_bytes(data[:2] + segment + data[2:])
    (root / 'groundtruth_rect.txt').write_text('1,2,3,4\n')
    [evaluated] = read_folder(root)[0].frames()
    [(imported, _)] = open_source(root).frames()
    assert evaluated.shape == imported.shape == (30, 20, 3)
    assert np.array_equal(evaluated, imported)


def test_sizes_must_be_one(tmp_path):
    """A picture of another size is named, and no bag is left behind."""
    root = write_folder(tmp_path / 'sequence')
    cv2.imwrite(str(root / '0007.png'), np.zeros((20, 31, 3), np.uint8))
    with pytest.raises(BagError, match='0007.png is 31 x 20.*30 x 20'):
        record(open_source(root).frames(), tmp_path / 'bag')
    assert not (tmp_path / 'bag').exists()
