"""ABMS and ABMSPF as printed: the steps of [Yin2013, sec. 3], on a drawn ellipse."""

from drawn_ellipse import ellipse
import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.replicas import REPLICAS
from vtrack_ros.replicas.ellipse_colours import EllipseColours

BY_NAME = {replica.NAME: replica for replica in REPLICAS}
PLACE, AXES = np.array([160.0, 120.0]), (40.0, 30.0)
MATRIX = np.diag(AXES)
FIRST = ellipse((160, 120), AXES)
MODEL = EllipseColours.create(FIRST, PLACE, MATRIX, weighted=False)
EACH = pytest.mark.parametrize('name', ['abms_paper', 'abmspf_paper'])


def started(name, **parameters):
    """Return a tracker, as printed, that was started on the first frame."""
    tracker = BY_NAME[name](1, as_printed=True, **parameters)
    tracker.start(FIRST, Box.from_center(*PLACE, 2 * AXES[0], 2 * AXES[1]))
    return tracker


def similarity(frame, place):
    """Return the similarity at a place, with the first bandwidth matrix."""
    return float(MODEL.coefficients(frame, np.array([place]), MATRIX)[0])


def test_mean_shift_makes_one_step():
    """Step 3: one step of mean shift, although a second one would go further."""
    frame = ellipse((185, 128), AXES, seed=1)
    once, twice = (MODEL.climb(frame, PLACE, MATRIX, steps) for steps in (1, 2))
    assert np.linalg.norm(twice - once) > 1
    np.testing.assert_allclose(started('abms_paper').update(frame).box.center, once)


@EACH
def test_the_bandwidth_is_iterated_in_a_frame(name):
    """Step 4: a target 1.25 times as large has its 1.25 times larger ellipse in one frame."""
    frame = ellipse((160, 120), (50, 37.5), seed=1)
    box = started(name).update(frame).box
    assert (box.width, box.height) == pytest.approx(1.25**2 * 2 * np.array(AXES), rel=0.05)


@pytest.mark.parametrize('accepted, stage', [(0.8, 'track'), (1.0, 'ahead')])
def test_only_particles_above_the_threshold_count(accepted, stage):
    """Sec. 2.2: no particle is above th = 1, so that between r and th there's no y_pf (eq. 14)."""
    tracker = started('abmspf_paper', accepted=accepted)
    tracker.update(ellipse((162, 121), AXES, seed=1))
    assert tracker.stage == stage


def test_a_particle_below_the_threshold_contradicts_nothing():
    """A single particle, on the background, isn't y_pf: mean shift's place counts from th on."""
    frame = ellipse((162, 121), AXES, seed=1)
    climbed = MODEL.climb(frame, PLACE, MATRIX, 1)
    assert similarity(frame, climbed) > 0.8
    tracker = started('abmspf_paper', particles=1, region=5.0)
    estimate = tracker.update(frame)
    particle = estimate.particles[0, :2]
    assert similarity(frame, particle) < 0.8 and np.linalg.norm(particle - climbed) > AXES[0]
    assert tracker.stage == 'track'
    np.testing.assert_allclose(estimate.box.center, climbed)


def test_the_similarity_of_mean_shift_decides_on_a_search():
    """Step 7: a search begins where y_ms isn't similar, although a particle is on the target."""
    frame = ellipse((226, 120), AXES, seed=1)
    assert similarity(frame, MODEL.climb(frame, PLACE, MATRIX, 1)) < 0.75
    tracker = started('abmspf_paper', particles=500, region=2.0, rejected=0.75)
    estimate = tracker.update(frame)
    assert max(similarity(frame, place) for place in estimate.particles[:, :2]) > 0.9
    assert tracker.stage != 'track'


def test_what_a_search_finds_is_fused():
    """Step 8: one step ahead (eq. 16); step 11: what is found there is fused with y_pf."""
    tracker = started('abmspf_paper', particles=600)
    hidden = np.array(tracker.update(ellipse((-100, -100), AXES)).box.center)
    assert tracker.stage == 'none'
    frame = ellipse((163, 121), AXES, seed=1)
    estimate = tracker.update(frame)
    assert tracker.stage == 'ahead'
    climbed = MODEL.climb(frame, 2 * hidden - PLACE, MATRIX)
    points = estimate.particles[:, :2]
    best = points[MODEL.coefficients(frame, points, MATRIX).argmax()]
    zeta = similarity(frame, climbed)
    assert zeta > 0.8 and 0.1 < np.linalg.norm(best - climbed) < 2.5
    np.testing.assert_allclose(estimate.box.center, zeta * climbed + (1 - zeta) * best)


@pytest.mark.filterwarnings('error::RuntimeWarning')
def test_a_tiny_interval_gives_no_infinite_speed():
    """After a frame 1e-9 frames later, the step of eq. 16 is at most the picture's side."""
    tracker = started('abmspf_paper')
    tracker.update(ellipse((162, 121), AXES, seed=1), 1e-9)
    estimate = tracker.update(ellipse((164, 122), AXES, seed=2), 1e9)
    assert np.abs(estimate.particles[:, :2]).max() < 1e12
