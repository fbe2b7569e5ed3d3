"""Memory of a tracker in large frames: what it keeps, and the peak during a search."""

import tracemalloc

import numpy as np
import pytest

from vtrack_ros.geometry import Box
from vtrack_ros.trackers import create_tracker, tracker_names, TrackState


@pytest.mark.parametrize('name', tracker_names(replicas=False))
def test_memory_stays_small_at_full_hd(name):
    """After frames of 1920 x 1080 a tracker keeps less than 50 MB."""
    rng = np.random.default_rng(0)
    frames = [rng.integers(256, size=(1080, 1920, 3), dtype=np.uint8) for _ in range(3)]
    box = Box(700, 300, 400, 300)
    create_tracker(name, seed=1).start(frames[0], box)  # tables are made once
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        tracker = create_tracker(name, seed=1)
        tracker.start(frames[0], box)
        for frame in frames[1:]:
            tracker.update(frame.copy())
        held = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert held < 50e6


@pytest.mark.parametrize('name', ['gmpf', 'dcf'])
@pytest.mark.parametrize('side', [16, 1000])
def test_a_target_that_is_gone_takes_little_of_a_large_frame(name, side):
    """At 3840 x 2160 the peak of each update is below half a byte per pixel."""
    noise = np.random.default_rng(0).integers(256, size=(2160, 3840), dtype=np.uint8)
    first, *others = (np.stack([grey] * 3, axis=-1)
                      for grey in (noise, noise[::-1], noise[:, ::-1]))
    tracker = create_tracker(name, seed=1)
    tracker.start(first, Box(1400, 600, side, side))
    tracemalloc.start()
    try:
        for frame in others * 10:
            before, _ = tracemalloc.get_traced_memory()
            tracemalloc.reset_peak()
            estimate = tracker.update(frame)
            assert tracemalloc.get_traced_memory()[1] - before < noise.size / 2
    finally:
        tracemalloc.stop()
    assert estimate.state is not TrackState.TRACKING
