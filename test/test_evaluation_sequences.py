"""Sequence folders and bags, valid and broken ones."""

from dataclasses import replace
import math
from pathlib import Path
import shutil

from evaluation_material import picture, truth_of, write_sequence, write_truth
import numpy as np
import pytest

from vtrack_ros.bags.image_folder import read_ground_truth
from vtrack_ros.evaluation import evaluate, find_sequences, SequenceError
from vtrack_ros.evaluation.sequences import read_folder, uniquely_named
from vtrack_ros.geometry import Box


def test_folder(tmp_path):
    """Frames come in order, the truth in rows, and the first box starts a tracker."""
    [sequence] = read_folder(write_sequence(tmp_path / 'Square'))
    assert sequence.name == 'Square'
    assert len(sequence) == 12
    frames = list(sequence.frames())
    np.testing.assert_array_equal(frames[3], picture(3))
    np.testing.assert_array_equal(sequence.pick([5])[5], picture(5))
    np.testing.assert_array_equal(sequence.truth[3], truth_of(3))
    assert sequence.first_box == Box(*truth_of(0))


def test_hidden_files_are_no_images(tmp_path):
    """A Mac writes `._00001.png` beside an image on a disk of another system."""
    folder = write_sequence(tmp_path / 'Square')
    (folder / 'img' / '._00001.png').write_bytes(b'attributes')
    [sequence] = read_folder(folder)
    assert [path.name for path in sequence.images[:2]] == ['00001.png', '00002.png']


@pytest.mark.parametrize('inside, path', [('', '.'), ('img', '..'), ('img', '../../Square')])
def test_a_relative_folder_has_its_own_name(tmp_path, monkeypatch, inside, path):
    """A target is named as its folder, however the folder's path is written."""
    folder = write_sequence(tmp_path / 'Square')
    monkeypatch.chdir(folder / inside)
    assert [one.name for one in find_sequences(Path(path))[0]] == ['Square']


def test_second_ground_truth_is_a_second_target(tmp_path):
    """`groundtruth_rect.2.txt` makes NAME.2, in the same video."""
    folder = write_sequence(tmp_path / 'Pair')
    write_truth(folder, ['5 6 7 8'] * 12, 'groundtruth_rect.2.txt')
    first, second = read_folder(folder)
    assert (first.name, second.name) == ('Pair', 'Pair.2')
    assert first.video == second.video
    assert first.fingerprint() != second.fingerprint()
    assert second.first_box == Box(5, 6, 7, 8)


def test_absent_targets_and_separators(tmp_path):
    """Commas, blanks and semicolons separate; NaN and boxes without area mean absent."""
    write_truth(tmp_path, ['1,2,3,4', '1 2\t3 4', '1;2;3;4', 'NaN,NaN,NaN,NaN', '0,0,0,0', ''])
    truth = read_ground_truth(tmp_path / 'groundtruth_rect.txt')
    assert truth == [Box(1, 2, 3, 4)] * 3 + [None] * 2


@pytest.mark.parametrize(('rows', 'message'), [
    (['1,2,3,4'] * 11, '11 boxes, but 12 images'),
    (['1,2,3,4'] * 5 + ['1,2,3'] + ['1,2,3,4'] * 6, r'groundtruth_rect.txt:6: .*1,2,3'),
    (['left,2,3,4'] + ['1,2,3,4'] * 11, r'groundtruth_rect.txt:1: .*left'),
    (['NaN,NaN,NaN,NaN'] + ['1,2,3,4'] * 11, 'first frame has no box'),
])
def test_wrong_truth_says_what_and_where(tmp_path, rows, message):
    """A ground truth that doesn't fit is refused with its place."""
    folder = write_sequence(tmp_path / 'Wrong', rows=rows)
    with pytest.raises(SequenceError, match=message):
        read_folder(folder)


def test_broken_ones_are_reported_and_the_rest_is_found(tmp_path):
    """A folder without images and one without truth don't hide the good one."""
    write_sequence(tmp_path / 'Good')
    (write_sequence(tmp_path / 'NoTruth') / 'groundtruth_rect.txt').unlink()
    write_sequence(tmp_path / 'Other')
    (tmp_path / 'Empty').mkdir()
    sequences, broken = find_sequences(tmp_path)
    assert [sequence.name for sequence in sequences] == ['Good', 'Other']
    assert set(broken) == {'NoTruth', 'Empty'}
    assert 'no groundtruth_rect.txt' in broken['NoTruth']
    assert 'no images' in broken['Empty']


def test_a_wrong_truth_hides_no_other_target(tmp_path):
    """Of a video's targets those with a good truth are found, and the others are named."""
    folder = write_sequence(tmp_path / 'Trio', 3)
    write_truth(folder, ['NaN,NaN,NaN,NaN'] + ['30,40,24,24'] * 2, 'groundtruth_rect.2.txt')
    write_truth(folder, ['30,40,24,24'] * 3, 'groundtruth_rect.3.txt')
    sequences, broken = find_sequences(tmp_path)
    assert [sequence.name for sequence in sequences] == ['Trio', 'Trio.3']
    assert set(broken) == {'Trio.2'} and 'first frame has no box' in broken['Trio.2']


def test_one_folder_alone(tmp_path):
    """A sequence's own folder is read as that one sequence."""
    sequences, broken = find_sequences(write_sequence(tmp_path / 'Alone'))
    assert [sequence.name for sequence in sequences] == ['Alone']
    assert not broken


def test_nothing_like_a_sequence(tmp_path):
    """A folder of unrelated folders has no sequences, rather than broken ones."""
    (tmp_path / 'letters').mkdir()
    (tmp_path / 'letters' / 'to_mother.txt').write_text('...')
    (tmp_path / 'bills').mkdir()
    with pytest.raises(SequenceError, match='no sequences'):
        find_sequences(tmp_path)
    write_sequence(tmp_path / 'Good')
    sequences, broken = find_sequences(tmp_path)
    assert [sequence.name for sequence in sequences] == ['Good']
    assert set(broken) == {'letters', 'bills'}


def test_no_folder():
    """A folder that isn't there is an error."""
    with pytest.raises(SequenceError, match='no such folder'):
        find_sequences(Path('nowhere'))


def test_image_that_is_none(tmp_path):
    """A file that can't be decoded is named."""
    folder = write_sequence(tmp_path / 'Torn')
    (folder / 'img' / '00004.png').write_bytes(b'not a picture')
    [sequence] = read_folder(folder)
    with pytest.raises(SequenceError, match='00004.png'):
        list(sequence.frames())


def test_fingerprint_is_of_the_content(tmp_path):
    """It stays when a sequence moves, and changes with a pixel or a box."""
    first = write_sequence(tmp_path / 'a' / 'Square')
    second = write_sequence(tmp_path / 'b' / 'Square')
    before = read_folder(first)[0].fingerprint()
    assert read_folder(second)[0].fingerprint() == before
    (second / 'img' / '00002.png').write_bytes((second / 'img' / '00003.png').read_bytes())
    assert read_folder(second)[0].fingerprint() != before
    write_truth(first, ['1,2,3,4'] * 12)
    assert read_folder(first)[0].fingerprint() != before


def test_names_are_unique(tmp_path):
    """A second sequence of a name gets a number."""
    sequences = [read_folder(write_sequence(tmp_path / place / 'Same'))[0] for place in 'ab']
    assert [sequence.name for sequence in uniquely_named(sequences)] == ['Same', 'Same (2)']


def test_names_are_unique_beside_numbered_ones(tmp_path):
    """A number that another sequence's own name has is not given a second time."""
    names = [f'{place}/{name}' for place, name in (('a', 'Same (2)'), ('b', 'Same'), ('c', 'Same'),
                                                   ('d', 'Same (2)'))]
    unique = [sequence.name for sequence in uniquely_named(
        read_folder(write_sequence(tmp_path / name))[0] for name in names)]
    assert len(set(unique)) == 4
    assert unique[:2] == ['Same (2)', 'Same']


def test_no_target_of_a_folder_is_lost(tmp_path):
    """The second target of a video and a folder called as it are two targets."""
    folder = write_sequence(tmp_path / 'Walk', 3)
    write_truth(folder, ['30,40,24,24'] * 3, 'groundtruth_rect.2.txt')
    write_sequence(tmp_path / 'Walk.2', 3)
    results = evaluate(['dcf'], tmp_path, jobs=0)
    assert list(results.by_sequence) == ['Walk', 'Walk.2', 'Walk.2 (2)']


def test_bag(repository):
    """A recorded bag is a sequence with its truth, NaN where the target is absent."""
    pytest.importorskip('rosbags', reason='needs rosbags')
    from vtrack_ros.evaluation.sequences import read_bag
    sequence = read_bag(str(repository / 'bags' / 'face_fast'))
    assert sequence.fingerprint()
    assert sequence.name == 'face_fast'
    frames = list(sequence.frames())
    assert len(frames) == len(sequence) == 50
    assert frames[0].shape == (96, 128, 3)
    np.testing.assert_array_equal(sequence.steps, np.ones(50))
    assert not any(math.isnan(value) for value in sequence.truth[0])


@pytest.mark.parametrize('stamps, steps', [
    # of a driver that stamps in whole seconds: the steps are the node's
    (10**9 * (np.arange(60) // 20 + 1), [1] * 20 + 2 * ([25] + [1] * 19)),
    # two frames in the wrong order
    (10**9 + 33_333_333 * np.array([0, 1, 2, 3, 5, 4, 6]), [1, 1, 1, 1, 2, 1, 2]),
    # a pause of ten seconds
    (10**9 + 40_000_000 * np.array([0, 1, 2, 3, 253, 254]), [1, 1, 1, 1, 30, 1])])
def test_steps_of_a_bag_with_irregular_stamps(tmp_path, stamps, steps):
    """Such a frame counts as one frame interval, and a long pause as thirty, as in the node."""
    pytest.importorskip('rosbags', reason='needs rosbags')
    from vtrack_ros.bags import BagWriter, messages
    from vtrack_ros.evaluation.sequences import read_bag
    image = np.zeros((8, 8, 3), np.uint8)
    with BagWriter(tmp_path / 'bag') as bag:
        for received, stamp in enumerate(stamps.tolist()):
            bag.write('/image', messages.image(image, stamp, 'camera'), received)
            bag.write_truth(Box(2, 2, 4, 4), stamp)
    np.testing.assert_array_equal(read_bag(tmp_path / 'bag').steps, steps)


def test_fingerprint_of_a_bag_is_of_its_steps_too(repository):
    """A run depends on the time between frames, which is estimated from the stamps."""
    pytest.importorskip('rosbags', reason='needs rosbags')
    from vtrack_ros.evaluation.sequences import read_bag
    bag = read_bag(repository / 'bags' / 'face_fast')
    assert read_bag(repository / 'bags' / 'face_fast').fingerprint() == bag.fingerprint()
    slower = replace(bag, intervals=2 * bag.intervals)
    assert slower.fingerprint() != bag.fingerprint()


def test_bag_s_folder_with_a_dot_in_its_name(repository, tmp_path):
    """What follows a dot in the name of a folder isn't a suffix."""
    pytest.importorskip('rosbags', reason='needs rosbags')
    from vtrack_ros.evaluation.sequences import read_bag
    folder = shutil.copytree(repository / 'bags' / 'face_fast', tmp_path / 'speed_0.5')
    assert read_bag(folder).name == 'speed_0.5'


def test_bag_that_is_none(tmp_path):
    """A file that isn't a bag is a SequenceError that names it."""
    pytest.importorskip('rosbags', reason='needs rosbags')
    from vtrack_ros.evaluation.sequences import read_bag
    (tmp_path / 'torn.mcap').write_bytes(b'nothing of the kind')
    with pytest.raises(SequenceError, match='torn.mcap'):
        read_bag(tmp_path / 'torn.mcap')


def test_shared_sequences(sequences):
    """Every file of true boxes is a target; a video may hold two."""
    found, broken = find_sequences(sequences)
    assert not broken
    assert len(found) == len(list(sequences.glob('*/groundtruth_rect*.txt'))) > 1
    assert {'Jogging1', 'Jogging1.2'} <= {sequence.name for sequence in found}
