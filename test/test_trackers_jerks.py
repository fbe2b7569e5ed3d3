"""A camera that is jerked: the whole picture jumps by several sides of the target."""

from __future__ import annotations

from functools import cache

from drawn_video import texture
import numpy as np
import pytest
from siamese_files import network_files

from vtrack_ros.geometry import Box
from vtrack_ros.trackers import create_tracker, TrackState

NAMES = ('gmpf', 'pqkpf', 'abmspf', 'appf', 'pf')
WIDTH, HEIGHT, SIDE = 320, 240, 30
#: Offsets (x, y) of the camera's view from the scene's middle between jerks, in target sides.
VIEWS = ((0, 0), (3, 0), (0, 0), (-1.8, -2.4), (1, 0.4), (0, 3), (-2, 1), (2, -1), (0, 0))


@cache
def jerked(seed):
    """Return frames, and boxes, of a camera whose view jumps in every sixth frame."""
    rng = np.random.default_rng(seed)
    ground = texture((640, 800), [(90, 110, 90), (130, 130, 120), (110, 90, 80), (140, 150, 150)],
                     12, rng)
    target = texture((SIDE, SIDE), [(20, 20, 200), (0, 220, 255), (10, 10, 40)], 8, rng)
    film = []
    for step in range(6 * len(VIEWS)):
        scene = ground.copy()
        x, y = 385 + step // 2, 305 + step // 3
        scene[y:y + SIDE, x:x + SIDE] = target
        left, top = (round(middle + SIDE * shift) for middle, shift in zip(
            (240, 200), VIEWS[step // 6]))
        noise = rng.normal(0, 2, (HEIGHT, WIDTH, 1))
        frame = np.clip(scene[top:top + HEIGHT, left:left + WIDTH] + noise, 0, 255)
        film.append((frame.astype(np.uint8), Box(x - left, y - top, SIDE, SIDE)))
    return film


@pytest.mark.parametrize('seed, name', list(enumerate(NAMES)))
def test_a_target_is_found_in_the_frame_after_a_jerk(name, seed):
    """The jump, of up to 4.5 sides, is beyond any search window; it's measured by the image."""
    tracker = create_tracker(name, seed=seed)
    for step, (frame, box) in enumerate(jerked(seed)):
        if not step:
            tracker.start(frame, box)
            continue
        estimate = tracker.update(frame)
        assert estimate.box.iou(box) > 0.7
        assert estimate.state is TrackState.TRACKING


@pytest.mark.parametrize('seed, name', list(enumerate(NAMES)))
def test_a_network_finds_a_target_after_a_jerk(name, seed):
    """The IoU stays above 0.5: boxes are less exact, the window is no wider than the jerk."""
    tracker = create_tracker(name, seed=seed, localiser='siamese', **network_files())
    for step, (frame, box) in enumerate(jerked(seed)):
        if not step:
            tracker.start(frame, box)
            continue
        assert tracker.update(frame).box.iou(box) > 0.5
