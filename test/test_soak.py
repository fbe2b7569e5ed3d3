"""The soak test of benchmarks/soak.py, for seconds instead of an hour."""

from node_bench import Bench, scene, target_box, WAY
import numpy as np
from soak import soak

from vtrack_ros.trackers import create_tracker


def test_a_node_keeps_what_it_has():
    """Neither memory nor threads nor open files grow with the images."""
    bench = Bench()
    try:
        first, *_, last = soak(bench, windows=3, seconds=1.0, rate=60)
    finally:
        bench.close()
    assert last.found > 0
    assert last.least_iou > 0.7
    assert (last.threads, last.descriptors) == (first.threads, first.descriptors)
    # One VGA frame in each answer that is kept would be 40 MB.
    assert last.private_mb - first.private_mb < 4


def test_a_size_that_stays_is_kept():
    """Errors of 600 measurements of the size don't accumulate (they once gave a factor of 1.4)."""
    width, height = 640, 480
    messages, _ = scene(width, height)
    frames = [np.frombuffer(one.data, np.uint8).reshape(height, width, 3) for one in messages]
    tracker = create_tracker('gmpf', seed=0)
    tracker.start(frames[0], target_box(0, width, height))
    for index in range(1, 600):
        estimate = tracker.update(frames[index % WAY])
    assert estimate.box.iou(target_box(index, width, height)) > 0.85
