"""The scale regression: how much a picture grew."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from vtrack_ros.appearance.regression import ScaleRegression

SIDE = 300
CENTER = (SIDE / 2, SIDE / 2)


def picture(seed=0):
    """Return a texture of blobs."""
    noise = np.random.default_rng(seed).normal(size=(SIDE, SIDE))
    smooth = cv2.GaussianBlur(noise, (0, 0), 4)
    return (128 + 50 * smooth / smooth.std()).clip(0, 255).astype(np.uint8)


def enlarged(image, factor):
    """Return an image enlarged about its centre."""
    middle = (SIDE - 1) / 2 * (1 - factor)
    matrix = np.array([[factor, 0, middle], [0, factor, middle]])
    return cv2.warpAffine(image, matrix, (SIDE, SIDE), borderMode=cv2.BORDER_REFLECT)


def trained(size, image=None, growth=1.0):
    """Return a regression after one example."""
    empty = ScaleRegression.create(*size)
    return empty.updated(picture() if image is None else image, CENTER, growth, 1.0)


@pytest.mark.parametrize('size', [(40.0, 40.0), (60.0, 30.0), (75.0, 60.0)])
@pytest.mark.parametrize('factor', [0.9, 0.95, 1.0, 1.05, 1.1])
def test_a_known_growth_is_found(size, factor):
    """The growth of a picture enlarged about the target's centre is found to 2.5 %."""
    found = trained(size).growth(enlarged(picture(), factor), CENTER)
    assert abs(np.log(found / factor)) < 0.025


@pytest.mark.parametrize('factor', [0.9, 1.1])
def test_what_was_learned_as_grown_has_not_grown_since(factor):
    """After an enlarged example was learned with its growth, the original has growth 1."""
    grown = enlarged(picture(), factor)
    again = trained((60.0, 60.0), grown, growth=factor)
    assert again.growth(picture(), CENTER) == pytest.approx(1.0, abs=0.02)
    assert again.growth(grown, CENTER) == pytest.approx(factor, abs=0.02)


@pytest.mark.parametrize('speed', [0.98, 1.02])
def test_steady_growth_is_followed_without_end(speed):
    """Growth by 2 % a step, threefold in all, is followed to 10 %, sampled at the last size."""
    size = 1.0
    regression = trained((30.0, 30.0))
    for step in range(1, 56):
        seen = enlarged(picture(), speed**step / size)
        growth = regression.growth(seen, CENTER)
        regression = regression.updated(seen, CENTER, growth, 0.05)
        size *= growth
    assert size == pytest.approx(speed**55, rel=0.1)


def test_no_more_is_found_than_was_learned():
    """The estimate is clamped to the range of the learned scales, |log growth| <= 0.2."""
    regression = trained((40.0, 40.0))
    for factor in (0.4, 0.6, 1.7, 2.5):
        assert abs(np.log(regression.growth(enlarged(picture(), factor), CENTER))) <= 0.2 + 1e-9


def test_nothing_to_see_is_no_growth():
    """A uniform picture has growth 1."""
    even = np.full((SIDE, SIDE), 90, np.uint8)
    assert trained((40.0, 30.0), even).growth(even, CENTER) == pytest.approx(1.0, abs=1e-6)


def test_examples_are_averaged_and_the_old_regression_stays():
    """A rate r keeps 1 - r of what was known."""
    first = trained((40.0, 40.0))
    kept = first.examples.copy()
    other = picture(1)
    second = first.updated(other, CENTER, 1.0, 0.25)
    alone = trained((40.0, 40.0), other)
    np.testing.assert_allclose(
        second.examples, 0.75 * kept + 0.25 * alone.examples, atol=1e-6)
    np.testing.assert_array_equal(first.examples, kept)
