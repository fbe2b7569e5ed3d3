"""A target that comes nearer or goes away: its box follows the size."""

from __future__ import annotations

from functools import cache

import cv2
from drawn_video import COLOURS, noise_part, SIZE, texture
import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.trackers import create_tracker, TrackState


@cache
def approach():
    """Return frames and boxes of a target that grows from 18 to 180 px, with its surroundings."""
    rng = np.random.default_rng(3)
    ground = texture(
        (960, 1280), [(90, 110, 90), (130, 130, 120), (110, 90, 80), (140, 150, 150)], 40, rng)
    ground[390:570, 550:730] = texture((180, 180), COLOURS, 30, rng)
    levels = [ground]
    while len(levels) < 5:
        levels.append(cv2.pyrDown(levels[-1]))
    frames, boxes = [], []
    for scale in np.geomspace(0.1, 1.0, 70):
        level = int(np.log2(1 / scale))
        factor = 2**level * scale
        matrix = np.array([[factor, 0.0, SIZE[0] / 2 - 640 * scale],
                           [0.0, factor, SIZE[1] / 2 - 480 * scale]])
        image = cv2.warpAffine(levels[level], matrix, SIZE, borderMode=cv2.BORDER_REFLECT)
        noisy = image + 3 * noise_part(rng)
        frames.append(np.clip(noisy, 0, 255).astype(np.uint8))
        boxes.append(Box.from_center(SIZE[0] / 2, SIZE[1] / 2, 180 * scale, 180 * scale))
    return frames, boxes


@pytest.mark.parametrize('name, backwards', [
    ('dcf', False), ('dcf', True), ('gmpf', False), ('gmpf', True), ('pqkpf', False),
    ('abmspf', True), ('appf', False), ('pf', True)])
def test_a_target_may_come_ten_times_as_near(name, backwards):
    """A target that grows, or backwards shrinks, tenfold is tracked, with an IoU above 0.6."""
    frames, boxes = (each[::-1] if backwards else each for each in approach())
    tracker = create_tracker(name, seed=1)
    tracker.start(frames[0], boxes[0])
    estimates = [tracker.update(frame) for frame in frames[1:]]
    assert min(each.box.iou(box) for each, box in zip(estimates, boxes[1:])) > 0.6
    assert all(each.state is TrackState.TRACKING for each in estimates)
