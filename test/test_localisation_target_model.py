"""The target model: what it learns, and what it keeps of the first frame."""

from __future__ import annotations

import cv2
from drawn_video import SIZE, TARGET
import numpy as np
import pytest

from vtrack_ros.localisation.search_window import WindowLayout
from vtrack_ros.localisation.target_model import TargetModel

MIDDLE = (SIZE[0] / 2, SIZE[1] / 2)
LAYOUT = WindowLayout.around(*TARGET)


def texture(seed):
    """Return a frame of blobs."""
    noise = np.random.default_rng(seed).normal(size=(SIZE[1], SIZE[0], 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 3)
    return (128 + 50 * smooth / smooth.std()).clip(0, 255).astype(np.uint8)


def window_on(frame, size=TARGET):
    """Return the search window about a target of a size in the middle of a frame."""
    return LAYOUT.window(frame, MIDDLE, size)


def enlarged(frame, factor):
    """Return a frame enlarged about its middle."""
    matrix = cv2.getRotationMatrix2D((MIDDLE[0] - 0.5, MIDDLE[1] - 0.5), 0, factor)
    return cv2.warpAffine(frame, matrix, SIZE, borderMode=cv2.BORDER_REFLECT)


@pytest.mark.parametrize('confined', [False, True])
def test_what_was_seen_first_is_never_forgotten(confined):
    """After 800 frames of another appearance 5 to 50 % of the first one's response is left."""
    window, later = window_on(texture(0)), window_on(texture(1))
    first = model = TargetModel.create(window, confined)
    row, column = LAYOUT.rows // 2, LAYOUT.columns // 2

    def response(window):
        return float(model.correlation.response(window.spectrum)[row, column])

    own, foreign = response(window), response(later)
    for _ in range(800):
        model = model.updated(later, (0.0, 0.0), 1.0, first)
    assert 0.05 * own < response(window) < 0.5 * own
    assert response(later) > 2 * max(foreign, response(window))


@pytest.mark.parametrize('confined, dt, rate', [
    (False, 1.0, 0.02), (True, 1.0, 0.01), (False, 3.0, 0.06), (True, 3.0, 0.03)])
def test_an_example_has_its_weight(confined, dt, rate):
    """A frame's is 0.02, and 0.01 for the filter that is confined to the target."""
    window, later = window_on(texture(0)), window_on(texture(1))
    first, alone = (TargetModel.create(one, confined) for one in (window, later))
    after = first.updated(later, (0.0, 0.0), dt, first)
    # the example's weight, less the share of the first frame
    expected = first.correlation.mixed(alone.correlation, rate * (1 - 0.3 * rate))
    np.testing.assert_allclose(
        after.correlation.numerator, expected.numerator,
        atol=1e-5 * np.abs(expected.numerator).max())


def test_an_error_of_size_doesnt_add_up():
    """300 measurements of a constant size, each 0.5 % too large, add up to less than 12 %."""
    frame = texture(2)
    window = window_on(frame)
    first = model = TargetModel.create(window)
    size = 1.0
    for _ in range(300):
        # sampled at the size that was found before, as the tracker does
        window = window_on(enlarged(frame, 1 / size))
        growth = 1.005 * model.growth(window, (0.0, 0.0))
        model = model.with_scale(window, (0.0, 0.0), growth, 1.0, first)
        size *= growth
    assert 1.0 < size < 1.12
