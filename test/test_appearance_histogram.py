"""Colour histograms against a plain computation, pixel by pixel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vtrack_ros.appearance.histogram import ColourHistogram, sampled_histograms


def plain_histogram(frame, box, bins=6, grid=12, kernel='flat'):
    """Return the histogram of a box, sampled at the centres of a grid's cells."""
    levels = bins**3 if frame.ndim == 3 else bins**2
    result, total = np.zeros(levels), 0.0
    for row in range(grid):
        for column in range(grid):
            across, down = (column + 0.5) / grid - 0.5, (row + 0.5) / grid - 0.5
            radius2 = (across**2 + down**2) / 0.25
            weight = 1.0 if kernel == 'flat' else max(0.0, 1 - radius2)
            total += weight
            x, y = math.floor(box[0] + across * box[2]), math.floor(box[1] + down * box[3])
            if not (0 <= x < frame.shape[1] and 0 <= y < frame.shape[0]):
                continue
            if frame.ndim == 2:
                level = int(frame[y, x]) * levels // 256
            else:
                blue, green, red = (int(value) * bins // 256 for value in frame[y, x])
                level = (blue * bins + green) * bins + red
            result[level] += weight
    return result / total


def random_frame(colour=True, seed=0):
    """Return noise of every colour."""
    shape = (60, 80, 3) if colour else (60, 80)
    return np.random.default_rng(seed).integers(256, size=shape, dtype=np.uint8)


@pytest.mark.parametrize('kernel', ['flat', 'epanechnikov'])
@pytest.mark.parametrize('colour', [True, False])
def test_histograms_are_those_of_a_plain_computation(kernel, colour):
    """They're equal for boxes inside, across each border and outside, all in one call."""
    frame = random_frame(colour)
    boxes = np.array([
        [40.0, 30.0, 20.0, 12.0], [40.3, 30.8, 17.3, 21.9], [1.0, 2.0, 14.0, 18.0],
        [79.5, 59.5, 30.0, 10.0], [200.0, 30.0, 20.0, 20.0], [-60.0, -50.0, 9.0, 9.0],
        [40.0, 30.0, 3.0, 2.0]])
    found = ColourHistogram(kernel=kernel).histograms(frame, boxes)
    for box, histogram in zip(boxes, found):
        np.testing.assert_allclose(
            histogram, plain_histogram(frame, box, kernel=kernel), atol=1e-12)


def test_what_is_outside_is_missing_from_the_sum():
    """A flat histogram loses mass in proportion to what the image's border cuts off."""
    frame = random_frame()
    histograms = ColourHistogram().histograms(frame, np.array([
        [40.0, 30.0, 24.0, 24.0], [0.0, 30.0, 24.0, 24.0], [0.0, 0.0, 24.0, 24.0],
        [-40.0, 30.0, 24.0, 24.0]]))
    np.testing.assert_allclose(histograms.sum(axis=1), [1, 0.5, 0.25, 0], atol=1e-12)


def test_the_epanechnikov_profile():
    """It is 1 - r^2 inside the inscribed ellipse, nothing in the corners [Qi2012, eq. 5]."""
    grid = 10
    frame = np.zeros((grid, grid), np.uint8)
    frame.flat = np.arange(grid * grid)
    histogram = ColourHistogram(bins=16, kernel='epanechnikov', grid=grid).histograms(
        frame, np.array([[grid / 2, grid / 2, grid, grid]]))[0]
    weights = histogram[:grid * grid].reshape(grid, grid)
    y, x = (np.mgrid[:grid, :grid] + 0.5) / grid - 0.5
    expected = np.maximum(0, 1 - 4 * (x**2 + y**2))
    np.testing.assert_allclose(weights, expected / expected.sum(), atol=1e-12)
    assert weights[0, 0] == 0
    assert weights.max() == weights[grid // 2, grid // 2]


@pytest.mark.parametrize('kernel', ['flat', 'epanechnikov'])
def test_bhattacharyya_coefficients(kernel):
    """It's 1 with itself, 0 without a common colour, sqrt(0.5) for half of it, and symmetric."""
    frame = np.zeros((60, 80, 3), np.uint8)
    frame[:, :40] = (255, 0, 0)
    frame[:, 40:] = (0, 0, 255)
    histogram = ColourHistogram(kernel=kernel)
    left, right = np.array([20.0, 30.0, 20.0, 20.0]), np.array([60.0, 30.0, 20.0, 20.0])
    half = np.array([40.0, 30.0, 20.0, 20.0])
    blue, both = histogram.reference(frame, left), histogram.reference(frame, half)
    coefficients = histogram.coefficients(frame, np.array([left, right, half]), blue)
    np.testing.assert_allclose(coefficients, [1, 0, math.sqrt(0.5)], atol=1e-12)
    assert histogram.coefficients(frame, left[None], both)[0] == pytest.approx(coefficients[2])


def test_coefficients_of_noise_are_in_range_and_follow_the_formula():
    """The sum of the roots of products, at most one by Cauchy and Schwarz."""
    frame = random_frame()
    histogram = ColourHistogram()
    reference = histogram.reference(frame, np.array([30.0, 20.0, 20.0, 20.0]))
    rng = np.random.default_rng(1)
    boxes = np.column_stack([rng.uniform(-10, 90, 200), rng.uniform(-10, 70, 200),
                             rng.uniform(2, 40, 200), rng.uniform(2, 40, 200)])
    coefficients = histogram.coefficients(frame, boxes, reference)
    assert (coefficients >= 0).all() and (coefficients <= 1 + 1e-12).all()
    for index in (0, 50, 199):
        alone = histogram.histograms(frame, boxes[index:index + 1])[0]
        assert histogram.coefficients(frame, boxes[index:index + 1], reference)[0] == (
            pytest.approx(np.sqrt(alone * reference).sum()))


def test_the_reference_of_a_box_across_the_border_is_normalised():
    """The reference of a target across the border is normalised over its visible part."""
    frame = random_frame()
    reference = ColourHistogram().reference(frame, np.array([0.0, 30.0, 24.0, 24.0]))
    assert reference.sum() == pytest.approx(1)


def test_large_boxes_are_sampled_by_the_same_number_of_points():
    """A uniform half of a huge box has half of the mass, however large the box is."""
    frame = np.zeros((1000, 1600, 3), np.uint8)
    frame[:, 800:] = 255
    for side in (30.0, 300.0, 900.0):
        found = ColourHistogram().histograms(frame, np.array([[800.0, 500.0, side, side]]))[0]
        assert found[0] == pytest.approx(0.5) and found[-1] == pytest.approx(0.5)


def test_no_image_no_mass():
    """An empty image of bins gives empty histograms."""
    result = sampled_histograms(np.zeros((0, 0), np.intp), 7, np.ones((3, 4)), 4, np.ones(16))
    np.testing.assert_array_equal(result, np.zeros((3, 7)))
