"""The papers' methods and their baselines, corrected and as printed, on drawn targets."""

from __future__ import annotations

from functools import lru_cache
import math

import cv2
from drawn_ellipse import ellipse
from drawn_video import box_at, DrawnVideo, straight
import numpy as np
import pytest

from vtrack_ros.estimation import (
    ConstantVelocity, GaussianFilterProposal, GaussianNoise, GreyProposal, KalmanFilter,
    ParticleFilter)
from vtrack_ros.geometry import Box
from vtrack_ros.replicas import REPLICAS
from vtrack_ros.replicas.box_filter import BoxParticleFilter
from vtrack_ros.replicas.cues import BoxCues
from vtrack_ros.replicas.dynamics import motion_model
from vtrack_ros.tracker import TrackState

BY_NAME = {replica.NAME: replica for replica in REPLICAS}
SWITCHED = tuple(name for name, replica in BY_NAME.items() if 'as_printed' in replica.PARAMETERS)
ELLIPSES = ('abmspf_paper', 'abms_paper')
AFFINE = ('appf_paper', 'affine_pf_paper', 'ppca_paper')
EACH = pytest.mark.parametrize('name', BY_NAME)
EVERY_FORM = pytest.mark.parametrize(
    ('name', 'parameters'),
    [(name, {}) for name in BY_NAME] + [(name, {'as_printed': True}) for name in SWITCHED])


@lru_cache
def video(count=10, step=(2.0, 1.0), colour=True):
    """Return frames of a target that moves straight on, and its true boxes."""
    path = straight(count, step)
    return tuple(DrawnVideo(colour).frames(path)), tuple(box_at(place) for place in path)


def tracked(name, frames, box, seed=1, dt=1.0, **parameters):
    """Return a replica's estimates."""
    tracker = BY_NAME[name](seed, **parameters)
    estimates = [tracker.start(frames[0], box)]
    for frame in frames[1:]:
        estimates.append(tracker.update(frame, dt))
        check(estimates[-1])
    return estimates


def check(estimate):
    """Check what holds of every estimate."""
    assert np.isfinite(estimate.box.as_array()).all()
    assert 0 <= estimate.confidence <= 1
    covariance = estimate.covariance
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9 * covariance.max())
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_the_papers_trackers_are_all_there():
    """Four methods and seven baselines; those that needed no correction have no `as_printed`."""
    assert list(BY_NAME) == [f'{name}_paper' for name in (
        'gmpf', 'pqkpf', 'abmspf', 'appf', 'pf', 'kpf', 'upf', 'qkpf', 'abms', 'affine_pf',
        'ppca')]
    assert set(BY_NAME) - set(SWITCHED) == {'pf_paper', 'affine_pf_paper', 'ppca_paper'}
    assert not any('preset' in replica.PARAMETERS for replica in REPLICAS)


@EACH
@pytest.mark.parametrize('colour', [True, False], ids=['colour', 'grey'])
def test_it_follows_a_moving_target(name, colour):
    """A textured target is tracked: IoU above 0.5 at the end, and mostly in state TRACKING."""
    frames, boxes = video(12, colour=colour)
    estimates = tracked(name, frames, boxes[0])
    np.testing.assert_allclose(
        estimates[0].box.as_array(), boxes[0].as_array(), atol=1e-6)
    overlaps = [estimate.box.iou(box) for estimate, box in zip(estimates, boxes)]
    assert np.mean(overlaps) > 0.6
    assert min(overlaps[-3:]) > 0.5
    states = [estimate.state for estimate in estimates]
    assert states.count(TrackState.TRACKING) >= 0.75 * len(states)


@EVERY_FORM
def test_the_same_seed_gives_the_same_bits(name, parameters):
    """Two trackers of one seed agree bit for bit, also after a new start."""
    frames, boxes = video()
    runs = []
    for _ in range(2):
        tracker = BY_NAME[name](np.random.default_rng(3), **parameters)
        rows = []
        for _ in range(2):
            tracker.start(frames[0], boxes[0])
            for frame in frames[1:5]:
                estimate = tracker.update(frame)
                rows.append([*estimate.box.as_array(), estimate.angle, estimate.confidence,
                             *estimate.covariance.ravel()])
        runs.append(rows)
    np.testing.assert_array_equal(*runs)


@pytest.mark.parametrize('name', SWITCHED)
def test_the_switch_changes_the_boxes_from_the_next_start_on(name):
    """`as_printed` changes the boxes if set before the start, but not if set while it runs."""
    frames, boxes = video()
    corrected = [estimate.box for estimate in tracked(name, frames, boxes[0])]
    printed = [estimate.box for estimate in tracked(name, frames, boxes[0], as_printed=True)]
    assert corrected != printed
    tracker = BY_NAME[name](1)
    switched = [tracker.start(frames[0], boxes[0]).box]
    tracker.configure(as_printed=True)
    assert tracker.parameters['as_printed'] is True
    assert switched + [tracker.update(frame).box for frame in frames[1:]] == corrected


@EVERY_FORM
def test_every_parameter_may_change_while_it_runs(name, parameters):
    """Each number is raised by a fifth while it runs; estimates stay valid."""
    frames, boxes = video()
    tracker = BY_NAME[name](1, **parameters)
    tracker.start(frames[0], boxes[0])
    for frame in frames[1:4]:
        tracker.update(frame)
    changes = {}
    for row in BY_NAME[name].PARAMETERS.values():
        if row.kind in (int, float) and row.low is not None:
            changes[row.name] = min(max(row.kind(1.2 * row.default), row.low), row.high)
    tracker.configure(**changes)
    assert {key: tracker.parameters[key] for key in changes} == changes
    for frame in frames[4:]:
        check(tracker.update(frame))


@EACH
def test_dropped_frames_are_bridged(name):
    """With only every third frame, and dt = 3, a target at 2 px per frame is tracked."""
    frames, boxes = video(24, (2.0, 0.5))
    estimates = tracked(name, frames[::3], boxes[0], dt=3.0)
    assert estimates[-1].box.iou(boxes[::3][-1]) > 0.4


def left(count):
    """Return frames of a target that leaves at the right border, and its first box."""
    drawn = DrawnVideo()
    path = [(250.0 + 8 * index, 110.0) for index in range(13)] + [None] * count
    return [drawn.frame(place) for place in path], box_at(path[0])


@EACH
def test_it_says_so_when_the_target_has_left(name):
    """When the target has left, boxes stay bounded, and the state isn't TRACKING in the end."""
    frames, box = left(18)
    estimates = tracked(name, frames, box)
    assert all(0.04 < estimate.box.area / box.area < 36 for estimate in estimates)
    absent = [estimate.state for estimate in estimates[-8:]]
    # the PPCA learns the border while the target leaves, and tracks it in 5 films of 12
    assert name == 'ppca_paper' or absent.count(TrackState.TRACKING) <= 1


@pytest.mark.parametrize('name', SWITCHED)
def test_as_printed_estimates_stay_finite_when_the_target_has_left(name):
    """As printed they may lose the target, but estimates stay finite and nothing is raised."""
    frames, box = left(8)
    tracked(name, frames, box, as_printed=True)


@EVERY_FORM
@pytest.mark.parametrize('shape, box', [
    ((120, 160), Box(80.3, 60.8, 0.2, 0.3)), ((120, 160, 3), Box(-50, -40, 300, 250)),
    ((1, 40, 3), Box(10, 0, 10, 1))], ids=['less than a pixel', 'larger than the image', 'a row'])
def test_odd_sizes_do_no_harm(name, parameters, shape, box):
    """Boxes and frames of any size give finite estimates, textured or not."""
    rng = np.random.default_rng(5)
    for contrast in (256, 1):
        frames = [rng.integers(contrast, size=shape, dtype=np.uint8) for _ in range(3)]
        tracked(name, frames, box, dt=0.37, **parameters)


def run_by_hand(frames, box, proposal, weighting, measures):
    """Yield the boxes of a bare particle filter with the papers' colour cue."""
    side = math.sqrt(box.area)
    model = ConstantVelocity(2, 2, (0.2 * side)**2, (0.01 * side)**2)
    bare = ParticleFilter(model, proposal(model), particles=150, threshold=1.0,
                          weighting=weighting, rng=np.random.default_rng(1))
    cues = BoxCues(edges=False, kernel='flat')
    cues.sigma = 0.1
    first = np.array([*box.center, box.width, box.height])
    cues.start(frames[0], first)
    bare.start([*first[:2], 0, 0, *first[2:]],
               np.diag((np.array([0.03, 0.03, 0.05, 0.05, 0.02, 0.02]) * side)**2))
    found = first
    for frame in frames[1:]:
        predicted = found + [*bare.belief.mean[2:4], 0, 0]
        cues.observe(frame, predicted)
        center, error = None, None
        if measures:
            center, covariance = cues.measure(predicted, math.sqrt(found[2] * found[3]))
            error = GaussianNoise.from_covariance(covariance)
        step = bare.step(
            center, 1.0, lambda states: cues.log_likelihood(states[:, [0, 1, 4, 5]]), error)
        found = step.mean[[0, 1, 4, 5]]
        yield found


@pytest.mark.parametrize('name, proposal, weighting, measures', [
    ('gmpf_paper', lambda _: GreyProposal(5, 1.0, None, 'forecast'), 'simplified', False),
    ('kpf_paper', lambda model: GaussianFilterProposal(KalmanFilter(model), 'kept'), 'full', True),
], ids=['GMPF: eqs 9-18', 'KPF: eq. 5, covariances kept'])
def test_as_printed_is_the_bare_particle_filter(name, proposal, weighting, measures):
    """GMPF: raw GM(1,1), spread of eq. 17. KPF: full weights, a covariance for each particle."""
    frames, boxes = video(9, (1.0, 0.5))
    expected = run_by_hand(frames, boxes[0], proposal, weighting, measures)
    for estimate, box in zip(tracked(name, frames, boxes[0], as_printed=True)[1:], expected):
        found = [*estimate.box.center, estimate.box.width, estimate.box.height]
        np.testing.assert_allclose(found, box, rtol=1e-6)


def test_grey_particles_collapse_without_process_noise():
    """With eq. 17 as printed and no `floor`, the spread shrinks as resampling merges particles."""
    frames, boxes = video(30, (0.0, 0.0))
    spreads = {}
    for floor in (0.0, 1.0):
        last = tracked('gmpf_paper', frames, boxes[0], as_printed=True, floor=floor)[-1]
        spreads[floor] = last.particles[:, 2].std()
    assert spreads[0.0] < 0.5 * spreads[1.0]


def test_both_cues_are_selectable_for_every_box_filter():
    """PF with both cues is a baseline of Qi and Li; each rule of fusion gives other boxes."""
    frames, boxes = video(8, (3.0, 0.0))
    runs = {fusion: tracked('pf_paper', frames, boxes[0], cues='colour+motion_edge',
                            fusion=fusion)[-1].box
            for fusion in ('dempster_shafer', 'product', 'sum', 'normalised')}
    assert len(set(map(str, runs.values()))) == 4
    boxed = [replica for replica in REPLICAS if issubclass(replica, BoxParticleFilter)]
    assert len(boxed) == 6 and all('cues' in replica.PARAMETERS for replica in boxed)


@pytest.mark.parametrize('name', ELLIPSES)
def test_growth_is_followed(name):
    """A target that grows by 1.5 % a frame has the box of its size at the end."""
    places = [(60 + 4 * index, 120 + 10 * math.sin(index / 4)) for index in range(30)]
    frames = [ellipse(place, (24 * 1.015**index, 18 * 1.015**index), seed=index)
              for index, place in enumerate(places)]
    last = tracked(name, frames, Box.from_center(*places[0], 48, 36))[-1].box
    truth = Box.from_center(*places[-1], 48 * 1.015**29, 36 * 1.015**29)
    assert last.iou(truth) > 0.7
    assert math.sqrt(last.area / truth.area) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize('name', ELLIPSES)
def test_as_printed_the_box_is_a_quarter_too_large(name):
    """The moment of a uniform ellipse isn't its bandwidth [Yin2013, eq. 11]: 1.25 of each axis."""
    frames = [ellipse((160, 120), (40, 30), seed=index) for index in range(15)]
    start = Box.from_center(160, 120, 80, 60)
    sizes = [math.sqrt(tracked(name, frames, start, as_printed=printed)[-1].box.area / start.area)
             for printed in (False, True)]
    assert sizes == pytest.approx([1.0, 1.25], abs=0.06)


def test_rotation_of_an_ellipse_is_reported():
    """The angle is that of the drawn ellipse, clockwise positive, from the start on."""
    frames = [ellipse((160, 120), (50, 22), math.radians(3 * index), seed=index)
              for index in range(20)]
    angle = tracked('abmspf_paper', frames, Box.from_center(160, 120, 100, 44))[-1].angle
    assert angle == pytest.approx(math.radians(57), abs=math.radians(10))


@pytest.mark.parametrize('name', ELLIPSES)
def test_a_hidden_target_is_not_claimed_and_is_found_again(name):
    """Hidden for 15 frames, it's seldom said to be tracked, and it's tracked again afterwards."""
    places = [(60 + 2 * index, 120) for index in range(42)]
    frames = [ellipse((-100, -100) if 15 <= index < 30 else place, (24, 18), seed=index)
              for index, place in enumerate(places)]
    estimates = tracked(name, frames, Box.from_center(*places[0], 48, 36))
    hidden = estimates[15:30]
    assert sum(estimate.state is TrackState.TRACKING for estimate in hidden) <= 3
    assert np.mean([estimate.confidence for estimate in hidden]) < 0.4
    assert estimates[-1].state is TrackState.TRACKING
    assert estimates[-1].box.iou(Box.from_center(*places[-1], 48, 36)) > 0.5


def turning(count, turn):
    """Return frames of a textured card, 60 x 44 px, that turns by `turn` a frame, and its box."""
    rng = np.random.default_rng(2)
    card = cv2.resize(rng.integers(0, 256, (8, 10, 3), dtype=np.uint8), (60, 44),
                      interpolation=cv2.INTER_CUBIC)
    ground = 90 + cv2.resize(rng.integers(0, 40, (16, 21, 3), dtype=np.uint8), (320, 240))
    frames = []
    for index in range(count):
        matrix = cv2.getRotationMatrix2D((29.5, 21.5), -math.degrees(turn * index), 1.0)
        matrix[:, 2] += (160 - 30, 120 - 22)
        frame = ground.copy()
        cv2.warpAffine(card, matrix, (320, 240), dst=frame, borderMode=cv2.BORDER_TRANSPARENT)
        frames.append(np.clip(frame + rng.normal(0, 3, frame.shape), 0, 255).astype(np.uint8))
    return frames, Box.from_center(160, 120, 60, 44)


@pytest.mark.parametrize('parameters', [{}, {'as_printed': True}], ids=['corrected', 'printed'])
def test_keypoints_hold_a_faster_rotation_than_the_process_alone(parameters):
    """With keypoints (as printed: of consecutive frames) the angle's error is below a half."""
    frames, box = turning(9, 0.1)
    errors = {}
    for keypoints in (True, False):
        last = tracked('appf_paper', frames, box, 0, keypoints=keypoints, rotation_noise=0.005,
                       ar=0.0, **parameters)[-1]
        errors[keypoints] = abs(last.angle - 0.8)  # clockwise is positive
    assert errors[True] < 0.15
    assert errors[True] < 0.5 * errors[False]


@pytest.mark.parametrize('name', AFFINE[:2])
def test_the_box_bounds_the_affine_frame(name):
    """It maps the unit square about the origin onto the target; the box holds its corners."""
    frames, box = turning(8, 0.03)
    estimate = tracked(name, frames, box)[-1]
    assert estimate.angle == pytest.approx(0.21, abs=0.1)
    corners = estimate.affine @ np.array(
        [[0.5, 0.5, -0.5, -0.5], [0.5, -0.5, 0.5, -0.5], [1, 1, 1, 1]])
    found = estimate.box
    np.testing.assert_allclose(corners[:2].min(1), (found.x, found.y), atol=1e-9)
    np.testing.assert_allclose(
        corners[:2].max(1), (found.x + found.width, found.y + found.height), atol=1e-9)


def test_the_terms_of_the_affine_baselines():
    """Only APPF has keypoints, and PPCA has no colour."""
    tables = {name: BY_NAME[name].PARAMETERS for name in AFFINE}
    assert [name for name, table in tables.items() if 'keypoints' in table] == ['appf_paper']
    assert [name for name, table in tables.items() if 'colour_sigma' in table] == [
        'appf_paper', 'affine_pf_paper']


@pytest.mark.parametrize('name', ['pf_paper', 'gmpf_paper', 'kpf_paper', 'upf_paper'])
@pytest.mark.parametrize('dynamics', ['random_walk', 'constant_velocity', 'white_acceleration'])
def test_box_filters_follow_with_any_dynamics(name, dynamics):
    """A target that moves by 2 px per frame is tracked with each of the dynamics."""
    frames, boxes = video(10, (2.0, 1.0))
    last = tracked(name, frames, boxes[0], dynamics=dynamics, noise=0.15)[-1]
    assert last.box.iou(boxes[-1]) > 0.5


@pytest.mark.parametrize('dynamics, moved', [
    ('random_walk', 0.0), ('constant_velocity', 6.0), ('white_acceleration', 6.0)])
def test_dynamics_say_how_places_move(dynamics, moved):
    """Velocities move places except in a random walk; the noise per frame is the one given."""
    model = motion_model(dynamics, 3.0, 0.5)
    state = np.array([[10.0, 20.0, 3.0, -1.0, 30.0, 40.0]])
    np.testing.assert_allclose(
        model.transition(state, 2.0) - state, [[moved, -moved / 3, 0, 0, 0, 0]])
    noise = np.diag(model.process_noise(1.0))
    np.testing.assert_allclose(noise[[2 if dynamics == 'white_acceleration' else 0, 4]], [9, 0.25])
    assert np.linalg.eigvalsh(model.process_noise(2.0)).min() > 0


def test_the_stage_of_the_search_is_told():
    """It's `track`, `none` while the target is hidden, and that of the search when it's found."""
    drawn = DrawnVideo()
    tracker = BY_NAME['abmspf_paper'](1)
    tracker.start(drawn.frame((150.0, 110.0)), box_at((150.0, 110.0)))
    stages = []
    for place in [(150.0, 110.0)] * 3 + [None] * 14 + [(150.0, 110.0)] * 2:
        tracker.update(drawn.frame(place))
        stages.append(tracker.stage)
    assert stages[:3] == ['track'] * 3 and stages[10] == 'none'
    assert stages[17] in ('ahead', 'near', 'everywhere') and stages[18] == 'track'
