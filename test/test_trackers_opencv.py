"""OpenCV's trackers behind the same interface: box and state, but no covariance."""

import shutil
import subprocess
import sys

import cv2
from drawn_video import box_at, DrawnVideo, START
import numpy as np
import pytest
from siamese_files import network_files

from vtrack_ros.geometry import Box
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import (
    available_peers, create_tracker, tracker_class, tracker_names, TrackState)

NANO = {'backbone': network_files()['siamese.backbone'], 'head': network_files()['siamese.head']}
HERE = [(name, {}) for name in available_peers()]
HERE += [('opencv_nano', NANO)] if tracker_class('opencv_nano').available() else []


@pytest.mark.parametrize('name, files', HERE)
def test_they_track(name, files):
    """The target is in the box, and the covariance is NaN."""
    video = DrawnVideo()
    tracker = create_tracker(name, seed=0, **files)
    tracker.start(video.frame(START), box_at(START))
    for step in range(1, 6):
        center = START[0] + step, START[1] + step
        estimate = tracker.update(video.frame(center))
    assert estimate.box.iou(box_at(center)) > 0.4
    assert estimate.state is TrackState.TRACKING and 0 < estimate.confidence <= 1
    assert np.isnan(estimate.covariance).all() and estimate.covariance.shape == (4, 4)


@pytest.mark.parametrize('name, files', HERE)
def test_a_box_at_the_border_is_no_crash(name, files):
    """Started on a box beyond the border, each runs on, or raises a ValueError with its name."""
    video = DrawnVideo()
    tracker = create_tracker(name, seed=0, **files)
    try:
        tracker.start(video.frame(START), Box(-30, -30, 36, 36))
    except ValueError as error:
        assert name in str(error)
        return
    for _ in range(3):
        assert 0 <= tracker.update(video.frame(START)).confidence <= 1


@pytest.mark.parametrize('name, files', HERE)
def test_after_a_start_that_failed_there_is_no_target(name, files):
    """An update, in which one of OpenCV's may crash then, is an error that says why."""
    frame = DrawnVideo().frame(START)
    for again in (False, True):
        tracker = create_tracker(name, seed=0, **files)
        if again:
            tracker.start(frame, box_at(START))
        try:
            tracker.start(frame, Box(frame.shape[1] - 0.4, 10, 5, 5))
        except ValueError:
            with pytest.raises(RuntimeError, match=r'call start\(frame, box\)'):
                tracker.update(frame)
            tracker.start(frame, box_at(START))
        assert 0 <= tracker.update(frame).confidence <= 1


def test_mil_refuses_a_box_that_is_too_small_for_its_features():
    """Else OpenCV searches a feature forever; so it's tried in a process of its own."""
    code = """
import numpy as np
from vtrack_ros.trackers import Box, create_tracker
frame = np.random.default_rng(0).integers(256, size=(120, 160, 3), dtype=np.uint8)
for width, height in ((1, 60), (2, 10), (3, 5), (4.4, 4), (0.2, 0.3), (2, 11), (3, 6), (5, 4)):
    tracker = create_tracker('opencv_mil', seed=0)
    try:
        tracker.start(frame, Box(70, 40, width, height))
    except ValueError as error:
        print(error)
    else:
        tracker.update(frame)
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    refused = done.stdout.splitlines()
    assert len(refused) == 5
    assert all("opencv_mil can't start on Box(" in one and 'too small' in one for one in refused)


def test_one_that_opencv_lacks_is_refused():
    """The error says which OpenCV it needs; the names of all are listed."""
    lacking = [name for name in tracker_names() if name.startswith('opencv_')
               and not tracker_class(name).available()]
    for name in lacking:
        with pytest.raises(ValueError, match=f'{name} needs an OpenCV with .*{cv2.__version__}'):
            create_tracker(name)
    assert {'opencv_csrt', 'opencv_kcf', 'opencv_mil', 'opencv_nano', 'opencv_vit'} <= {
        *tracker_names()} - {*tracker_names(replicas=False)}


@pytest.mark.skipif(not tracker_class('opencv_nano').available(), reason='needs TrackerNano')
def test_networks_need_their_files():
    """A session refuses to change to one without them, and goes on."""
    session = TrackingSession('gmpf')
    session.start(DrawnVideo().frame(START), 0, box_at(START))
    with pytest.raises(ValueError, match='opencv_nano needs the files backbone, head'):
        session.change(tracker='opencv_nano')
    with pytest.raises(ValueError, match=r'opencv_nano\.head: .*is not a file'):
        session.change(tracker='opencv_nano', parameters={
            'opencv_nano': {**NANO, 'head': '/nowhere.onnx'}})
    assert session.tracker == 'gmpf'
    session.change(tracker='opencv_nano', parameters={'opencv_nano': NANO})
    assert session.update(DrawnVideo().frame(START), 1).box.iou(box_at(START)) > 0.4


@pytest.mark.skipif(not tracker_class('opencv_nano').available(), reason='needs TrackerNano')
def test_a_network_whose_file_has_gone_is_a_value_error(tmp_path):
    """The files are read at each start, and one may have been removed since it was set."""
    files = {name: shutil.copy(path, tmp_path / name) for name, path in NANO.items()}
    tracker = create_tracker('opencv_nano', seed=0, **{
        name: str(path) for name, path in files.items()})
    (tmp_path / 'head').unlink()
    with pytest.raises(ValueError, match="opencv_nano can't start on Box"):
        tracker.start(DrawnVideo().frame(START), box_at(START))
