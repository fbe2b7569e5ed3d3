"""The moving-edge cue: abstention, likelihood, directions, and a moving camera."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from vtrack_ros.replicas.motion_edge import MotionEdge

SHAPE = (120, 160)
WHOLE = (0, 0, SHAPE[1], SHAPE[0])


def background(shape=SHAPE, seed=0):
    """Return smooth blobs, without noise."""
    noise = np.random.default_rng(seed).normal(size=shape)
    smooth = cv2.GaussianBlur(noise, (0, 0), 4)
    return (128 + 40 * smooth / smooth.std()).clip(0, 255).astype(np.uint8)


def with_square(image, x, y=60, side=30, value=250):
    """Return the image with a bright square about a centre."""
    frame = image.copy()
    frame[y - side // 2:y + side // 2, x - side // 2:x + side // 2] = value
    return frame


def boxes(*rows):
    """Return boxes of 36 pixels about centres."""
    return np.array([[x, y, 36.0, 36.0] for x, y in rows])


def test_it_abstains_while_nothing_moves():
    """When the frame repeats, likelihoods are NaN, even after the target has been seen moving."""
    edges = MotionEdge()
    still = background()
    edges.advance(with_square(still, 60), WHOLE)
    assert np.isnan(edges.likelihoods(boxes((60, 60)), 0.2)).all()
    edges.update(boxes((60, 60))[0])
    edges.advance(with_square(still, 64), WHOLE)
    edges.update(boxes((64, 60))[0])
    assert np.isfinite(edges.likelihoods(boxes((64, 60)), 0.2)).all()
    edges.advance(with_square(still, 64), WHOLE)
    assert np.isnan(edges.likelihoods(boxes((64, 60), (20, 20)), 0.2)).all()


def test_a_moving_target_is_more_likely_than_still_ground():
    """With a reference learned in one step, the moving target's box is the most likely next."""
    edges = MotionEdge()
    still = background()
    for x in (60, 64):
        edges.advance(with_square(still, x), WHOLE)
        edges.update(boxes((x, 60))[0])
    edges.advance(with_square(still, 68), WHOLE)
    on, beside, away = edges.likelihoods(boxes((68, 60), (96, 75), (120, 30)), 0.2)
    assert on > max(beside, away)
    assert 0 < min(beside, away) and on <= 1


def test_likelihood_is_the_papers_function_of_the_distance():
    """exp(-D^2 / (2 sigma^2)) with D^2 = 1 - rho: another sigma is another power of it."""
    edges = MotionEdge()
    still = background()
    for x in (60, 63, 67):
        edges.advance(with_square(still, x), WHOLE)
        edges.update(boxes((x - 2, 60))[0])
    some = boxes((67, 60), (75, 62), (110, 60))
    narrow, wide = edges.likelihoods(some, 0.1), edges.likelihoods(some, 0.3)
    np.testing.assert_allclose(np.log(narrow), 9 * np.log(wide), rtol=1e-9)


@pytest.mark.parametrize('turn', [0, 1, 2, 3])
def test_directions_turn_with_the_picture(turn):
    """A quarter turn of the motion shifts the histogram by four of sixteen direction bins."""
    def histogram(quarters):
        edges = MotionEdge()
        still = background((121, 121))
        ramp = np.linspace(0, 250, 31).astype(np.uint8)
        for shift in (0, 3):
            frame = still.copy()
            frame[45:76, 45 + shift:76 + shift] = ramp[None, :]
            edges.advance(np.ascontiguousarray(np.rot90(frame, -quarters)), (0, 0, 121, 121))
        return edges.histograms(np.array([[60.5, 60.5, 66.0, 66.0]]))[0]

    plain, turned = histogram(0), histogram(turn)
    assert plain[:16].sum() > 0.05
    # with y down, a turn to the right adds a quarter to the angle
    np.testing.assert_allclose(np.roll(plain[:16], 4 * turn), turned[:16], atol=0.03)
    assert plain[16] == pytest.approx(turned[16], abs=0.03)


def test_a_moving_camera_moves_nothing():
    """After a shift of the whole image few edges move; without alignment there would be many."""
    wide = background((140, 200))
    first, second = wide[10:130, 20:180], wide[14:134, 26:186]
    edges = MotionEdge()
    for frame in (first, second):
        edges.advance(np.ascontiguousarray(frame), WHOLE)
    inner = np.array([[80.0, 60.0, 100.0, 70.0]])
    moved = edges.histograms(inner)[0, :16].sum()
    difference = cv2.absdiff(first, second)
    gradient = np.abs(cv2.Sobel(difference, cv2.CV_32F, 1, 0, scale=0.25)) + np.abs(
        cv2.Sobel(difference, cv2.CV_32F, 0, 1, scale=0.25))
    assert (gradient > 5).mean() > 0.3
    assert moved < 0.15


def test_a_region_gives_what_the_whole_picture_gives():
    """Its histograms are those of the whole image, with boxes in pixels of the whole image."""
    still = background()
    results = []
    for region in (WHOLE, (30, 25, 130, 100)):
        edges = MotionEdge()
        for x in (60, 64):
            edges.advance(with_square(still, x), region)
        results.append(edges.histograms(boxes((66, 62), (80, 60))))
    np.testing.assert_allclose(results[0], results[1], atol=0.02)


def test_colour_frames_are_looked_at_in_grey():
    """A grey image in three channels gives the histograms of the grey image."""
    still = background()
    found = []
    for colour in (False, True):
        edges = MotionEdge()
        for x in (60, 64):
            frame = with_square(still, x)
            edges.advance(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR) if colour else frame, WHOLE)
        found.append(edges.histograms(boxes((62, 60))))
    np.testing.assert_array_equal(found[0], found[1])
