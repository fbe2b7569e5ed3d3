"""The colours of an ellipse: similarity, mean shift and the bandwidth matrix [Yin2013]."""

import math

from drawn_ellipse import ellipse
import numpy as np
import pytest

from vtrack_ros.replicas.ellipse_colours import EllipseColours


def matrix(major, minor, angle=0.0):
    """Return an ellipse's frame, from the unit disc to the image."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin], [sin, cos]]) @ np.diag([major, minor])


@pytest.mark.parametrize('colour', [True, False])
def test_the_target_itself_is_most_like_itself(colour):
    """Bhattacharyya's coefficient is 1 at the target, less beside it, 0 on its background."""
    frame = ellipse((160, 120), (40, 20), colour=colour)
    center = np.array([160.0, 120.0])
    model = EllipseColours.create(frame, center, matrix(40, 20))
    scores = model.coefficients(
        frame, center + [(0, 0), (15, 0), (60, 0), (0, 90)], matrix(40, 20))
    assert scores[0] == pytest.approx(1.0, abs=1e-6)
    assert scores[0] > scores[1] > scores[2]
    assert scores[3] < 0.1


def test_what_leaves_the_image_has_no_similarity():
    """A target half outside the image is less similar; one fully outside has similarity 0."""
    frame = ellipse((0, 120), (40, 20))
    model = EllipseColours.create(
        ellipse((160, 120), (40, 20)), np.array([160.0, 120.0]), matrix(40, 20))
    half, none = model.coefficients(frame, np.array([[0.0, 120.0], [-50.0, 120.0]]),
                                    matrix(40, 20))
    assert none == 0
    assert 0.5 < half < 0.9


def test_all_candidates_at_once_are_as_one_by_one():
    """Each candidate's score is the same alone as among others."""
    frame = ellipse((160, 120), (40, 20))
    model = EllipseColours.create(frame, np.array([160.0, 120.0]), matrix(40, 20))
    centers = np.random.default_rng(2).uniform(0, 240, (30, 2))
    together = model.coefficients(frame, centers, matrix(30, 30))
    alone = [model.coefficients(frame, center[None], matrix(30, 30))[0] for center in centers]
    assert together == pytest.approx(alone)


def test_the_climb_ends_on_the_target():
    """Mean shift raises the similarity and stops at the target's centre."""
    start = np.array([160.0, 120.0])
    model = EllipseColours.create(ellipse(start, (40, 20)), start, matrix(40, 20))
    frame = ellipse((185, 128), (40, 20), seed=1)
    place = model.climb(frame, start, matrix(40, 20), steps=30)
    assert place == pytest.approx([185, 128], abs=2)


def axes_of(form):
    """Return the lengths of a frame's axes."""
    return np.linalg.svd(form, compute_uv=False)


def test_an_unchanged_target_keeps_its_bandwidth():
    """An unchanged target keeps its axes to 3 %, instead of growing by 1.56."""
    center, form = np.array([160.0, 120.0]), matrix(40, 20)
    model = EllipseColours.create(ellipse(center, (40, 20)), center, form)
    for seed in range(5):
        form = form @ model.growth(ellipse(center, (40, 20), seed=seed), center, form)
    assert axes_of(form) == pytest.approx([40, 20], rel=0.03)


def test_the_moment_of_a_uniform_ellipse_is_a_quarter():
    """The factor 4 / sigma^2 of eq. 11: normalisation is by the inverse of that moment of 1/4."""
    center, form = np.array([160.0, 120.0]), matrix(40, 20)
    model = EllipseColours.create(ellipse(center, (40, 20)), center, form)
    assert model.moment @ model.moment == pytest.approx(4 * np.eye(2), rel=0.15, abs=0.1)


@pytest.mark.parametrize('factor', [0.8, 1.25])
def test_the_bandwidth_follows_growth_and_shrinkage(factor):
    """The axes converge on the drawn ones."""
    center, form = np.array([160.0, 120.0]), matrix(40, 20)
    model = EllipseColours.create(ellipse(center, (40, 20)), center, form)
    frame = ellipse(center, (40 * factor, 20 * factor))
    for _ in range(8):
        form = form @ model.growth(frame, center, form)
    assert axes_of(form) == pytest.approx([40 * factor, 20 * factor], rel=0.08)


def test_the_bandwidth_follows_rotation():
    """The bandwidth matrix has the angle of a target that rotates by 3 degrees per frame."""
    center, form = np.array([160.0, 120.0]), matrix(40, 20)
    model = EllipseColours.create(ellipse(center, (40, 20)), center, form)
    for index in range(1, 11):
        angle = math.radians(3 * index)
        form = form @ model.growth(ellipse(center, (40, 20), angle), center, form)
    bandwidth = form @ form.T
    found = 0.5 * math.atan2(2 * bandwidth[0, 1], bandwidth[0, 0] - bandwidth[1, 1])
    assert found == pytest.approx(math.radians(30), abs=math.radians(5))


def test_the_printed_moment_of_one_colour_all_over():
    """Eq. 11 over an ellipse of equal weights: the matrix grows by sigma^2 / 4, axes by 1.25."""
    frame = np.full((240, 320, 3), (40, 60, 200), np.uint8)
    center, form = np.array([160.0, 120.0]), matrix(40, 20, 0.3)
    model = EllipseColours.create(frame, center, form, weighted=False)
    growth = model.printed_growth(frame, center, form)
    assert growth == pytest.approx(1.25 * np.eye(2), rel=0.02, abs=0.02)


def test_the_printed_moment_ends_at_a_quarter_more_than_the_target():
    """On a background without weight the printed eq. 11 converges on 1.25 times the axes."""
    center, form = np.array([160.0, 120.0]), matrix(40, 20)
    frame = ellipse(center, (40, 20))
    model = EllipseColours.create(frame, center, form, weighted=False)
    for _ in range(10):
        form = form @ model.printed_growth(frame, center, form)
    assert axes_of(form) == pytest.approx([50, 25], rel=0.08)
