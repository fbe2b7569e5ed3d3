"""The contract that every tracker of the package (without replicas) fulfils."""

from __future__ import annotations

from functools import cache
import itertools

import cv2
from drawn_video import box_at, DrawnVideo, SIZE, START, straight
import numpy as np
import pytest
from siamese_files import network_files, write_backbone, write_head

from vtrack_ros.geometry import Box
from vtrack_ros.trackers import create_tracker, tracker_class, tracker_names, TrackState

NAMES = tracker_names(replicas=False)
ALL = pytest.mark.parametrize('name', NAMES)


def check(estimate):
    """Check what holds of every estimate."""
    assert np.isfinite(estimate.box.as_array()).all()
    assert 0 <= estimate.confidence <= 1
    assert isinstance(estimate.state, TrackState)
    covariance = estimate.covariance
    assert covariance.shape == (4, 4)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9 * covariance.max())
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert np.isfinite(estimate.angle)


@ALL
@pytest.mark.parametrize('colour', [True, False], ids=['colour', 'grey'])
def test_it_follows_a_moving_target(name, colour):
    """A textured target is tracked: IoU above 0.5 at the end, and mostly in state TRACKING."""
    video = DrawnVideo(colour)
    path = straight(14, (2.0, 1.0))
    tracker = create_tracker(name, seed=1)
    check(tracker.start(video.frame(path[0]), box_at(path[0])))
    overlaps, states = [], []
    for center in path[1:]:
        estimate = tracker.update(video.frame(center))
        check(estimate)
        overlaps.append(estimate.box.iou(box_at(center)))
        states.append(estimate.state)
    assert np.mean(overlaps) > 0.6
    assert min(overlaps[-5:]) > 0.5
    assert states.count(TrackState.TRACKING) >= 0.75 * len(states)


@ALL
def test_the_first_estimate_is_the_given_box(name):
    """It's the box that the user gave, in state TRACKING."""
    video = DrawnVideo()
    estimate = create_tracker(name, seed=1).start(video.frame(START), box_at(START))
    np.testing.assert_allclose(estimate.box.as_array(), box_at(START).as_array(), atol=1e-6)
    assert estimate.state is TrackState.TRACKING


@ALL
def test_the_same_seed_gives_the_same_bits(name):
    """Two trackers of one seed agree bit for bit, also after a new start."""
    path = straight(8, (2.0, -1.0))
    frames = list(DrawnVideo().frames(path))
    outputs = []
    for seed in (3, np.random.default_rng(3)):
        tracker = create_tracker(name, seed=seed)
        rows = []
        for _ in range(2):
            tracker.start(frames[0], box_at(path[0]))
            for frame in frames[1:]:
                estimate = tracker.update(frame)
                rows.append([*estimate.box.as_array(), estimate.angle, estimate.confidence,
                             *estimate.covariance.ravel()])
        outputs.append(np.array(rows))
    np.testing.assert_array_equal(*outputs)


@pytest.mark.parametrize('columns', [200, SIZE[0]])
@pytest.mark.parametrize('colour', [True, False], ids=['colour', 'grey'])
@pytest.mark.parametrize('name', [*NAMES, 'pqkpf_paper'])
def test_frames_may_share_one_array(name, colour, columns):
    """Frames that are written into the same array one after the other give the same output."""
    path = straight(12, (3.0, 1.0))
    frames = [frame[:, :columns] for frame in DrawnVideo(colour).frames(path)]
    shared = np.empty(frames[0].shape, np.uint8)
    outputs = []
    for reused in (False, True):
        tracker = create_tracker(name, seed=1)
        for index, frame in enumerate(frames):
            shared[...] = frame
            given = shared if reused else frame.copy()
            estimate = (tracker.update(given) if index else
                        tracker.start(given, box_at(path[0])))
            outputs.append((estimate.box, estimate.confidence))
    assert outputs[:len(frames)] == outputs[len(frames):]


@ALL
def test_wrong_calls_are_refused_and_do_no_harm(name):
    """Each wrong call says what was wrong, and the tracker goes on as if it hadn't been made."""
    path = straight(4, (1.0, 1.0))
    frames = list(DrawnVideo().frames(path))
    tracker, undisturbed = (create_tracker(name, seed=2) for _ in range(2))
    with pytest.raises(RuntimeError, match='start'):
        tracker.update(frames[0])
    for one in (tracker, undisturbed):
        one.start(frames[0], box_at(path[0]))
    with pytest.raises(TypeError, match='uint8'):
        tracker.update(frames[1].astype(np.float32))
    with pytest.raises(TypeError, match='numpy'):
        tracker.update([[0, 1]])
    with pytest.raises(ValueError, match='shape changed'):
        tracker.update(frames[1][:100])
    with pytest.raises(ValueError, match='shape changed'):
        tracker.update(frames[1][:, :, 0])
    with pytest.raises(ValueError, match='shape'):
        tracker.start(np.zeros((10, 10, 4), np.uint8), box_at(path[0]))
    with pytest.raises(ValueError, match='no pixel inside'):
        tracker.start(frames[0], Box(400, 10, 20, 20))
    with pytest.raises(TypeError, match='Box'):
        tracker.start(frames[0], (1, 2, 3, 4))
    for side in (1.1e6, 1.5e300):
        with pytest.raises(ValueError, match='too large; .* at most 1000000 px'):
            tracker.start(frames[0], Box(20 - side / 2, 10, side, 20))
    for size in ((5e-324, 20), (1e-7, 1e-7), (1e-160, 1e-160), (20, 1e-200)):
        with pytest.raises(ValueError, match='too small; .* at least 1e-06 px'):
            tracker.start(frames[0], Box(0, 0, *size))
    for wrong in ('1', None, [1.0]):
        with pytest.raises(TypeError, match='dt must be a number'):
            tracker.update(frames[1], wrong)
    for dt in (0.0, -1.0, float('nan'), float('inf'), 1e-110, 0.9e-9, 1.1e9, 1e150, 10**400):
        with pytest.raises(ValueError, match='dt must be a number .* from 1e-09 to 1e\\+09, not '):
            tracker.update(frames[1], dt)
    for frame in frames[1:]:
        np.testing.assert_array_equal(tracker.update(frame).box.as_array(),
                                      undisturbed.update(frame).box.as_array())


def test_a_box_without_numbers_cannot_be_made():
    """NaN, infinity and no area are refused before any tracker sees them."""
    for values in ((np.nan, 0, 1, 1), (0, np.inf, 1, 1), (0, 0, 0, 1), (0, 0, 1, -1)):
        with pytest.raises(ValueError, match='box'):
            Box(*values)


@ALL
def test_wrong_parameters_are_refused(name):
    """Unknown names, numbers beyond either bound, wrong types and wrong choices raise errors."""
    table = tracker_class(name).PARAMETERS
    with pytest.raises(ValueError, match='unknown parameter of ' + name + ': .no_such_parameter'):
        create_tracker(name, no_such_parameter=1)
    for row in table.values():
        if row.kind in (int, float) and not row.choices:
            for value in (row.kind(row.low - 1), row.kind(row.high + 1), 10**400, -10**400):
                with pytest.raises(ValueError, match=row.name):
                    create_tracker(name, **{row.name: value})
            with pytest.raises(TypeError, match=row.name):
                create_tracker(name, **{row.name: 'many'})
        if row.choices:
            wrong = 'no such choice' if row.kind is str else max(row.choices) + 1
            with pytest.raises(ValueError, match=f'{row.name} must be one of {row.choices[0]}, '):
                create_tracker(name, **{row.name: wrong})


@ALL
def test_every_parameter_may_change_while_it_runs(name):
    """Each number is raised by a fifth while it runs, and the target is kept."""
    path = straight(14, (1.5, 0.5))
    frames = list(DrawnVideo().frames(path))
    tracker = create_tracker(name, seed=1)
    tracker.start(frames[0], box_at(path[0]))
    for frame in frames[1:4]:
        tracker.update(frame)
    changes = {}
    for row in tracker_class(name).PARAMETERS.values():
        if row.dynamic and row.kind in (int, float) and row.low is not None:
            value = row.kind(1.2 * row.default)
            changes[row.name] = min(max(value, row.low), row.high)
    tracker.configure(**changes)
    assert {key: tracker.parameters[key] for key in changes} == changes
    for frame, center in zip(frames[4:], path[4:]):
        estimate = tracker.update(frame)
        check(estimate)
    assert estimate.box.iou(box_at(center)) > 0.4


@ALL
def test_a_change_is_made_whole_or_not_at_all(name):
    """If one value is wrong, the valid ones aren't set either."""
    tracker = create_tracker(name, seed=1)
    before = tracker.parameters
    rows = tracker_class(name).PARAMETERS.values()
    for right, wrong in itertools.permutations([row for row in rows if row.high is not None], 2):
        with pytest.raises(ValueError):
            tracker.configure(**{right.name: right.high, wrong.name: wrong.kind(wrong.high + 1)})
    assert tracker.parameters == before


@ALL
def test_dropped_frames_are_bridged(name):
    """With only every third frame, and dt = 3, a target at 2 px per frame is tracked."""
    video = DrawnVideo()
    path = straight(24, (2.0, 0.5))[::3]
    tracker = create_tracker(name, seed=1)
    tracker.start(video.frame(path[0]), box_at(path[0]))
    for center in path[1:]:
        estimate = tracker.update(video.frame(center), 3.0)
        check(estimate)
    assert estimate.box.iou(box_at(center)) > 0.4


@ALL
def test_it_says_so_when_the_target_leaves_the_image(name):
    """When the target has left, boxes stay bounded, and the state isn't TRACKING in the end."""
    video = DrawnVideo()
    start = (250.0, 110.0)
    path = [(start[0] + 5 * i, start[1]) for i in range(21)]
    tracker = create_tracker(name, seed=1)
    tracker.start(video.frame(start), box_at(start))
    estimates = []
    for center in [*path[1:], *[None] * 14]:
        estimate = tracker.update(video.frame(center))
        check(estimate)
        assert 0.1 * box_at(start).area < estimate.box.area < 36 * box_at(start).area
        estimates.append(estimate)
    absent = estimates[-10:]
    assert sum(estimate.state is not TrackState.TRACKING for estimate in absent) >= 8
    first = np.mean([estimate.confidence for estimate in estimates[:3]])
    assert np.mean([estimate.confidence for estimate in absent]) < first


@ALL
def test_no_box_depends_on_what_confidence_is_enough(name):
    """confidence_threshold has an effect on the state, but not on box and confidence."""
    video = DrawnVideo()
    path = [*straight(8, (2.0, 1.0)), *[None] * 6, *straight(20, (2.0, 1.0))[14:]]
    trackers = [create_tracker(name, confidence_threshold=value, seed=1)
                for value in (0.05, 0.95)]
    first = video.frame(path[0])
    for tracker in trackers:
        tracker.start(first, box_at(path[0]))
    states = []
    for frame in map(video.frame, path[1:]):
        lenient, strict = (tracker.update(frame) for tracker in trackers)
        np.testing.assert_array_equal(lenient.box.as_array(), strict.box.as_array())
        assert lenient.confidence == strict.confidence
        states.append((lenient.state, strict.state))
    assert any(lenient is TrackState.TRACKING is not strict for lenient, strict in states)


@ALL
@pytest.mark.parametrize('shape, box', [
    ((120, 160, 3), Box(80, 60, 1, 1)),
    ((120, 160), Box(80, 60, 1, 1)),
    ((120, 160, 3), Box(80.3, 60.8, 0.2, 0.3)),
    ((120, 160, 3), Box(-50, -40, 300, 250)),
    ((120, 160, 3), Box(-30, -30, 31, 31)),
    ((120, 160, 3), Box(70, 20, 1, 90)),
    ((12, 16, 3), Box(4, 3, 8, 6)),
    ((12, 16), Box(4, 3, 8, 6)),
    ((1, 1, 3), Box(0, 0, 1, 1)),
    ((1, 40, 3), Box(10, 0, 10, 1)),
], ids=['one pixel', 'one pixel, grey', 'less than a pixel', 'larger than the image',
        'one pixel inside', 'one column', 'tiny frame', 'tiny frame, grey', 'frame of one pixel',
        'frame of one row'])
def test_odd_sizes_do_no_harm(name, shape, box):
    """Boxes and frames of any size give finite estimates, textured or not."""
    rng = np.random.default_rng(5)
    for contrast in (256, 1):
        frames = [rng.integers(contrast, size=shape, dtype=np.uint8) for _ in range(3)]
        tracker = create_tracker(name, seed=1)
        check(tracker.start(frames[0], box))
        for frame in frames[1:]:
            check(tracker.update(frame))
        check(tracker.update(frames[0], 0.37))


@ALL
def test_frames_of_one_colour_each_do_no_harm(name):
    """In uniform frames of changing brightness, as of a covered lens, estimates stay finite."""
    rng = np.random.default_rng(4)
    for _ in range(8):
        tracker = create_tracker(name, seed=1)
        frames = [np.full((48, 64, 3), colour, np.uint8) for colour in rng.integers(256, size=5)]
        tracker.start(frames[0], Box(*rng.uniform(5, 40, 2), *rng.uniform(1, 6, 2)))
        for frame in frames[1:]:
            check(tracker.update(frame))


@pytest.mark.filterwarnings('error::RuntimeWarning')
@ALL
def test_a_pause_of_any_length_leaves_the_covariance_within_the_image(name):
    """After any pause the centre's standard deviation is below three times the image's side."""
    path = straight(8, (3.0, 0.0))
    frames = list(DrawnVideo().frames(path))
    for pause in (1e2, 1e3, 1e5, 1e9):
        tracker = create_tracker(name, seed=1)
        tracker.start(frames[0], box_at(path[0]))
        for frame in frames[1:]:
            tracker.update(frame)
        for _ in range(3):
            covariance = tracker.update(frames[-1], pause).covariance
            assert np.sqrt(covariance.diagonal()[:2]).max() < 3 * max(SIZE)


@pytest.mark.parametrize('pause, seed', [(5, 4), (10, 6), (10, 10), (20, 1)])
@pytest.mark.parametrize('name', [
    name for name in NAMES if 'localiser' in tracker_class(name).PARAMETERS])
def test_a_target_found_after_a_pause_is_as_certain_as_before(name, pause, seed):
    """Once it's found, its standard deviation is less than three times that before the pause."""
    path = straight(9 + pause, (2.0, 0.0))
    video = DrawnVideo()
    tracker = create_tracker(name, seed=seed)
    tracker.start(video.frame(path[0]), box_at(path[0]))
    for center in path[1:9]:
        before = tracker.update(video.frame(center))
    after = tracker.update(video.frame(path[-1]), float(pause))
    assert after.measured and after.box.iou(box_at(path[-1])) > 0.8
    ratio = after.covariance.diagonal()[:2] / before.covariance.diagonal()[:2]
    assert np.sqrt(ratio).max() < 3


@pytest.mark.parametrize('seed', [18, 44, 47])
@pytest.mark.parametrize('name', [
    name for name in NAMES if 'localiser' in tracker_class(name).PARAMETERS])
def test_a_place_far_away_leaves_the_covariance_positive(name, seed):
    """For a huge target predicted far outside the image, rounding makes no variance negative."""
    rng = np.random.default_rng(seed)
    frames = [rng.integers(256, size=(30, 40, 3), dtype=np.uint8) for _ in range(5)]
    size = 10**rng.uniform(1, 4, 2)
    tracker = create_tracker(name, seed=1, localiser='siamese', **network_files())
    tracker.start(frames[0], Box(*(20, 15) - size * rng.uniform(0.3, 0.7, 2), *size))
    for frame, dt in zip(frames[1:], (1.0, 1e9, 1e9, 1e9)):
        covariance = tracker.update(frame, dt).covariance
        assert np.linalg.eigvalsh(covariance).min() > -1e-12 * covariance.max()


@cache
def crossing(gone):
    """Return frames of a shaking, rotating, growing target that is partly, then fully hidden."""
    video = DrawnVideo(seed=3)
    rng = np.random.default_rng(1)
    frames = []
    for index in range(24):
        shake = rng.uniform(-8, 8, 2)
        center = (START[0] + 3.0 * index + shake[0], START[1] - 1.5 * index + shake[1])
        frame = video.frame(None if gone <= index < 18 else center)
        if 9 <= index < 12:
            frame[:, int(center[0]):int(center[0]) + 40] = 90
        frames.append(cv2.warpAffine(frame, cv2.getRotationMatrix2D(
            center, 4.0 * index, 1 + 0.01 * index), SIZE, borderMode=cv2.BORDER_REFLECT))
    return frames


def outcomes(name, **changes):
    """Yield all numbers of each estimate of two runs with some parameters changed."""
    for frames in crossing(15), crossing(12):
        tracker = create_tracker(name, seed=1, **changes)
        tracker.start(frames[0], box_at(START))
        for index, frame in enumerate(frames[1:]):
            estimate = tracker.update(frame, 1.0 + (index % 5 == 0))
            yield np.array(
                [*estimate.box.as_array(), estimate.angle, *estimate.covariance.ravel()])


@cache
def usual_outcomes(name):
    """Return the outcomes of the parameters' defaults."""
    return list(outcomes(name))


def differ_by_networks(name, parameter, folder):
    """Tell whether some estimate differs with another network's file, or without a network."""
    chosen = {'localiser': 'siamese', **network_files()}
    other = {'localiser': lambda: 'dcf',
             'siamese.backbone': lambda: write_backbone(folder / 'backbone.onnx', gain=2.0),
             'siamese.head': lambda: write_head(folder / 'head.onnx', gain=2.0)}[parameter]()
    return any(not np.array_equal(one, usual) for one, usual in zip(
        outcomes(name, **{**chosen, parameter: other}), outcomes(name, **chosen)))


@pytest.mark.parametrize('name, parameter', [
    (name, parameter) for name in NAMES for parameter in tracker_class(name).PARAMETERS])
def test_every_parameter_has_an_effect(name, parameter, tmp_path):
    """At one end of its range, or with another choice, some number of some estimate differs."""
    row = tracker_class(name).PARAMETERS[parameter]
    if parameter in ('localiser', *network_files()):
        assert differ_by_networks(name, parameter, tmp_path)
        return
    values = row.choices or ((False, True) if row.kind is bool else (row.low, row.high))
    if parameter == 'particles':
        values = (row.low, 2 * row.default)
    # A run ends with the first estimate that differs.
    assert any(not np.array_equal(one, usual)
               for value in values if value != row.default
               for one, usual in zip(outcomes(name, **{parameter: value}), usual_outcomes(name)))
