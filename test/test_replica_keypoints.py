"""Pose from keypoints: matching, RANSAC and the Sylvester equation."""

import cv2
import numpy as np
from numpy.testing import assert_allclose
import pytest

from vtrack_ros.geometry import affine
from vtrack_ros.replicas.keypoint_memory import KeypointMemory
from vtrack_ros.replicas.keypoints import (
    detected, keypoint_error, Keypoints, nearest, pose_change, PoseChange, similarity,
    sylvester_rotation)


def _points(count, seed=0):
    return np.random.default_rng(seed).uniform(0, 100, (count, 2))


def _moved(points, turn, scale=1.0, shift=(0.0, 0.0)):
    return scale * points @ affine.rotation(np.asarray(turn)).T + shift


def _texture(size=160, seed=5):
    noise = np.random.default_rng(seed).integers(0, 256, (size // 6, size // 6), dtype=np.uint8)
    return cv2.resize(noise, (size, size), interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize('turn', [0.0, 0.05, -0.6, 1.5, 2.9, -3.1])
def test_sylvester_rotation_is_the_least_squares_one(turn):
    before = _points(30)
    before -= before.mean(0)
    after = _moved(before, turn) + np.random.default_rng(1).standard_normal(before.shape) * 3
    after -= after.mean(0)
    # the orthogonal Procrustes solution, by SVD
    left, _, right = np.linalg.svd(after.T @ before)
    best = left @ np.diag([1, np.linalg.det(left @ right)]) @ right
    assert_allclose(sylvester_rotation(before, after), best, atol=1e-8)


def test_points_on_a_line_still_give_the_rotation():
    before = np.outer(np.linspace(-1, 1, 9), (3.0, 4.0))
    turn = affine.rotation(np.asarray(0.4))
    assert_allclose(sylvester_rotation(before, before @ turn.T), turn, atol=1e-6)


@pytest.mark.parametrize('scale', [0.8, 1.0, 1.3])
def test_similarity_recovers_an_exact_movement(scale):
    before = _points(12)
    matrix = similarity(before, _moved(before, 0.3, scale, (7.0, -2.0)))
    expected = np.eye(3)
    expected[:2, :2] = scale * affine.rotation(np.asarray(0.3))
    expected[:2, 2] = 7, -2
    assert_allclose(matrix, expected, atol=1e-7)


def test_keypoint_error_is_the_mean_square_distance():
    rng = np.random.default_rng(0)
    before, states = affine.from_vector(np.array([np.log(20.0), 0, 0.1, 0, 40.0, 40.0])), []
    for _ in range(5):
        states.append(before @ affine.exponential(
            affine.from_coordinates(0.1 * rng.standard_normal(6))))
    source, target = rng.uniform(0, 80, (2, 12, 2))
    change = PoseChange(np.eye(3), source, target, np.ones(len(source)))
    expected = []
    for state in states:
        move = state @ np.linalg.inv(before)
        landed = source @ move[:2, :2].T + move[:2, 2]
        expected.append(np.square(landed - target).sum(1).mean())
    assert_allclose(keypoint_error(np.array(states), before, change), expected)


def test_pose_change_ignores_outliers():
    rng = np.random.default_rng(2)
    before = _points(40)
    after = _moved(before, -0.4, 1.1, (5.0, 9.0)) + 0.2 * rng.standard_normal(before.shape)
    after[:16] = rng.uniform(0, 100, (16, 2))
    change = pose_change(before, after, 1.5, rng)
    assert change is not None
    assert affine.angle(change.matrix) == pytest.approx(-0.4, abs=0.01)
    assert affine.scale(change.matrix) == pytest.approx(1.1, abs=0.01)
    assert_allclose(_moved(before, -0.4, 1.1, (5.0, 9.0)),
                    before @ change.matrix[:2, :2].T + change.matrix[:2, 2], atol=0.5)
    assert 22 <= len(change.before) <= 28


@pytest.mark.parametrize('count', [0, 1, 3])
def test_too_few_matches_give_no_pose(count):
    points = _points(count)
    assert pose_change(points, points, 1.0, np.random.default_rng(0)) is None


def test_matches_that_agree_on_nothing_give_no_pose():
    assert pose_change(_points(40), _points(40, 1), 1.0, np.random.default_rng(0)) is None


def test_one_point_seen_many_times_gives_no_pose():
    points = np.ones((10, 2))
    assert pose_change(points, points, 1.0, np.random.default_rng(0)) is None


@pytest.mark.parametrize('enlargement', [1, 3])
def test_sift_finds_the_rotation_of_a_picture(enlargement):
    size = 160 * enlargement
    image = cv2.resize(_texture(), (size, size), interpolation=cv2.INTER_CUBIC)
    center = (size / 2, size / 2)
    # OpenCV's angles are anticlockwise
    turning = cv2.getRotationMatrix2D((center[0] - 0.5, center[1] - 0.5), -12, 1.0)
    turned = cv2.warpAffine(image, turning, (size, size), borderMode=cv2.BORDER_REFLECT)
    window = (100.0 * enlargement, 100.0 * enlargement)
    before, after = (detected(picture, center, window) for picture in (image, turned))
    known, seen = nearest(before.descriptors, after.descriptors)
    change = pose_change(before.points[known], after.points[seen], 2.0 * enlargement,
                         np.random.default_rng(0))
    assert change is not None
    assert np.degrees(affine.angle(change.matrix)) == pytest.approx(12, abs=1.5)
    middle = change.matrix @ (*center, 1)
    assert_allclose(middle[:2], center, atol=1.5 * enlargement)


@pytest.mark.parametrize('target', [(3e5, 1.0), (1.0, 3e5), (1e6, 5.0)])
def test_keypoints_of_a_very_thin_target_are_in_it(target):
    found = detected(_texture(), (80.0, 80.0), target, reach=2.0)
    assert (np.abs(found.points - 80) <= np.maximum(target, 1)).all()


def test_a_plain_picture_has_no_keypoints_and_no_matches():
    found = detected(np.full((80, 80, 3), 90, np.uint8), (40.0, 40.0), (60.0, 60.0))
    assert len(found.points) == 0
    others = detected(_texture(), (80.0, 80.0), (90.0, 90.0))
    assert len(others.points) > 0
    for one, other in ((found, others), (others, found)):
        assert len(nearest(one.descriptors, other.descriptors)[0]) == 0


def test_two_looks_of_one_keypoint_are_both_matched():
    looks = np.random.default_rng(0).random((6, 128)).astype(np.float32)
    known = np.concatenate([looks + 0.1, looks[:1] + 0.11, looks[1:2] + 0.2])
    which, seen = nearest(known, looks)
    assert sorted(zip(seen, which)) == [(0, 0), (0, 6), *((row, row) for row in range(1, 6))]


def test_weights_decide_between_two_movements():
    points = _points(20)
    after = points + np.where(np.arange(20) < 8, 30.0, 0.0)[:, None]
    weights = np.where(np.arange(20) < 8, 1.0, 0.1)
    for given, shift in ((None, 0.0), (weights, 30.0)):
        change = pose_change(points, after, 1.0, np.random.default_rng(0), given)
        assert_allclose(change.matrix[:2, 2], shift, atol=1e-6)


def test_a_large_change_takes_more_matches():
    points = _points(5)
    assert pose_change(points, _moved(points, 0.1), 1.0, np.random.default_rng(0)) is not None
    assert pose_change(points, _moved(points, 0.1, 2.0), 1.0, np.random.default_rng(0)) is None
    points = _points(12)
    change = pose_change(points, _moved(points, 0.1, 2.0), 1.0, np.random.default_rng(0))
    assert affine.scale(change.matrix) == pytest.approx(2.0)


def _looks(count, seed):
    return np.random.default_rng(seed).random((count, 128)).astype(np.float32)


def _placed(state, points):
    return points @ state[:2, :2].T + state[:2, 2]


def _state(x, y, scale=40.0, turn=0.0):
    return affine.from_vector(np.array([np.log(scale), 0, turn, 0, x, y]))


def test_remembered_keypoints_measure_the_pose_without_drift():
    rng = np.random.default_rng(0)
    memory = KeypointMemory((1.0, 1.0))
    places, looks = rng.uniform(-0.5, 0.5, (20, 2)), _looks(20, 1)
    estimate = _state(100, 100)
    for step in range(200):
        truth = _state(100 + step, 100, 40 + 0.1 * step, 0.01 * step)
        noise = 0.3 * rng.standard_normal(places.shape)
        change = memory.measure(Keypoints(_placed(truth, places) + noise, looks), estimate, rng)
        if change is not None:
            estimate = change.matrix @ estimate
        memory.learn(estimate)
    assert_allclose(estimate[:2, 2], truth[:2, 2], atol=1)
    assert_allclose(estimate[:2, :2], truth[:2, :2], rtol=0.02, atol=1)


def test_keypoints_that_the_target_passes_never_become_its_own():
    rng = np.random.default_rng(0)
    memory = KeypointMemory((1.0, 1.0))
    places, looks = rng.uniform(-0.5, 0.5, (10, 2)), _looks(10, 1)
    ground, ground_looks = rng.uniform(0, 200, (200, 2)), _looks(200, 2)
    for step in range(40):
        truth = _state(60 + 2 * step, 100)
        memory.measure(Keypoints(np.concatenate([_placed(truth, places), ground]),
                                 np.concatenate([looks, ground_looks])), truth, rng)
        memory.learn(truth)
    # occluded: only keypoints of the ground are seen, from which no pose is measured
    assert memory.measure(Keypoints(ground, ground_looks), truth, rng) is None


def test_keypoints_from_before_a_time_without_any_outvote_later_ones():
    rng = np.random.default_rng(0)
    memory = KeypointMemory((1.0, 1.0))
    places, looks, later = rng.uniform(-0.4, 0.4, (12, 2)), _looks(12, 1), _looks(12, 2)
    truth, wrong = _state(100, 100), _state(115, 108)
    for _ in range(5):
        memory.measure(Keypoints(_placed(truth, places), looks), truth, rng)
        memory.learn(truth)
    sure = memory.uncertainty
    for _ in range(20):
        memory.measure(Keypoints(_placed(truth, places)[:0], looks[:0]), wrong, rng)
        memory.learn(wrong)
    assert memory.uncertainty > sure + 5
    for _ in range(5):
        memory.measure(Keypoints(_placed(truth, places), later), wrong, rng)
        memory.learn(wrong)
    # both sets are seen, at the target's true place: the later ones alone would give no motion
    change = memory.measure(Keypoints(
        np.concatenate([_placed(truth, places)[:9], _placed(truth, places)]),
        np.concatenate([looks[:9], later])), wrong, rng)
    assert_allclose((change.matrix @ wrong)[:2, 2], truth[:2, 2], atol=0.5)
    assert memory.uncertainty < sure + 1
