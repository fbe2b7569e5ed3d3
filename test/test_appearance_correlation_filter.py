"""Correlation filters: their responses to examples that they have learned, and to others."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.fft

from vtrack_ros.appearance.regression import CorrelationFilter, taper
from vtrack_ros.localisation.response_map import parabola_offset, subcell_offset

ROWS, COLUMNS, WIDTH = 20, 24, 1.5


def features(seed=0, channels=4, rows=ROWS, columns=COLUMNS):
    """Return random features."""
    return np.random.default_rng(seed).normal(size=(channels, rows, columns)).astype(np.float32)


def label(shift=(0, 0), width=WIDTH):
    """Return a cyclic Gaussian whose peak is `shift` (x, y) cells from the middle."""
    y = np.arange(ROWS)[:, None] - ROWS // 2
    x = np.arange(COLUMNS)[None, :] - COLUMNS // 2
    gauss = np.exp(-(x**2 + y**2) / (2 * width**2))
    return np.roll(gauss, (shift[1], shift[0]), (0, 1))


def trained(shift=(0.0, 0.0), seed=0):
    """Return a filter after one example, and the example's spectrum."""
    empty = CorrelationFilter.create(ROWS, COLUMNS, WIDTH)
    spectrum = empty.transform(features(seed))
    return empty.updated(spectrum, 1.0, shift), spectrum


@pytest.mark.parametrize('shift', [(0, 0), (3, 0), (-2, 4), (5, -6)])
def test_its_own_example_gets_the_wanted_response(shift):
    """The response to the training example is the desired Gaussian at the given shift."""
    filter_, spectrum = trained(tuple(float(value) for value in shift))
    np.testing.assert_allclose(filter_.response(spectrum), label(shift), atol=0.02)


def test_the_spectrum_is_that_of_the_tapered_features():
    """It's the two-dimensional Fourier transform of each channel, tapered towards the edges."""
    faded = features() * taper(ROWS)[:, None] * taper(COLUMNS)
    np.testing.assert_allclose(
        CorrelationFilter.transform(features()), scipy.fft.rfft2(faded), atol=1e-4)


def test_a_shift_in_the_label_is_a_shift_of_the_example():
    """Learning a shifted example with its shift equals learning the example in the middle."""
    empty = CorrelationFilter.create(ROWS, COLUMNS, WIDTH)
    tapered = features() * taper(ROWS)[:, None] * taper(COLUMNS)
    moved = np.roll(tapered, (4, -3), (1, 2))
    spectra = [scipy.fft.rfft2(one) for one in (tapered, moved)]
    centred = empty.updated(spectra[0].astype(np.complex64), 1.0)
    shifted = empty.updated(spectra[1].astype(np.complex64), 1.0, (-3.0, 4.0))
    np.testing.assert_allclose(shifted.numerator, centred.numerator,
                               atol=1e-3 * np.abs(centred.numerator).max())
    np.testing.assert_allclose(shifted.denominator, centred.denominator, rtol=1e-3)


def test_the_response_moves_with_the_picture():
    """A pattern that is moved by whole cells moves the peak by as many."""
    empty = CorrelationFilter.create(40, 48, 1.5)
    pattern = features(1, rows=8, columns=8)
    scene = np.zeros((4, 40, 48), np.float32)
    scene[:, 16:24, 20:28] = pattern
    filter_ = empty.updated(empty.transform(scene), 1.0)
    for x, y in ((0, 0), (4, -3), (-5, 2)):
        moved = np.roll(scene, (y, x), (1, 2))
        response = filter_.response(filter_.transform(moved))
        assert divmod(response.argmax(), 48) == (20 + y, 24 + x)


def test_response_is_linear_and_unknown_pictures_get_little():
    """The response is about 1 to the example, below 0.6 to other features, and linear."""
    filter_, spectrum = trained()
    other = filter_.transform(features(seed=9))
    assert filter_.response(spectrum).max() > 0.95
    assert np.abs(filter_.response(other)).max() < 0.6
    np.testing.assert_allclose(
        filter_.response(spectrum + other), filter_.response(spectrum) + filter_.response(other),
        atol=1e-4)


def test_learning_averages_numerator_and_denominator():
    """[Danelljan et al. 2014, eq. 6]: a rate r keeps 1 - r; the old filter isn't touched."""
    filter_, _ = trained()
    kept = filter_.numerator.copy()
    second = filter_.transform(features(seed=3))
    alone = CorrelationFilter.create(ROWS, COLUMNS, WIDTH).updated(second, 1.0)
    after = filter_.updated(second, 0.25)
    np.testing.assert_allclose(
        after.numerator, 0.75 * filter_.numerator + 0.25 * alone.numerator,
        atol=1e-4 * np.abs(kept).max())
    np.testing.assert_allclose(
        after.denominator, 0.75 * filter_.denominator + 0.25 * alone.denominator, rtol=1e-4)
    np.testing.assert_array_equal(filter_.numerator, kept)


@pytest.mark.parametrize('peak', [0.0, 0.3, -0.45, 0.5])
def test_a_parabolas_peak_is_found_exactly(peak):
    """The maximum of a parabola is found from three of its points."""
    before, middle, after = (2 - 3 * (x - peak)**2 for x in (-1, 0, 1))
    assert parabola_offset(before, middle, after) == pytest.approx(peak)


def test_a_flat_map_has_no_finer_peak():
    """The offset is 0 where the middle point is no maximum, and at the map's border."""
    assert parabola_offset(1.0, 1.0, 1.0) == 0
    assert parabola_offset(2.0, 1.0, 2.0) == 0
    response = np.zeros((5, 6), np.float32)
    response[0, 5] = 1
    assert subcell_offset(response, 0, 5) == (0.0, 0.0)


def test_a_subcell_peak_in_two_dimensions():
    """The maximum of a paraboloid between the cells is found to 1e-5 cells."""
    y, x = np.mgrid[:9, :11]
    response = (5 - (x - 6.3)**2 - 2 * (y - 3.8)**2).astype(np.float32)
    assert subcell_offset(response, 4, 6) == (
        pytest.approx(0.3, abs=1e-5), pytest.approx(-0.2, abs=1e-5))


@pytest.mark.parametrize('rows, columns', [(8, 8), (20, 24), (18, 30)])
def test_the_response_is_an_inverse_fourier_transform(rows, columns):
    """The response is the inverse Fourier transform; a requested part equals that of the whole."""
    empty = CorrelationFilter.create(rows, columns, WIDTH)
    first, second = (empty.transform(features(seed, 4, rows, columns)) for seed in (0, 1))
    filter_ = empty.updated(first, 1.0)
    ratio = (filter_.numerator.conj() * second).sum(axis=0) / (filter_.denominator + 1e-2)
    wanted = scipy.fft.irfft2(ratio, s=(rows, columns))
    np.testing.assert_allclose(filter_.response(second), wanted, atol=1e-5)
    part = filter_.response(second, slice(2, 7), slice(1, 5))
    np.testing.assert_allclose(part, wanted[2:7, 1:5], atol=1e-5)
