"""Gradients and colours against plain computations."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from vtrack_ros.appearance.colour_model import box_mean, colour_index, ColourModel
from vtrack_ros.appearance.features import (
    all_colours, COLOUR_CHANNELS, colour_names, COLOURS, GRADIENT_CHANNELS, memberships,
    oriented_gradients, rgb555)


def step_edge(angle, side=48, low=60.0, high=180.0):
    """Return a soft edge through the middle, brighter in the direction of the angle."""
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    distance = x * math.cos(angle) + y * math.sin(angle)
    return (low + (high - low) / (1 + np.exp(-distance))).astype(np.uint8)


def directions(features):
    """Return the 18 signed orientations, from their sums and differences."""
    sums, differences = features[:9] / math.sqrt(1.5), features[9:] / math.sqrt(0.5)
    return np.concatenate([sums + differences, sums - differences]) / 2


@pytest.mark.parametrize('bin_', range(18))
def test_an_edges_direction_is_its_bin(bin_):
    """An edge falls into its bin of 18 signed, or of 9 unsigned, orientations of 20 degrees."""
    features = oriented_gradients(step_edge(2 * math.pi * bin_ / 18), 4)
    middle = features[:, 5:7, 5:7].sum(axis=(1, 2))
    assert directions(middle).argmax() == bin_
    assert middle[:9].argmax() == bin_ % 9


def test_scalar_products_are_those_of_signed_and_unsigned_orientations():
    """Products of the 18 channels equal those of the 18 signed and 9 unsigned orientations."""
    rng = np.random.default_rng(3)
    first, second = (oriented_gradients(
        cv2.GaussianBlur(rng.integers(256, size=(40, 40), dtype=np.uint8), (0, 0), 2), 4)
        for _ in range(2))
    both = []
    for features in (first, second):
        signed = directions(features)
        both.append(np.concatenate([signed, signed[:9] + signed[9:]]))
    np.testing.assert_allclose(
        (first * second).sum(axis=0), (both[0] * both[1]).sum(axis=0), rtol=1e-4)


def test_gradients_dont_depend_on_contrast():
    """Half the contrast changes features by up to a quarter; a flat image has none at all."""
    strong = directions(oriented_gradients(step_edge(0.7, low=20, high=240), 4))
    weak = directions(oriented_gradients(step_edge(0.7, low=75, high=185), 4))
    assert strong.shape == (GRADIENT_CHANNELS, 12, 12) and GRADIENT_CHANNELS == 18
    assert strong.min() >= -1e-6 and strong.max() <= 0.4 + 1e-6
    where = strong > 0.1
    assert where.any()
    np.testing.assert_allclose(weak[where], strong[where], rtol=0.25)
    assert not oriented_gradients(np.full((24, 24), 77, np.uint8), 4).any()


def test_an_edge_moves_its_cell_only():
    """A bright spot has the strongest features in its own cell, and none four cells away."""
    image = np.full((40, 40), 80, np.uint8)
    image[21:23, 17:19] = 250
    features = oriented_gradients(image, 4)
    strength = np.abs(features).sum(axis=0)
    assert strength[5, 4] == strength.max()
    assert not strength[:3].any() and not strength[:, 8:].any()


def test_colour_names_sum_to_nothing():
    """Memberships sum to one, and so do their means, so that their differences sum to zero."""
    assert memberships().shape == (COLOURS, 11)
    np.testing.assert_allclose(memberships().sum(axis=1), 0, atol=1e-9)


def test_folded_colour_names_keep_their_products():
    """Folding keeps 85 % of the energy, adds none, and keeps the products of usual colours."""
    described = colour_names(all_colours())
    assert described.shape == (COLOUR_CHANNELS, 1, COLOURS)
    numbers = described.reshape(COLOUR_CHANNELS, -1).T.astype(float)
    names = memberships()
    kept, energy = (numbers**2).sum(axis=1), (names**2).sum(axis=1)
    assert (kept <= energy + 1e-6).all()
    assert kept.sum() > 0.85 * energy.sum()
    levels = all_colours()[0].astype(int)
    usual = np.ptp(levels, axis=1) < 60
    pairs = np.random.default_rng(0).choice(np.flatnonzero(usual), (2, 5000))
    products = [(table[pairs[0]] * table[pairs[1]]).sum(axis=1) for table in (names, numbers)]
    assert np.corrcoef(*products)[0, 1] > 0.99


@pytest.mark.parametrize('index, colour', list(enumerate([
    (0, 0, 0), (230, 80, 20), (20, 60, 110), (128, 128, 128), (40, 150, 40), (0, 140, 255),
    (180, 105, 255), (150, 30, 130), (40, 40, 220), (255, 255, 255), (0, 230, 240)])),
    ids=['black', 'blue', 'brown', 'grey', 'green', 'orange', 'pink', 'purple', 'red', 'white',
         'yellow'])
def test_a_typical_colour_has_its_own_name(index, colour):
    """Its highest membership is its own term of Berlin and Kay's eleven, in this order."""
    names = memberships()[rgb555(np.array([[colour]], np.uint8))[0, 0]]
    assert names.argmax() == index


def test_foreground_probability_is_bayes_with_even_odds():
    """p(colour | target) / (p(colour | target) + p(colour | surroundings)), by counting."""
    pixels = np.zeros((30, 30), np.uint8)
    pixels[10:20, 10:20] = 100
    pixels[10:20, 10:12] = 200
    pixels[:5] = 200
    colours = colour_index(pixels)
    model = ColourModel.create().updated(colours, (10, 20, 10, 20), 1.0)
    # a margin of 2 px about the target counts for neither
    surroundings = 30 * 30 - 14 * 14
    share = 5 * 30 / surroundings
    probability = model.probability(colours)
    assert probability[15, 15] == pytest.approx(1, abs=1e-4)
    assert probability[15, 11] == pytest.approx(0.2 / (0.2 + share), abs=1e-3)
    assert probability[25, 25] == pytest.approx(0, abs=1e-4)
    assert model.target.sum() == pytest.approx(1) and model.surroundings.sum() == pytest.approx(1)


def test_foreground_learning_is_a_running_average():
    """A rate r keeps 1 - r of what was known; unknown colours have probability 0."""
    first, second = np.zeros((20, 20, 3), np.uint8), np.zeros((20, 20, 3), np.uint8)
    first[5:15, 5:15] = (255, 0, 0)
    second[5:15, 5:15] = (0, 0, 255)
    model = ColourModel.create().updated(colour_index(first), (5, 15, 5, 15), 1.0)
    after = model.updated(colour_index(second), (5, 15, 5, 15), 0.25)
    blue, red = (colour_index(np.array([[c]], np.uint8))[0, 0]
                 for c in ((255, 0, 0), (0, 0, 255)))
    assert after.target[blue] == pytest.approx(0.75)
    assert after.target[red] == pytest.approx(0.25)
    assert model.target[blue] == 1
    assert model.probability(colour_index(np.full((1, 1, 3), 128, np.uint8)))[0, 0] == 0


def test_box_mean():
    """It's the mean over a box about each pixel, with zeros outside the image."""
    image = np.random.default_rng(0).uniform(size=(12, 15)).astype(np.float32)
    mean = box_mean(image, (5, 3))
    assert mean[6, 7] == pytest.approx(image[5:8, 5:10].mean(), rel=1e-5)
    assert mean[0, 0] == pytest.approx(image[:2, :3].sum() / 15, rel=1e-5)


def test_15_bits_of_a_colour():
    """Five bits each of red, green and blue; `all_colours` is in the order of these numbers."""
    pixels = np.array([[(255, 0, 0), (0, 255, 0), (0, 0, 255), (8, 16, 24)]], np.uint8)
    assert rgb555(pixels).tolist() == [[31, 31 << 5, 31 << 10, 1 | 2 << 5 | 3 << 10]]
    np.testing.assert_array_equal(rgb555(all_colours())[0], np.arange(COLOURS))
