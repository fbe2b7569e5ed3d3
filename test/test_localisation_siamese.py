"""A Siamese network as the localiser of the filters; tiny networks replace NanoTrack's."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
import os
from pathlib import Path
import re

import cv2
from drawn_card import DrawnCard
from drawn_video import box_at, DrawnVideo, look_alike, region_at, START, straight, TARGET
import numpy as np
import pytest
from siamese_files import network_files, write_backbone, write_head

from vtrack_ros.appearance.siamese_network import exemplar_side, SiameseNetwork
from vtrack_ros.localisation import Found, Hypotheses
from vtrack_ros.localisation.search_window import WindowLayout
from vtrack_ros.localisation.siamese_localiser import SiameseModel, SiameseResponse
from vtrack_ros.localisation.target_model import TargetModel
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import create_tracker, tracker_class, tracker_names, TrackState

FILTERS = [name for name in tracker_names(replicas=False, installed=False)
           if 'localiser' in tracker_class(name).PARAMETERS]
SIDE = exemplar_side(TARGET)


@pytest.fixture(scope='module')
def files() -> dict[str, str]:
    """Return the parameters that name the networks' files."""
    return network_files()


@pytest.fixture(scope='module')
def siamese(files) -> dict[str, str]:
    """Return the parameters that select a network as localiser."""
    return {'localiser': 'siamese', **files}


def frame_at(center, seed=0):
    """Return a frame with the target at a place, or without it."""
    return DrawnVideo(seed=seed).frame(center)


def test_the_network_finds_the_target_where_it_is(files):
    """In a square off the target the likeliest cell, and its box in pixels, are at the target."""
    network = SiameseNetwork(*files.values())
    target = network.learn(frame_at(START), START, TARGET)
    side = 255 / 127 * SIDE
    step = 2 * 16 * side / 255
    odds, boxes = network.search(target, frame_at(START), (START[0] - step, START[1]), side)
    row, column = divmod(int(odds.argmax()), 16)
    assert (row, column) == (8, 10)
    np.testing.assert_allclose(boxes[:, row, column], [*START, SIDE / 2, SIDE / 2], atol=0.6)


@pytest.mark.parametrize('other', [(2.0, 2.0), (0.5, 0.5), (2.0, 0.5)])
def test_of_boxes_that_are_as_likely_the_usual_one_counts_most(other, files, monkeypatch):
    """Of equally likely boxes the one of the usual size and shape results, to 10 %."""
    boxes = np.empty((4, 16, 16))
    boxes.T[:] = *START, *np.multiply(TARGET, other)
    boxes[2:, 8, 8] = TARGET
    odds = np.full((16, 16), -10.0)
    odds[8, 7:9] = 0
    monkeypatch.setattr(SiameseNetwork, 'search', lambda *_: (odds, boxes.copy()))
    layout = WindowLayout.around(*TARGET)
    model = SiameseModel.beside(
        TargetModel.create(layout.window(frame_at(START), START, TARGET)),
        SiameseNetwork(*files.values()), frame_at(START), START, TARGET)
    found = model.localise(frame_at(START), START, TARGET).box_at(START)
    np.testing.assert_allclose(found, [*START, *TARGET], rtol=0.1)


def test_of_two_boxes_that_are_as_likely_no_rounding_error_chooses():
    """A difference of 1e-7 in the responses changes the box by less than 0.001 px."""
    boxes = np.array([[-2.0, 0.0, 40.0, 30.0], [2.0, 0.0, 60.0, 50.0]])
    one, other = (
        SiameseResponse.of((0.0, 0.0), 64.0, boxes, np.array(levels)).box_at((0.0, 0.0))
        for levels in ([0.8, 0.8 + 1e-7], [0.8 + 1e-7, 0.8]))
    np.testing.assert_allclose(one, [0, 0, 50, 40], atol=1e-3)
    np.testing.assert_allclose(one, other, atol=1e-3)


@pytest.mark.parametrize('name', FILTERS)
def test_filters_follow_what_the_network_finds(name, siamese):
    """The box stays on the target (IoU above 0.5), always in state TRACKING."""
    path = straight(12, (2.0, 1.0))
    video = DrawnVideo()
    tracker = create_tracker(name, seed=1, **siamese)
    tracker.start(video.frame(path[0]), box_at(path[0]))
    for center in path[1:]:
        estimate = tracker.update(video.frame(center))
        assert estimate.box.iou(box_at(center)) > 0.5
        assert estimate.state is TrackState.TRACKING
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0


def test_grey_frames_will_do(siamese):
    """In a grey video the target is found, too."""
    video = DrawnVideo(colour=False)
    tracker = create_tracker('gmpf', seed=1, **siamese)
    tracker.start(video.frame(START), box_at(START))
    assert tracker.update(video.frame(START)).box.iou(box_at(START)) > 0.7


def test_the_box_is_what_the_user_means_by_the_target(files, tmp_path):
    """The given size is kept, though the network's boxes are square and 15 % higher."""
    head = write_head(tmp_path / 'large.onnx', grow=1.05)
    tracker = create_tracker('gmpf', seed=1, localiser='siamese',
                             **{**files, 'siamese.head': head})
    tracker.start(frame_at(START), box_at(START))
    for _ in range(10):
        box = tracker.update(frame_at(START)).box
    np.testing.assert_allclose([box.width, box.height], TARGET, rtol=0.02)


def test_what_the_user_meant_holds_while_the_target_looks_the_same(files, tmp_path):
    """At the first frame's similarity boxes are corrected in full, at 0 less and less."""
    head = write_head(tmp_path / 'large.onnx', grow=1.05)
    network = SiameseNetwork(files['siamese.backbone'], head)
    frame, layout = frame_at(START), WindowLayout.around(*TARGET)
    first = SiameseModel.beside(
        TargetModel.create(layout.window(frame, START, TARGET)), network, frame, START, TARGET)

    def widths(similarity):
        model, found = first, []
        for _ in range(30):
            found.append(model.localise(frame, START, TARGET).box_at(START)[2])
            model = model.seen(similarity)
        return np.array(found)

    np.testing.assert_allclose(widths(0.75), TARGET[0], rtol=0.02)
    other = widths(0.0)
    assert other[0] == widths(0.75)[0] and (np.diff(np.abs(other - TARGET[0])) > 0).all()
    uncorrected = replace(first, correction=np.array([0.0, 0.0, 1.0, 1.0]))
    np.testing.assert_allclose(
        other[-1], uncorrected.localise(frame, START, TARGET).box_at(START)[2], rtol=0.02)


@pytest.mark.parametrize('wrong', [-1.0, 1e30, np.nan])
def test_a_network_that_talks_nonsense_does_no_harm(wrong, files, tmp_path):
    """With boxes of negative, huge or NaN sizes the estimate stays finite."""
    head = write_head(tmp_path / 'nonsense.onnx', grow=wrong)
    tracker = create_tracker('gmpf', seed=1, localiser='siamese',
                             **{**files, 'siamese.head': head})
    tracker.start(frame_at(START), box_at(START))
    for _ in range(5):
        estimate = tracker.update(frame_at(START))
    assert np.isfinite(estimate.box.as_array()).all() and np.isfinite(estimate.covariance).all()


def test_an_absent_target_is_missed_and_found_again(siamese):
    """The network always finds something, but the absent target isn't reported as tracked."""
    video = DrawnVideo()
    tracker = create_tracker('gmpf', seed=1, **siamese)
    tracker.start(video.frame(START), box_at(START))
    states = [tracker.update(video.frame(center)).state
              for center in [START] * 5 + [None] * 12]
    assert states[4] is TrackState.TRACKING and states[-1] is not TrackState.TRACKING
    for _ in range(12):
        estimate = tracker.update(video.frame(START))
    assert estimate.state is TrackState.TRACKING
    assert estimate.box.iou(box_at(START)) > 0.5


def test_what_is_a_fifth_like_the_target_is_not_said_to_be_it(siamese):
    """A blend with 20 % of the target is reported in 1 of 4 videos at most, with 60 % in all."""
    said = []
    for seed, share in product(range(4), (0.2, 0.6)):
        video, tracker = DrawnVideo(seed=seed), create_tracker('gmpf', seed=1, **siamese)
        tracker.start(video.frame(START), box_at(START))
        for _ in range(8):
            tracker.update(video.frame(START))
        frame = video.frame(START, noise=0.0)
        frame[region_at(START)] = look_alike(video, START, share)
        for _ in range(6):
            estimate = tracker.update(frame)
        said.append(estimate.measured)
    assert sum(said[::2]) <= 1 and all(said[1::2])


@pytest.mark.parametrize('name', FILTERS)
def test_another_localiser_keeps_the_target(name, siamese):
    """It's tracked through a change to the network and back."""
    path = straight(16, (2.0, 1.0))
    video = DrawnVideo()
    tracker = create_tracker(name, seed=1)
    tracker.start(video.frame(path[0]), box_at(path[0]))
    for index, center in enumerate(path[1:]):
        if index in (5, 10):
            tracker.configure(**(siamese if index == 5 else {'localiser': 'dcf'}))
        estimate = tracker.update(video.frame(center))
        assert estimate.box.iou(box_at(center)) > 0.5
        assert estimate.state is TrackState.TRACKING


def test_a_network_s_boxes_are_not_turned(siamese):
    """After a turn by 1.6 rad the network's box is upright, with angle 0 and no affine frame."""
    drawn, center = DrawnCard(), (150.0, 120.0)
    tracker = create_tracker('gmpf', seed=1)
    tracker.start(drawn.frame(center), drawn.box(center))
    for index in range(1, 33):
        estimate = tracker.update(drawn.frame(center, 0.05 * index, seed=index))
    assert estimate.angle == pytest.approx(1.6, abs=0.15)
    tracker.configure(**siamese)
    estimate = tracker.update(drawn.frame(center, 1.6))
    assert estimate.angle == 0 and estimate.affine is None
    assert estimate.box.width < 0.9 * estimate.box.height


def test_filters_go_on_with_as_large_a_target(files):
    """The network's boxes are square: the filters keep their area, in the first box's aspect."""
    frame, center = DrawnCard().frame((150.0, 120.0)), (150.0, 120.0)
    target = Hypotheses(frame, center, (80.0, 32.0), np.random.default_rng(0),
                        SiameseNetwork(*files.values()))
    for _ in range(30):
        target.update(frame, Found(target.localise(frame, center), center), 1.0)
    width, height = target.size
    assert width / height < 2
    target.use(None)
    assert np.prod(target.size) == pytest.approx(width * height)
    assert target.size[0] / target.size[1] == pytest.approx(80 / 32)


def test_a_lost_target_is_found_by_another_localiser(siamese):
    """A target that was lost with one localiser is found again with the other one."""
    video = DrawnVideo()
    tracker = create_tracker('gmpf', seed=1)
    tracker.start(video.frame(START), box_at(START))
    for _ in range(20):
        tracker.update(video.frame(None))
    tracker.configure(**siamese)
    for _ in range(3):
        assert tracker.update(video.frame(None)).state is not TrackState.TRACKING
    for _ in range(12):
        estimate = tracker.update(video.frame(START))
    assert estimate.state is TrackState.TRACKING and estimate.box.iou(box_at(START)) > 0.5


def broken(kind: str, folder: Path, files: dict[str, str]) -> str:
    """Return the path of a file that's no backbone."""
    path = folder / f'{kind}.onnx'
    if kind.startswith('truncated'):
        path.write_bytes(Path(files['siamese.backbone']).read_bytes()[:9000])
    elif kind == 'other':
        write_backbone(path, channels=96)
    return files['siamese.head'] if kind == 'head' else str(path)


@pytest.mark.parametrize('kind, words', [
    ('missing', 'is not a file'), ('missing' * 50, 'is not a file'), ('truncated', "can't read"),
    (os.fsdecode(b'truncated\xff'), 'not UTF-8'),
    ('other', r'expected \(1, 48, 8, 8\) from \(1, 3, 127, 127\), not \(1, 96, 8, 8\)'),
    ('head', r'expected \(1, 48, 8, 8\) from \(1, 3, 127, 127\)')])
def test_a_wrong_file_is_refused(kind, words, tmp_path, files, siamese):
    """It's refused when it's set, with the shapes that are expected; the target is kept."""
    session = TrackingSession('gmpf')
    session.start(frame_at(START), 0, box_at(START))
    wrong = {**siamese, 'siamese.backbone': broken(kind, tmp_path, files)}
    with pytest.raises(ValueError, match=f'gmpf.siamese.backbone: .*{words}'):
        session.change(parameters={'gmpf': wrong})
    assert session.update(frame_at(START), 1).box.iou(box_at(START)) > 0.7
    # for a tracker that isn't in use it's refused as well
    with pytest.raises(ValueError, match=words):
        session.change(parameters={'pf': {'siamese.backbone': wrong['siamese.backbone']}})


def test_a_backbone_is_no_head(files):
    """It's refused as a head, with the outputs that are expected."""
    with pytest.raises(ValueError, match=r'siamese.head: .*output1 \(1, 2, 16, 16\)'):
        create_tracker('gmpf', **{'siamese.head': files['siamese.backbone']})


def test_a_head_that_old_versions_of_opencv_refuse(files, tmp_path, repository, monkeypatch):
    """The manual's script writes one that every version reads, with the same outputs."""
    published = write_head(tmp_path / 'published.onnx', clip=True)
    corrected = tmp_path / 'corrected.onnx'
    [script] = re.findall(r'```python\n(.*?)```',
                          (repository / 'docs' / 'localisers.md').read_text(), re.DOTALL)
    monkeypatch.setattr('sys.argv', ['correct', published, str(corrected)])
    exec(script, {})
    backbone, plain = files.values()
    answers = []
    for head in (plain, str(corrected)):
        network = SiameseNetwork(backbone, head)
        target = network.learn(frame_at(START), START, TARGET)
        answers.append(network.search(target, frame_at(START), START, SIDE)[0])
    np.testing.assert_array_equal(*answers)
    if cv2.__version__.startswith('4.6.'):
        with pytest.raises(ValueError, match="can't read .*Clip"):
            SiameseNetwork(backbone, published)


def test_a_network_needs_its_files(files):
    """With one of the two files the change is refused, and no parameter is changed."""
    tracker = create_tracker('gmpf')
    with pytest.raises(ValueError, match='needs the files siamese.backbone and siamese.head'):
        tracker.configure(localiser='siamese', **{'siamese.head': files['siamese.head']})
    assert tracker.parameters['localiser'] == 'dcf' and not tracker.parameters['siamese.head']
