"""Mean shift, bandwidth and fusion as in the paper, and its trackers on drawn targets."""

import math

import cv2
import numpy as np
import pytest

from vtrack_ros.appearance.ellipse_colours import EllipseColours
from vtrack_ros.geometry import Box
from vtrack_ros.localisation.mean_shift import climb, fuse
from vtrack_ros.tracker import TrackState
from vtrack_ros.trackers.registry import create_tracker

PRESETS = ('default', 'paper')
TRACKERS = ('abmspf', 'abms')


def drawn(center, axes, angle=0.0, shape=(240, 320), colour=True, seed=0):
    """Draw a two-coloured ellipse, of semi-axes in pixels, on a noisy background."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:shape[0], :shape[1]] + 0.5
    x, y = x - center[0], y - center[1]
    along = (x * math.cos(angle) + y * math.sin(angle)) / axes[0]
    across = (y * math.cos(angle) - x * math.sin(angle)) / axes[1]
    frame = np.full((*shape, 3), (90, 100, 80), np.float64)
    frame[along**2 + across**2 <= 1] = (40, 60, 200)
    frame[(along - 0.2)**2 + (across + 0.1)**2 <= 0.2] = (220, 200, 40)
    frame = np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8)
    return frame if colour else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)


def matrix(major, minor, angle=0.0):
    """Return an ellipse's frame, from the unit disc to the image."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin], [sin, cos]]) @ np.diag([major, minor])


@pytest.mark.parametrize('colour', [True, False])
def test_the_target_itself_is_most_like_itself(colour):
    """Bhattacharyya's coefficient is 1 at the target, less beside it, 0 on its background."""
    frame = drawn((160, 120), (40, 20), colour=colour)
    center = np.array([160.0, 120.0])
    model = EllipseColours.create(frame, center, matrix(40, 20))
    scores = model.coefficients(
        frame, center + [(0, 0), (15, 0), (60, 0), (0, 90)], matrix(40, 20))
    assert scores[0] == pytest.approx(1.0, abs=1e-6)
    assert scores[0] > scores[1] > scores[2]
    assert scores[3] < 0.1


def test_what_leaves_the_image_has_no_likeness():
    """Half a target beyond the border is less alike, a whole one not at all."""
    frame = drawn((0, 120), (40, 20))
    model = EllipseColours.create(
        drawn((160, 120), (40, 20)), np.array([160.0, 120.0]), matrix(40, 20))
    half, none = model.coefficients(frame, np.array([[0.0, 120.0], [-50.0, 120.0]]),
                                    matrix(40, 20))
    assert none == 0
    assert 0.5 < half < 0.9


def test_all_candidates_at_once_are_as_one_by_one():
    """Scoring is a function of the candidate alone."""
    frame = drawn((160, 120), (40, 20))
    model = EllipseColours.create(frame, np.array([160.0, 120.0]), matrix(40, 20))
    centers = np.random.default_rng(2).uniform(0, 240, (30, 2))
    together = model.coefficients(frame, centers, matrix(30, 30))
    alone = [model.coefficients(frame, center[None], matrix(30, 30))[0] for center in centers]
    assert together == pytest.approx(alone)


def test_the_climb_ends_on_the_target():
    """Mean shift raises the likeness and stops at the target's centre."""
    start = np.array([160.0, 120.0])
    model = EllipseColours.create(drawn(start, (40, 20)), start, matrix(40, 20))
    frame = drawn((185, 128), (40, 20), seed=1)
    place = model.climb(frame, start, matrix(40, 20), steps=30)
    assert place == pytest.approx([185, 128], abs=2)


def axes_of(form):
    """Return the lengths of a frame's axes."""
    return np.linalg.svd(form, compute_uv=False)


def test_an_unchanged_target_keeps_its_bandwidth():
    """A target whose weights are as they were is a fixed point: it doesn't grow by 1.56."""
    center, form = np.array([160.0, 120.0]), matrix(40, 20)
    model = EllipseColours.create(drawn(center, (40, 20)), center, form)
    for seed in range(5):
        form = form @ model.growth(drawn(center, (40, 20), seed=seed), center, form)
    assert axes_of(form) == pytest.approx([40, 20], rel=0.03)


def test_the_moment_of_a_uniform_ellipse_is_a_quarter():
    """The factor 4 / sigma^2 of eq. 11: the normalisation undoes a moment of 1/4 of the frame."""
    center, form = np.array([160.0, 120.0]), matrix(40, 20)
    model = EllipseColours.create(drawn(center, (40, 20)), center, form)
    assert model.moment @ model.moment == pytest.approx(4 * np.eye(2), rel=0.15, abs=0.1)


@pytest.mark.parametrize('factor', [0.8, 1.25])
def test_the_bandwidth_follows_growth_and_shrinkage(factor):
    """The axes converge on the drawn ones."""
    center, form = np.array([160.0, 120.0]), matrix(40, 20)
    model = EllipseColours.create(drawn(center, (40, 20)), center, form)
    frame = drawn(center, (40 * factor, 20 * factor))
    for _ in range(8):
        form = form @ model.growth(frame, center, form)
    assert axes_of(form) == pytest.approx([40 * factor, 20 * factor], rel=0.08)


def test_the_bandwidth_follows_rotation():
    """A target that turns by 3 degrees a frame has its angle in the bandwidth matrix."""
    center, form = np.array([160.0, 120.0]), matrix(40, 20)
    model = EllipseColours.create(drawn(center, (40, 20)), center, form)
    for index in range(1, 11):
        angle = math.radians(3 * index)
        form = form @ model.growth(drawn(center, (40, 20), angle), center, form)
    bandwidth = form @ form.T
    found = 0.5 * math.atan2(2 * bandwidth[0, 1], bandwidth[0, 0] - bandwidth[1, 1])
    assert found == pytest.approx(math.radians(30), abs=math.radians(5))


@pytest.mark.parametrize('zeta, best, expected', [
    (0.9, (1.0, 0.0), (0.1, 0.0)),     # eq. 13: they agree, weighted by the likeness
    (0.9, (10.0, 0.0), (0.0, 0.0)),    # eq. 13: mean shift where they're compatible
    (0.9, (30.0, 0.0), None),          # eq. 13: they contradict each other
    (0.6, (10.0, 0.0), (10.0, 0.0)),   # eq. 14: the particles where the target changed
    (0.6, (30.0, 0.0), None),
    (0.5, (30.0, 0.0), (30.0, 0.0)),   # eq. 15: hidden, the particles alone
])
def test_fusion_is_that_of_equations_13_to_15(zeta, best, expected):
    """Every case of the fusion rule."""
    place = fuse(zeta, (0.0, 0.0), best, 2.5, 20.0, 0.8, 0.5)
    assert place == (None if expected is None else pytest.approx(expected))


def test_a_climb_on_a_map_ends_on_its_nearest_hill():
    """Between two hills the nearer one is climbed, to a fraction of a cell."""
    y, x = np.mgrid[:30, :40].astype(np.float64)
    hills = np.exp(-((x - 10.3)**2 + (y - 12.6)**2) / 8) + np.exp(
        -((x - 30)**2 + (y - 20)**2) / 8)
    found = climb(hills, np.array([12.0, 10.0]), np.array([1.5, 1.5]), 50)
    assert found == pytest.approx([10.3, 12.6], abs=0.05)
    assert climb(hills, np.array([28.0, 18.0]), np.array([1.5, 1.5]), 50) == pytest.approx(
        [30, 20], abs=0.05)


def followed(name, frames, box, steps=None, **parameters):
    """Return a tracker's estimates."""
    tracker = create_tracker(name, seed=3, **parameters)
    estimates = [tracker.start(frames[0], box)]
    for index, frame in enumerate(frames[1:]):
        estimates.append(tracker.update(frame, 1.0 if steps is None else steps[index]))
    return estimates


def walk(count=30, step=4.0, colour=True, growth=1.0):
    """Return frames and true boxes of a target that walks to the right."""
    frames, boxes = [], []
    for index in range(count):
        center = (60 + step * index, 120 + 10 * math.sin(index / 4))
        axes = (24 * growth**index, 18 * growth**index)
        frames.append(drawn(center, axes, colour=colour, seed=index))
        boxes.append(Box.from_center(*center, 2 * axes[0], 2 * axes[1]))
    return frames, boxes


@pytest.mark.parametrize('name', TRACKERS)
@pytest.mark.parametrize('preset', PRESETS)
@pytest.mark.parametrize('colour', [True, False])
def test_a_walk_is_followed(name, preset, colour):
    """Colour or grey, the box stays on the target, and the state says so."""
    frames, boxes = walk(colour=colour)
    estimates = followed(name, frames, boxes[0], preset=preset)
    overlaps = [estimate.box.iou(box) for estimate, box in zip(estimates, boxes)]
    assert min(overlaps) > 0.6
    assert all(estimate.state is TrackState.TRACKING for estimate in estimates)
    assert estimates[-1].confidence > 0.6


@pytest.mark.parametrize('name', TRACKERS)
@pytest.mark.parametrize('preset', PRESETS)
def test_dropped_frames_are_bridged(name, preset):
    """With every other frame missing, dt = 2 and twice the step are still followed."""
    frames, boxes = walk(step=3.0)
    estimates = followed(name, frames[::2], boxes[0], [2.0] * (len(frames[::2]) - 1),
                         preset=preset)
    assert estimates[-1].box.iou(boxes[::2][-1]) > 0.6


@pytest.mark.parametrize('name', TRACKERS)
def test_growth_is_followed_by_the_paper_preset(name):
    """A target that grows by 1.5 % a frame has the box of its size at the end."""
    frames, boxes = walk(growth=1.015)
    last = followed(name, frames, boxes[0], preset='paper')[-1].box
    assert last.iou(boxes[-1]) > 0.7
    assert math.sqrt(last.area / boxes[-1].area) == pytest.approx(1.0, abs=0.1)


def test_rotation_is_reported_by_the_paper_preset():
    """The angle is that of the drawn ellipse, clockwise positive, from the start on."""
    frames = [drawn((160, 120), (50, 22), math.radians(3 * index), seed=index)
              for index in range(20)]
    box = Box.from_center(160, 120, 100, 44)
    angle = followed('abmspf', frames, box, preset='paper')[-1].angle
    assert angle == pytest.approx(math.radians(57), abs=math.radians(10))


@pytest.mark.parametrize('name', TRACKERS)
@pytest.mark.parametrize('preset', PRESETS)
def test_the_same_seed_gives_the_same_estimates(name, preset):
    """Two runs are equal, bit for bit."""
    frames, boxes = walk(10)
    one, other = (followed(name, frames, boxes[0], preset=preset) for _ in range(2))
    for a, b in zip(one, other):
        assert a.box == b.box
        assert a.confidence == b.confidence
        assert np.array_equal(a.covariance, b.covariance)


@pytest.mark.parametrize('name', TRACKERS)
@pytest.mark.parametrize('preset', PRESETS)
def test_a_hidden_target_is_not_claimed_and_is_found_again(name, preset):
    """Hidden for fifteen frames: the state is a search, and it's followed again afterwards."""
    frames, boxes = walk(45, step=2.0)
    frames[15:30] = [drawn((-100, -100), (10, 10), seed=seed) for seed in range(100, 115)]
    estimates = followed(name, frames, boxes[0], preset=preset)
    hidden = estimates[15:30]
    assert sum(estimate.state is TrackState.TRACKING for estimate in hidden) <= 3
    assert np.mean([estimate.confidence for estimate in hidden]) < 0.4
    assert estimates[-1].state is TrackState.TRACKING
    assert estimates[-1].box.iou(boxes[-1]) > 0.5


@pytest.mark.parametrize('name', TRACKERS)
@pytest.mark.parametrize('preset', PRESETS)
def test_a_target_that_leaves_the_image_raises_nothing(name, preset):
    """Boxes stay finite and bounded, covariances positive definite, while it's gone."""
    frames, boxes = walk(90)
    estimates = followed(name, frames, boxes[0], preset=preset)
    for estimate in estimates:
        assert 0 <= estimate.confidence <= 1
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0
        assert 0.04 < estimate.box.area / boxes[0].area < 30
        x, y = estimate.box.center
        assert 0 <= x <= 320
        assert 0 <= y <= 240
    assert estimates[-1].state is not TrackState.TRACKING


@pytest.mark.parametrize('preset', PRESETS)
def test_parameters_change_while_it_runs(preset):
    """More particles are drawn from the next frame on, and the target is kept."""
    frames, boxes = walk(12)
    tracker = create_tracker('abmspf', seed=0, preset=preset)
    tracker.start(frames[0], boxes[0])
    assert len(tracker.update(frames[1]).particles) == 20
    tracker.configure(particles=7, rejected=0.4)
    for frame in frames[2:]:
        estimate = tracker.update(frame)
    assert len(estimate.particles) == 7
    assert estimate.box.iou(boxes[-1]) > 0.6


@pytest.mark.parametrize('parameters', [
    {'particles': 0}, {'accepted': 1.5}, {'preset': 'best'}, {'levels': 7}])
def test_wrong_parameters_are_refused(parameters):
    """The message names the parameter."""
    with pytest.raises(ValueError, match=next(iter(parameters))):
        create_tracker('abmspf', **parameters)


@pytest.mark.parametrize('preset', PRESETS)
def test_a_tiny_target_at_the_border_is_accepted(preset):
    """A few pixels, half of them outside, are enough to start on."""
    frame = drawn((160, 120), (40, 20))
    tracker = create_tracker('abmspf', seed=0, preset=preset)
    tracker.start(frame, Box(-3, 100, 6, 5))
    estimate = tracker.update(frame)
    assert np.isfinite(estimate.covariance).all()
