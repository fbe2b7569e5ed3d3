"""The constrained correlation filter: its support is the target's box alone."""

import numpy as np
import pytest

from vtrack_ros.appearance.constrained_filter import ConstrainedFilter
from vtrack_ros.appearance.regression import (
    box_support, CorrelationFilter, inverse_maps, transformed_maps)

ROWS, COLUMNS, WIDTH, TARGET = 24, 28, 0.6, (9.0, 7.0)


def features(seed=0, channels=6):
    """Return random features of a window."""
    return np.random.default_rng(seed).normal(
        size=(channels, ROWS, COLUMNS)).astype(np.float32)


def learned(maps, rate=1.0, filter_=None):
    """Return the constrained filter after an example."""
    if filter_ is None:
        filter_ = ConstrainedFilter.within(*TARGET, CorrelationFilter.create(ROWS, COLUMNS, WIDTH))
    return filter_.updated(transformed_maps(maps), rate)


def peak(filter_, maps):
    """Return the (row, column) of the highest response to features."""
    values = filter_.response(transformed_maps(maps))
    return tuple(int(index) for index in np.unravel_index(values.argmax(), values.shape))


def test_maps_and_spectra_are_each_others_inverse():
    """`inverse_maps` inverts `transformed_maps`, which is the Fourier transform of each map."""
    maps = features()
    spectrum = transformed_maps(maps)
    np.testing.assert_allclose(spectrum, np.fft.rfft2(maps), atol=1e-3)
    np.testing.assert_allclose(inverse_maps(spectrum), maps, atol=1e-4)


def test_the_support_is_the_box():
    """Its area is the box's, about cell (0, 0); cells half a window away are outside."""
    support = box_support(ROWS, COLUMNS, *TARGET)
    assert support.sum() == pytest.approx(TARGET[0] * TARGET[1])
    assert support[0, 0] == 1 and support[ROWS // 2, 0] == support[0, COLUMNS // 2] == 0


def test_nothing_beyond_the_support_has_an_influence():
    """The filter's own weights are zero outside its support."""
    weights = inverse_maps(learned(features()).numerator)
    outside = box_support(ROWS, COLUMNS, *TARGET) == 0
    assert np.abs(weights[:, outside]).max() < 1e-4 * np.abs(weights).max()
    assert np.abs(weights).max() > 0


def test_it_finds_the_target_before_another_background():
    """The peak stays on a target while the background moves; an unconstrained filter's doesn't."""
    before, other = features(0), features(1)
    rows, columns = slice(8, 15), slice(10, 18)
    moved = before.copy()
    # the camera follows the target, which stays in place, while the learned background moves on
    moved[:] = np.roll(before, 5, axis=2)
    moved[:, rows, columns] = before[:, rows, columns]
    assert peak(learned(before), moved) == (ROWS // 2, COLUMNS // 2)
    free = CorrelationFilter.create(ROWS, COLUMNS, WIDTH).updated(transformed_maps(before), 1.0)
    assert peak(free, moved) == (ROWS // 2, COLUMNS // 2 + 5)
    assert peak(learned(before), other) != peak(learned(before), before)


def test_later_examples_are_averaged_in():
    """The updated filter is the weighted mean of the old one and of the new example's."""
    first, second = learned(features(0)), features(1)
    both = learned(second, 0.1, first)
    np.testing.assert_allclose(
        both.numerator, 0.9 * first.numerator + 0.1 * learned(second).numerator, atol=1e-5)


def test_a_shift_is_that_of_the_example():
    """An example that is learned with its shift has its peak in the middle when it's unshifted."""
    maps = features()
    empty = ConstrainedFilter.within(*TARGET, CorrelationFilter.create(ROWS, COLUMNS, WIDTH))
    shifted = empty.updated(transformed_maps(np.roll(maps, (2, -3), (1, 2))), 1.0, (-3.0, 2.0))
    assert peak(shifted, maps) == (ROWS // 2, COLUMNS // 2)
