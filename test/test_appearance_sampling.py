"""Windows of a frame and grids of places against plain computations."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from vtrack_ros.appearance.sampling import PixelWindow, sample_grids, sparse_part


def plain_window(image, center, size, shape):
    """Sample an image bilinearly at the centres of a window's cells, its border replicated."""
    rows, columns = shape
    height, width = image.shape[:2]
    result = np.empty((rows, columns, *image.shape[2:]))
    for row in range(rows):
        for column in range(columns):
            # clamped, so that only the window's own pixels are used
            x, y = (
                middle + min(max((index + 0.5) / count * length, 0.5), length - 0.5)
                - length / 2 - 0.5
                for middle, index, count, length in (
                    (center[0], column, columns, size[0]), (center[1], row, rows, size[1])))
            left, top = math.floor(x), math.floor(y)
            value = 0.0
            for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
                share = (x - left if dx else 1 - x + left) * (y - top if dy else 1 - y + top)
                pixel = image[min(max(top + dy, 0), height - 1), min(max(left + dx, 0), width - 1)]
                value = value + share * pixel.astype(np.float64)
            result[row, column] = value
    return result


def smooth_image(colour, shape=(90, 120), seed=0):
    """Return smooth blobs, so that a rounding of coordinates to 1/32 px changes little."""
    channels = np.random.default_rng(seed).normal(size=(*shape, 3 if colour else 1))
    smooth = cv2.GaussianBlur(channels, (0, 0), 5).reshape(*shape, -1)
    image = (128 + 45 * smooth / smooth.std()).clip(0, 255).astype(np.uint8)
    return image if colour else image[:, :, 0]


@pytest.mark.parametrize('colour', [True, False])
@pytest.mark.parametrize('center, size, shape', [
    ((60.0, 45.0), (30, 24), (24, 30)),
    ((60.0, 44.5), (20, 13), (31, 37)),
    ((2.0, 3.0), (30, 24), (20, 25)),
    ((118.0, 88.0), (40, 40), (33, 33)),
    ((60.0, 45.0), (160, 130), (80, 100)),
], ids=['inside', 'enlarged', 'over the corner', 'over the other corner',
        'larger than the image'])
def test_a_window_is_the_bilinear_one(colour, center, size, shape):
    """Without subsampling it's bilinear, to the precision of OpenCV's coordinates."""
    image = smooth_image(colour)
    window = PixelWindow.about(center, size)
    assert window.center == center and (window.width, window.height) == size
    found = window.sampled(image, *shape)
    assert found.shape == plain_window(image, center, size, shape).shape
    assert found.dtype == np.uint8
    difference = np.abs(found - plain_window(image, center, size, shape))
    assert difference.max() <= 2 and difference.mean() < 0.5


def test_a_window_lies_on_whole_pixels():
    """It's rounded to the nearest whole pixels, and has at least one."""
    assert PixelWindow.about((60.3, 44.8), (29.6, 24.2)) == PixelWindow(45, 33, 30, 24)
    assert PixelWindow.about((10.0, 10.0), (0.1, 0.2)) == PixelWindow(10, 10, 1, 1)


@pytest.mark.parametrize('center', [(301.0, 200.0), (300.0, 200.0), (10.0, 20.0)])
def test_a_shrunk_window_stays_in_place(center):
    """A ramp is sampled as a ramp in its place, though pixels are skipped."""
    y, x = np.mgrid[:400, :600] + 0.5
    image = np.stack([x * 0.4, y * 0.6, x * 0.2 + y * 0.2], -1).astype(np.uint8)
    size = (240, 180)
    found = PixelWindow.about(center, size).sampled(image, 30, 40).astype(np.float64)
    columns = (center[0] + ((np.arange(40) + 0.5) / 40 - 0.5) * size[0]).clip(0.5, 599.5)
    rows = (center[1] + ((np.arange(30) + 0.5) / 30 - 0.5) * size[1]).clip(0.5, 399.5)
    np.testing.assert_allclose(found[:, :, 0], np.tile(columns * 0.4, (30, 1)), atol=1.6)
    np.testing.assert_allclose(found[:, :, 1], np.tile(rows * 0.6, (40, 1)).T, atol=1.6)


def test_a_huge_window_over_the_border_stays_in_place():
    """A window too large for a copy with a replicated border is sampled in the right places."""
    x = np.arange(3000)
    image = np.tile((x * 0.08).astype(np.uint8), (2000, 1))
    found = PixelWindow.about((1000.0, 1000.0), (2800, 2600)).sampled(image, 65, 70)
    columns = (1000 + ((np.arange(70) + 0.5) / 70 - 0.5) * 2800).clip(0.5, 2999.5)
    np.testing.assert_allclose(found, np.tile(columns * 0.08, (65, 1)), atol=1.1)


def test_what_is_inside_is_sampled_alike_over_the_border():
    """A frame that is padded by replicating its border has the same windows as before."""
    image = smooth_image(True)
    larger = np.pad(image, ((50, 50), (50, 50), (0, 0)), mode='edge')
    for left, top in ((-20, -10), (100, 70), (-40, 30)):
        np.testing.assert_array_equal(
            PixelWindow(left, top, 45, 40).sampled(image, 20, 24),
            PixelWindow(left + 50, top + 50, 45, 40).sampled(larger, 20, 24))


@pytest.mark.parametrize('corner', [(-500, -300), (4000, 3000), (-500, 3000)])
def test_a_window_outside_the_image_repeats_its_border(corner):
    """Beyond a corner all samples have the nearest corner's colour."""
    image = smooth_image(True)
    found = PixelWindow(*corner, 30, 30).sampled(image, 5, 6)
    nearest = image[0 if corner[1] < 0 else -1, 0 if corner[0] < 0 else -1]
    np.testing.assert_array_equal(found, np.broadcast_to(nearest, (5, 6, 3)))


def test_grids_are_sampled_exactly():
    """They're bilinear, rounded to whole grey levels, and exact with every version of OpenCV."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (20, 30), dtype=np.uint8)
    # eighths of a pixel, so that the computation itself has no rounding errors
    x = rng.integers(-40, 280, (3, 12)).astype(np.float32) / 8
    y = rng.integers(-40, 200, (3, 9)).astype(np.float32) / 8
    found = sample_grids(image, x, y)
    assert found.shape == (3, 9, 12) and found.dtype == np.uint8
    padded = np.pad(image.astype(float), 50, mode='edge')
    for grid in range(3):
        for row, column in np.ndindex(9, 12):
            left, top = math.floor(x[grid, column]), math.floor(y[grid, row])
            across, down = x[grid, column] - left, y[grid, row] - top
            part = padded[top + 50:top + 52, left + 50:left + 52]
            exact = np.array([1 - down, down]) @ part @ np.array([1 - across, across])
            assert found[grid, row, column] == np.rint(exact)


def bilinear(image, x, y):
    """Return an image's value at a place, counted from the middle of the first pixel."""
    left, top = math.floor(x), math.floor(y)
    return sum(
        (x - left if dx else 1 - x + left) * (y - top if dy else 1 - y + top)
        * image[min(max(top + dy, 0), image.shape[0] - 1),
                min(max(left + dx, 0), image.shape[1] - 1)].astype(float)
        for dx in (0, 1) for dy in (0, 1))


@pytest.mark.parametrize('colour', [True, False])
@pytest.mark.parametrize('center', [
    (60.0, 45.0), (4.0, 80.0), (-300.0, 20.0), (-500.0, 40.0), (60.0, 900.0)])
@pytest.mark.parametrize('angle', [0.4, -2.0, math.pi])
def test_a_turned_window_is_bilinear_to_a_32nd(angle, center, colour):
    """At places rounded to 1/32 px it's bilinear, to a grey level; the border is replicated."""
    shape = (90, 120, 3)[:2 + colour]
    image = np.random.default_rng(0).integers(256, size=shape, dtype=np.uint8)
    found = PixelWindow.about(center, (30, 24), angle).sampled(image, 16, 20)
    for row, column in ((0, 0), (5, 19), (15, 7), (9, 12)):
        along, down = 30 * ((column + 0.5) / 20 - 0.5), 24 * ((row + 0.5) / 16 - 0.5)
        x = center[0] - 0.5 + math.cos(angle) * along - math.sin(angle) * down
        y = center[1] - 0.5 + math.sin(angle) * along + math.cos(angle) * down
        expected = bilinear(image, round(32 * x) / 32, round(32 * y) / 32)
        np.testing.assert_allclose(found[row, column], expected, atol=1)


@pytest.mark.parametrize('colour', [True, False])
def test_a_turned_window_of_a_long_frame_is_that_of_its_part(colour):
    """A frame's side may exceed the 32,766 px that OpenCV remaps, as a scanner's does."""
    part = smooth_image(colour)
    frame = np.zeros((90, 40_000, *part.shape[2:]), np.uint8)
    frame[:, -120:] = part
    for x in (60, 110):
        found = PixelWindow.about((39_880 + x, 40), (30, 24), 0.4).sampled(frame, 16, 20)
        assert np.array_equal(
            found, PixelWindow.about((x, 40), (30, 24), 0.4).sampled(part, 16, 20))


def test_a_turned_window_may_be_longer_than_that():
    """A window of 70,000 px samples a ramp as a ramp, though pixels are skipped."""
    ramp = np.linspace(0, 250, 80_000)[None].repeat(30, axis=0).astype(np.uint8)
    window = PixelWindow.about((40_000, 15), (70_000, 20), math.pi)
    found = window.sampled(ramp, 4, 50).astype(np.float64)
    columns = 40_000 - 70_000 * ((np.arange(50) + 0.5) / 50 - 0.5)
    assert np.abs(found - columns / 80_000 * 250).max() < 2


@pytest.mark.parametrize('center, corner', [((-500, -500), (0, 0)), ((900, 900), (-1, -1))])
def test_a_turned_window_beyond_a_corner_shows_its_pixel(center, corner):
    """All of its samples are the corner's pixel."""
    image = smooth_image(True)
    found = PixelWindow.about(center, (30, 24), 0.4).sampled(image, 16, 20)
    assert (found == image[corner]).all()


@pytest.mark.parametrize('angle', [0.3, -1.2, 2.8])
def test_a_turned_window_shows_a_turned_target_upright(angle):
    """It shows a turned frame as an upright one shows the original; clockwise is positive."""
    image, center = smooth_image(True, (200, 240)), (120.0, 100.0)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    middle = np.subtract(center, 0.5)
    matrix = np.column_stack([turn, middle - turn @ middle])
    turned = cv2.warpAffine(image, matrix, (240, 200), borderMode=cv2.BORDER_REPLICATE)
    upright = PixelWindow.about(center, (60, 48)).sampled(image, 30, 40)
    seen = PixelWindow.about(center, (60, 48), angle).sampled(turned, 30, 40)
    assert np.abs(seen.astype(int) - upright).max() <= 3


def test_a_sparse_part_of_a_small_frame_is_every_tenth_pixel():
    """They are those of the whole frame, to its last row, and no random number is drawn."""
    frame = np.random.default_rng(0).integers(0, 256, (31, 41, 3), np.uint8)
    rng = np.random.default_rng(1)
    part, first = sparse_part(frame, 10, 20, rng)
    assert first == (0, 0)
    np.testing.assert_array_equal(part, frame[::10, ::10])
    assert rng.bit_generator.state == np.random.default_rng(1).bit_generator.state


@pytest.mark.parametrize('shape', [(300, 400), (40, 3000), (3000, 40)])
def test_parts_of_a_large_frame_are_anywhere_and_no_larger_than_that(shape):
    """Each is a part of the frame, nearly as large as allowed; together they cover it."""
    frame, rng = np.arange(math.prod(shape)).reshape(shape), np.random.default_rng(0)
    seen = np.zeros(shape, bool)
    for _ in range(1000):
        part, (x, y) = sparse_part(frame, 3, 600, rng)
        rows, columns = part.shape
        assert 570 < rows * columns <= 600
        np.testing.assert_array_equal(part, frame[y::3, x::3][:rows, :columns])
        seen[y:y + 3 * rows, x:x + 3 * columns] = True
    assert seen.all()
