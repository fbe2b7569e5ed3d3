"""Replaying a bag: the same boxes every time, and the figures that belong to them."""

from contextlib import redirect_stdout
import csv
from dataclasses import replace as changed
import io
import json

from bag_material import write_short_bag
import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from vtrack_ros.bags import BagError, BagReader, BagWriter, messages, StampedFrame  # noqa: E402
from vtrack_ros.bags.replay import replay, Step  # noqa: E402
from vtrack_ros.cli.command_line import main  # noqa: E402
from vtrack_ros.evaluation.stream_score import figures_table, StreamScore  # noqa: E402
from vtrack_ros.geometry import Box  # noqa: E402
from vtrack_ros.session.session import TrackingSession  # noqa: E402
from vtrack_ros.trackers import Estimate, TrackState  # noqa: E402

STEP = 40_000_000


@pytest.fixture(scope='module')
def face(repository):
    """Return the frames and the truth of the face bag."""
    with BagReader(repository / 'bags' / 'face_fast') as bag:
        return list(bag.frames()), bag.truth()


@pytest.fixture(scope='module')
def short(repository, tmp_path_factory):
    """Return a short bag."""
    return write_short_bag(tmp_path_factory.mktemp('short') / 'bag', repository)


@pytest.fixture(scope='module')
def replayed(repository, tmp_path_factory):
    """Return a bag, the folder of its replay and the figures that were printed."""
    path, out = repository / 'bags' / 'full_occlusion', tmp_path_factory.mktemp('replayed')
    with redirect_stdout(io.StringIO()) as printed:
        assert main(['replay', str(path), '--out', str(out), '--json', '--no-video']) == 0
    return path, out, json.loads(printed.getvalue())


def rows_of(folder):
    """Return the rows of a result table."""
    with (folder / 'results.csv').open(newline='') as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize('wrong', ['start', 'update'])
@pytest.mark.parametrize('error', [TypeError, ValueError])
def test_a_defect_of_a_tracker_is_no_wrong_argument(face, wrong, error, monkeypatch):
    """The error says which tracker and where; its cause has the place in the tracker's source."""
    def defect(*arguments):
        raise error('operands could not be broadcast together')

    monkeypatch.setattr(TrackingSession, wrong, defect)
    images, truth = face
    with pytest.raises(BagError if (wrong, error) == ('start', ValueError) else RuntimeError,
                       match='tracker .* at stamp [0-9]+') as caught:
        list(replay(images[:3], TrackingSession('gmpf'), truth))
    if caught.type is RuntimeError:
        assert 'tracker gmpf failed' in str(caught.value)
        assert isinstance(caught.value.__cause__, error)


@pytest.mark.parametrize('tracker', ['pf', 'gmpf'])
def test_bit_for_bit(short, tmp_path, tracker):
    """Two runs write the same bytes; a loop by hand gives the same numbers."""
    path = short
    for name in ('one', 'two'):
        assert main(['replay', str(path), '--tracker', tracker, '--seed', '3', '--out',
                     str(tmp_path / name), '--no-video']) == 0
    contents = [(tmp_path / name / 'results.csv').read_bytes() for name in ('one', 'two')]
    assert contents[0] == contents[1]
    bags = [(tmp_path / name / 'bag' / 'bag.mcap').read_bytes() for name in ('one', 'two')]
    assert bags[0] == bags[1]

    with BagReader(path) as bag:
        images, truth = list(bag.frames()), bag.truth()
    session = TrackingSession(tracker, seed=3)
    estimates = [session.start(images[0].frame, images[0].stamp, truth[images[0].stamp])]
    estimates += [session.update(image.frame, image.stamp) for image in images[1:]]
    rows = rows_of(tmp_path / 'one')
    assert len(rows) == len(estimates) == 10
    for row, image, estimate in zip(rows, images, estimates):
        assert int(row['stamp_ns']) == image.stamp
        numbers = [float(row[name]) for name in ('x', 'y', 'width', 'height')]
        assert numbers == estimate.box.as_array().tolist()
        assert float(row['angle']) == estimate.angle
        assert float(row['confidence']) == estimate.confidence
        assert row['state'] == estimate.state.value


def test_result_bag(replayed):
    """Detections, poses and twists with the images' headers, of the boxes in the table."""
    _, out, figures = replayed
    rows = rows_of(out)
    with BagReader(out / 'bag') as bag:
        assert bag.topics['/detections'].count == len(rows) == 97
        assert bag.topics['/pose'].count == figures['frames_tracked']
        found = bag.truth('/detections')
        poses, twists = ([messages.typestore().deserialize_cdr(raw.data, raw.message_type)
                          for raw in bag.raw({topic})] for topic in ('/pose', '/twist'))
    assert [twist.header for twist in twists] == [pose.header for pose in poses]
    assert all(twist.twist.covariance[0] > 0 for twist in twists)
    tracked = [row for row in rows if row['state'] == 'tracking']
    assert len(tracked) == figures['frames_tracked']
    for row in rows:
        box = found[int(row['stamp_ns'])]
        if row['state'] != 'tracking':
            assert box is None
        else:
            assert box.as_array() == pytest.approx(
                [float(row[name]) for name in ('x', 'y', 'width', 'height')], abs=1e-9)
    for row, message in zip(tracked, poses):
        center = (float(row['x']) + float(row['width']) / 2,
                  float(row['y']) + float(row['height']) / 2)
        assert (message.pose.position.x, message.pose.position.y) == pytest.approx(center)
        assert message.header.frame_id == 'camera_optical_frame'


def test_figures_are_those_of_the_table(replayed):
    """Overlap and error equal those computed from the files."""
    path, out, figures = replayed
    with BagReader(path) as bag:
        truth = bag.truth()
    overlaps, errors = [], []
    for row in rows_of(out):
        box = truth[int(row['stamp_ns'])]
        if box is None:
            continue
        if row['state'] != 'tracking':
            overlaps.append(0.0)
            continue
        mine = Box(*(float(row[name]) for name in ('x', 'y', 'width', 'height')))
        overlaps.append(mine.iou(box))
        errors.append(mine.center_distance(box))
    assert figures['frames'] == 97
    assert figures['mean_iou'] == pytest.approx(np.mean(overlaps), abs=1e-9)
    assert figures['centre_error_px'] == pytest.approx(np.mean(errors), abs=1e-9)
    assert figures['fps'] == pytest.approx(1000 / figures['ms_per_frame'])


def test_pictures(short, tmp_path):
    """The video has every frame, the sheet up to sixteen; a second run replaces the first."""
    cv2 = pytest.importorskip('cv2')
    for _ in range(2):
        assert main(['replay', str(short), '--tracker', 'pf', '--out', str(tmp_path)]) == 0
    video = cv2.VideoCapture(str(tmp_path / 'video.mp4'))
    count = 0
    while video.read()[0]:
        count += 1
    assert count == 10
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(25)
    sheet = cv2.imread(str(tmp_path / 'contact_sheet.png'))
    assert sheet.shape[0] > 3 * 96 and sheet.shape[1] > 4 * 128


@pytest.mark.parametrize('tracker', ['pf_paper', 'gmpf_paper'])
def test_parameters_and_seeds(short, tmp_path, tracker):
    """Parameters and seeds take effect: fewer particles, or another seed, give other boxes."""
    path = str(short)
    for name, values in (('plain', []), ('few', ['--set', 'particles=30']), ('other', [
            '--seed', '4'])):
        assert main(['replay', path, '--tracker', tracker, '--out',
                     str(tmp_path / name), '--no-video', *values]) == 0
    plain, few, other = (rows_of(tmp_path / name) for name in ('plain', 'few', 'other'))
    assert plain != few
    assert plain != other


def test_begins_where_the_truth_begins(face):
    """Until the first true box there is no target."""
    images, truth = face
    late = {stamp: None if index < 7 else box for index, (stamp, box) in enumerate(truth.items())}
    steps = list(replay(images, TrackingSession('pf'), late))
    assert [step.estimate is None for step in steps] == [True] * 7 + [False] * 43
    assert [step.started for step in steps].index(True) == 7
    assert steps[7].estimate.box.iou(late[images[7].stamp]) > 0.99


def test_box_says_where(face):
    """A box serves in place of the truth, from the first image on."""
    images, truth = face
    first = truth[images[0].stamp]
    one = list(replay(images[:10], TrackingSession('pf', 1), truth))
    two = list(replay(images[:10], TrackingSession('pf', 1), {}, first))
    assert [step.estimate.box for step in one] == [step.estimate.box for step in two]


def test_nothing_says_where(face):
    """Without truth and box it's an error, not an empty result; so is a box beyond the image."""
    images, _ = face
    with pytest.raises(BagError, match='--init'):
        list(replay(images[:3], TrackingSession('pf'), {}))
    with pytest.raises(BagError, match='no pixel inside'):
        list(replay(images[:3], TrackingSession('pf'), {}, Box(1000, 0, 5, 5)))


def test_stamps_that_go_backwards(face):
    """When stamps go back, as in a recorded loop, tracking restarts, with the same boxes."""
    images, truth = face
    steps = list(replay([*images[:12], *images[:12]], TrackingSession('gmpf', 5), truth))
    assert [step.started for step in steps] == 2 * ([True] + [False] * 11)
    boxes = [step.estimate.box for step in steps]
    assert boxes[:12] == boxes[12:]


def test_a_clock_that_is_set_back(tmp_path, face, capsys):
    """The target is given up, as by the node, and that is said; what was tracked isn't lost."""
    images, truth = face
    with BagWriter(tmp_path / 'bag') as writer:
        for index, image in enumerate(images[:14]):
            stamp = image.stamp + index * 10**9 - (3 * 10**9 if index >= 10 else 0)
            writer.write('/image', messages.image(image.frame, stamp, 'eye'), image.stamp)
    box = ','.join(map(str, truth[images[0].stamp].as_array()))
    assert main(['replay', str(tmp_path / 'bag'), '--tracker', 'dcf', '--init', box, '--json',
                 '--out', str(tmp_path / 'out'), '--no-video']) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)['frames'] == 14
    states = [row['state'] for row in rows_of(tmp_path / 'out')]
    assert 'waiting' not in states[:10] and states[10:] == ['waiting'] * 4
    assert f'no target from stamp {images[10].stamp + 7 * 10**9} ns on' in printed.err


def test_late_image(face):
    """An image with a stamp before the last one's is skipped, and the target is kept."""
    images, truth = face
    late = changed(images[8], stamp=images[7].stamp - 75_000_000)
    steps = list(replay([*images[:8], late, *images[9:12]], TrackingSession('pf'), truth))
    assert [step.started for step in steps] == [True] + [False] * 10
    assert all(step.estimate is not None for step in steps)


@pytest.mark.parametrize('set_back', [0, 500 * 10**9])
def test_pauses_of_more_than_a_minute(face, set_back):
    """Every image after a pause is answered, as by the node; the recorder's clock may be wrong."""
    images, truth = face
    pauses = [0, 0, 0, 0, 90, 90, 160, 230, 300, 370]
    slow = [changed(image, stamp=image.stamp + pause * 10**9,
                    received=image.received + pause * 10**9 - (set_back if index > 1 else 0))
            for index, (image, pause) in enumerate(zip(images, pauses))]
    steps = list(replay(slow, TrackingSession('pf'), truth))
    assert [step.image.stamp for step in steps] == [image.stamp for image in slow]


def test_late_images_are_told(tmp_path, face, capsys):
    """Images that come late, or are stamped far ahead, are counted, and said to be left out."""
    images, truth = face
    stamps = [image.stamp for image in images[:10]]
    stamps[3], stamps[4] = stamps[4], stamps[3]
    stamps[7] += 70 * 10**9
    with BagWriter(tmp_path / 'bag') as writer:
        for image, stamp in zip(images, stamps):
            writer.write('/image', messages.image(image.frame, stamp, 'eye'), image.stamp)
            writer.write_truth(truth[image.stamp], stamp)
    command = ['replay', str(tmp_path / 'bag'), '--tracker', 'pf', '--out', str(tmp_path / 'out')]
    assert main([*command, '--json', '--no-video']) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)['frames_late'] == 2
    assert json.loads(printed.out)['frames'] == len(rows_of(tmp_path / 'out')) == 8
    assert 'late images skipped: 2' in printed.err and str(stamps[4]) in printed.err
    assert main(command) == 0
    assert 'late                       2' in capsys.readouterr().out


def test_size_that_changes(face):
    """After a change of the image size there is no estimate, and the replay goes on."""
    images, truth = face
    small = [StampedFrame(image.stamp, image.received, '', image.frame[:80, :100].copy())
             for image in images[5:8]]
    steps = list(replay([*images[:5], *small], TrackingSession('pf'), truth))
    assert [step.estimate is None for step in steps] == [False] * 5 + [True] * 3


def test_malformed_images_are_told(tmp_path, face, capsys):
    """Malformed images are skipped, named and counted; the other frames are tracked."""
    images, truth = face
    with BagWriter(tmp_path / 'bag') as writer:
        for index, image in enumerate(images[:10]):
            message = messages.image(image.frame, image.stamp, 'eye')
            if index == 4:
                message.data = message.data[:-7]
            writer.write('/image', message, image.stamp)
            writer.write_truth(truth[image.stamp], image.stamp)
    assert main(['replay', str(tmp_path / 'bag'), '--tracker', 'pf', '--out',
                 str(tmp_path / 'out'), '--json']) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)['frames_malformed'] == 1
    assert json.loads(printed.out)['frames'] == 9
    assert 'image 4 of /image' in printed.err


def step(stamp, box, state=TrackState.TRACKING, started=False, milliseconds=2.0):
    """Return a made-up step."""
    image = StampedFrame(stamp, stamp, '', np.zeros((4, 4), np.uint8))
    estimate = None if box is None else Estimate(box, 0.0, np.eye(4), 1.0, state)
    return Step(image, estimate, milliseconds, started)


def test_scoring():
    """Frames before the start don't count; predictions have overlap 0, absent targets none."""
    truth = {0: Box(0, 0, 2, 2), 1: Box(0, 0, 4, 4), 2: Box(1, 1, 2, 2), 3: None,
             4: Box(0, 0, 2, 2)}
    score = StreamScore(truth)
    score.add_step(step(0, None))
    score.add_step(step(1, Box(0, 0, 4, 4), started=True, milliseconds=100.0))
    score.add_step(step(2, Box(2, 1, 2, 2)))
    score.add_step(step(3, Box(0, 0, 9, 9), milliseconds=4.0))
    score.add_step(step(4, Box(0, 0, 2, 2), TrackState.SEARCHING, milliseconds=6.0))
    # Of three frames after the start one is wrong: the target is absent, but reported as tracked.
    assert score.figures() == pytest.approx({
        'frames': 4, 'frames_tracked': 3, 'mean_iou': (1 + 1 / 3 + 0) / 3,
        'centre_error_px': 0.5, 'wrong_tracking': 1 / 3, 'ms_per_frame': 4.0})
    empty = StreamScore({}).figures()
    assert empty['frames'] == 0
    assert empty['mean_iou'] is None and empty['wrong_tracking'] is None


def test_scoring_of_what_was_wrong():
    """A measured box off the target is wrong; frames without known truth don't count."""
    truth = {stamp: Box(0, 0, 10, 10) for stamp in range(5)}
    score = StreamScore(truth)
    score.add_step(step(0, Box(40, 0, 10, 10), started=True))
    score.add_step(step(1, Box(9, 0, 10, 10)))
    score.add_step(step(2, Box(9, 0, 10, 10), TrackState.LOST))
    score.add_step(step(3, Box(5, 0, 10, 10)))
    score.add_step(step(4, None, milliseconds=0.01))
    score.add_step(step(5, Box(40, 0, 10, 10)))
    figures = score.figures()
    assert figures['wrong_tracking'] == 1 / 4
    # Frames without an estimate don't count for the speed: the tracker has nothing to do.
    assert figures['ms_per_frame'] == 2.0
    assert 'wrongly tracking       0.250' in figures_table(figures)
