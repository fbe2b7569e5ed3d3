"""The cues of the papers' filters: measurement and likelihood."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose
import pytest

from vtrack_ros.geometry import affine
from vtrack_ros.replicas.affine_filters import ConsecutiveKeypoints
from vtrack_ros.replicas.cues import BoxCues
from vtrack_ros.replicas.fusion import FUSIONS
from vtrack_ros.replicas.keypoints import Keypoints

SIDE = 24


def picture(*centers):
    """Return noise with a bright square at each of the centres."""
    rng = np.random.default_rng(0)
    frame = rng.integers(20, 60, size=(120, 160, 3), dtype=np.uint8)
    for x, y in centers:
        part = frame[y - SIDE // 2:y + SIDE // 2, x - SIDE // 2:x + SIDE // 2]
        part[:] = rng.integers(180, 230, size=part.shape, dtype=np.uint8)
    return frame


def started(edges=False):
    """Return cues that were started on the square at (80, 60), and its box."""
    box = np.array([80.0, 60.0, SIDE, SIDE])
    cues = BoxCues(edges, 'flat')
    cues.sigma = 0.1
    cues.start(picture((80, 60)), box)
    return cues, box


@pytest.mark.parametrize('shift', [(0, 0), (5, 0), (-4, 6), (0, -7)])
def test_the_target_is_measured_where_it_is(shift):
    """Beside the prediction its centre is right to a tenth of a side; the covariance is small."""
    cues, box = started()
    place = box[:2].astype(int) + shift
    cues.observe(picture(place), box)
    center, covariance = cues.measure(box, SIDE)
    assert np.abs(center - place).max() < SIDE / 10
    assert np.sqrt(np.linalg.eigvalsh(covariance)).max() < 0.2 * SIDE


def test_two_likely_places_are_measured_as_uncertainty():
    """The mean lies between them, and the covariance is large along their line only."""
    cues, box = started()
    small = box * [1, 1, 0.5, 0.5]
    cues.start(picture((80, 60)), small)
    frame = picture()
    for x in (68, 92):
        frame[54:66, x - 6:x + 6] = picture((80, 60))[54:66, 74:86]
    cues.observe(frame, small)
    center, covariance = cues.measure(small, SIDE)
    assert np.abs(center - box[:2]).max() < SIDE / 10
    along, across = np.sqrt(np.diag(covariance))
    assert along > 0.35 * SIDE > 2 * across


def test_nothing_like_the_target_tells_nothing():
    """With equal likelihoods the measurement is the prediction, with a wide covariance."""
    cues, box = started()
    cues.observe(np.full((120, 160, 3), 128, np.uint8), box)
    center, covariance = cues.measure(box, SIDE)
    assert_allclose(center, box[:2], atol=1e-9)
    assert np.sqrt(np.linalg.eigvalsh(covariance)).min() > 0.3 * SIDE


def test_cues_that_exclude_each_other_s_places_tell_nothing():
    """Where no place is possible by both, all count alike, as if nothing had been measured."""
    grey = np.random.default_rng(0).integers(60, 140, (12, 12, 1))
    # as bright, so that it has the same moving edges, but of another colour
    looks = {'target': grey, 'decoy': np.rint(grey * (0, 1 / 0.587, 0))}
    back = np.random.default_rng(1).integers(0, 60, (120, 160, 1)).astype(np.uint8)
    back = np.repeat(back, 3, axis=2)

    def shown(**places):
        frame = back.copy()
        for look, x in places.items():
            frame[54:66, x - 6:x + 6] = looks[look]
        return frame

    cues = BoxCues(True, 'flat')
    cues.sigma, cues.fusion = 0.01, FUSIONS['normalised']
    predicted = np.array([84.0, 60.0, 12.0, 12.0])
    cues.start(shown(target=80), predicted - [4, 0, 0, 0])
    for x in (82, 84):
        cues.observe(shown(target=x), predicted)
        cues.update(np.array([x, 60.0, 12.0, 12.0]))
    # now the target rests at the left, and the decoy moves at the right as it did
    for x in (93, 95):
        cues.observe(shown(target=74, decoy=x), predicted)
    center, covariance = cues.measure(predicted, SIDE)
    assert_allclose(center, predicted[:2], atol=1e-9)
    assert np.sqrt(np.linalg.eigvalsh(covariance)).min() > 0.3 * SIDE


def test_the_likelihood_is_that_of_bhattacharyyas_coefficient():
    """A box on half of the target has rho = sqrt(1/2): exp(-(1 - rho) / (2 sigma^2))."""
    cues, box = started()
    cues.observe(picture((80, 60)), box)
    half = box + [SIDE / 2, 0, 0, 0]
    whole, part = cues.log_likelihood(np.stack([box, half]))
    assert whole == pytest.approx(0, abs=1e-9)
    assert part == pytest.approx((np.sqrt(0.5) - 1) / 0.02, rel=0.05)


@pytest.mark.parametrize('fusion', FUSIONS)
def test_edges_that_are_like_the_target_s_nowhere_abstain(fusion):
    """Where all boxes have a likelihood of 0 by their edges, nothing is divided by it."""
    cues, box = started(edges=True)
    cues.fusion = FUSIONS[fusion]
    for place in ((82, 61), (85, 62)):
        cues.observe(picture(place), box)
        cues.update(np.array([*place, SIDE, SIDE]))
    cues.observe(picture((90, 66)), box)
    # as narrow as the trackers' parameter allows
    cues.sigma = 0.01
    with np.errstate(divide='raise', invalid='raise'):
        found = cues.log_likelihood(box + [[34, 0, 0, 0], [33, 0, 0, 0]])
    assert np.isfinite(found).all()


def test_sizes_out_of_range_and_places_outside_are_unlikely():
    """Bounds are soft: beyond them the likelihood falls with the distance."""
    cues, box = started(edges=True)
    cues.observe(picture((80, 60)), box)
    sizes = np.stack([box * [1, 1, scale, scale] for scale in (5, 6, 7)])
    places = np.stack([box + [200 + step, 0, 0, 0] for step in (0, 50, 100)])
    for boxes in (sizes, places):
        assert (np.diff(cues.log_likelihood(boxes)) < 0).all()
    assert (cues.bounded(sizes)[:, 2:] <= 5 * SIDE).all()


def seen(points, descriptors):
    """Return keypoints."""
    return Keypoints(np.asarray(points, np.float64), descriptors)


def test_consecutive_keypoints_measure_the_last_step():
    """They give its rotation and translation; keypoints that aren't on the target are ignored."""
    rng = np.random.default_rng(1)
    descriptors = rng.uniform(0, 100, (24, 128)).astype(np.float32)
    state = affine.from_vector(np.array([np.log(40.0), 0, 0, 0, 100, 80]))
    inside = rng.uniform(-19, 19, (12, 2)) + (100, 80)
    outside = rng.uniform(30, 60, (12, 2)) + (100, 80)
    meter = ConsecutiveKeypoints((1.0, 1.0))
    assert meter.measure(seen([*inside, *outside], descriptors), state, rng) is None
    meter.learn(state)
    move = affine.from_vector(np.array([0.0, 0, 0.2, 0, 7, -3]))
    moved = inside @ move[:2, :2].T + move[:2, 2]
    # keypoints outside the target stand still, and would outvote its own if they were used
    change = meter.measure(seen([*moved, *outside, *outside], np.concatenate(
        [descriptors, descriptors[12:] + 50])), state, rng)
    assert_allclose(change.matrix, move, atol=1e-6)
    assert len(change.before) == 12
    meter.learn(move @ state)
    again = meter.measure(seen(moved, descriptors[:12]), move @ state, rng)
    assert_allclose(again.matrix, np.eye(3), atol=1e-6)
