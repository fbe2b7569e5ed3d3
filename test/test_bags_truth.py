"""The truth of bags: boxes that mean that the target is absent."""

import math

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from vtrack_ros.bags import BagReader, BagWriter, messages, SequenceError  # noqa: E402
from vtrack_ros.bags.image_folder import read_ground_truth  # noqa: E402
from vtrack_ros.bags.truth import read_truth  # noqa: E402
from vtrack_ros.cli.command_line import main  # noqa: E402
from vtrack_ros.geometry import Box  # noqa: E402

FIRST = 5_000_000_123


def test_truth_without_area_is_absent(tmp_path):
    """A box without area or with a size that isn't finite means absent, in topic and file."""
    sizes = [(7.0, 9.0), (0.0, 9.0), (7.0, -1.0), (math.nan, 9.0), (math.inf, 9.0)]
    with BagWriter(tmp_path / 'bag') as writer:
        for index, (width, height) in enumerate(sizes):
            message = messages.detections(Box(1, 2, 3, 4), FIRST + index, 'eye')
            message.detections[0].bbox.size_x = width
            message.detections[0].bbox.size_y = height
            writer.write_frame(np.zeros((40, 40), np.uint8), FIRST + index)
            writer.write('/truth', message, FIRST + index)
    with BagReader(tmp_path / 'bag') as bag:
        truth = list(bag.truth().values())
    assert truth[0] is not None and truth[1:] == [None] * 4
    rows = '\n'.join(f'{index},1,2,{width},{height}'
                     for index, (width, height) in enumerate(sizes))
    (tmp_path / 'truth.csv').write_text('stamp_ns,x,y,width,height\n' + rows)
    assert list(read_truth(tmp_path / 'truth.csv').values()) == [Box(1, 2, 7, 9)] + [None] * 4


def test_bag_with_truth_without_area_is_evaluated(repository, tmp_path, capsys):
    """A bag with such a box in its truth is evaluated."""
    with BagReader(repository / 'bags' / 'face_fast') as bag, \
            BagWriter(tmp_path / 'bag') as writer:
        for index, image in enumerate(bag.frames()):
            message = messages.detections(Box(30, 30, 20, 20), image.stamp, 'eye')
            if index == 3:
                message.detections[0].bbox.size_x = 0.0
            writer.write_frame(image.frame, image.stamp)
            writer.write('/truth', message, image.stamp)
    assert main(['evaluate', '--bags', str(tmp_path / 'bag'), '--trackers', 'pf', '--jobs', '1',
                 '--no-cache']) == 0
    assert 'AUC' in capsys.readouterr().out


@pytest.mark.parametrize('mark', [b'', b'\xef\xbb\xbf'])
def test_files_with_a_byte_order_mark(tmp_path, mark):
    """Truth that an editor saved with a byte order mark, and CRLF, is read as without them."""
    (tmp_path / 'truth.csv').write_bytes(mark + b'stamp_ns,x,y,width,height\r\n7,1,2,3,4\r\n')
    assert read_truth(tmp_path / 'truth.csv') == {7: Box(1, 2, 3, 4)}
    (tmp_path / 'rows.txt').write_bytes(mark + b'1,2,3,4\r\n')
    assert read_ground_truth(tmp_path / 'rows.txt') == [Box(1, 2, 3, 4)]


@pytest.mark.parametrize('content', [
    b'stamp_ns,x,y,width,height\n1,2,3,4,\xff\n', 'stamp_ns,x\n'.encode('utf-16'),
    b'stamp_ns,x,y,width,height\n' + b'9' * 200_000, b'stamp_ns,x,y,width,height\n1,2,3,4,\xb2'])
def test_files_that_are_no_text_are_named(tmp_path, content):
    """Other encodings, and fields beyond all measure, are refused with the name of the file."""
    for name, read in (('truth.csv', read_truth), ('rows.txt', read_ground_truth)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(SequenceError, match=name):
            read(tmp_path / name)
