"""Bags that the tests of commands, node and demo read."""

from pathlib import Path


def write_short_bag(path: Path, repository: Path, frames: int = 10) -> Path:
    """Write the beginning of the face bag, with its truth; return the path."""
    from vtrack_ros.bags import BagReader, BagWriter
    with BagReader(repository / 'bags' / 'face_fast') as bag, BagWriter(path) as writer:
        truth = bag.truth()
        for _, image in zip(range(frames), bag.frames()):
            writer.write_frame(image.frame, image.stamp, frame_id=image.frame_id)
            writer.write_truth(truth[image.stamp], image.stamp)
    return path


def write_slow_bag(path: Path, frames: int = 300) -> Path:
    """Write a bag whose target moves so slowly that it isn't lost when frames are dropped."""
    from node_harness import Scene, STEP
    import numpy as np

    from vtrack_ros.bags import BagWriter
    scene = Scene()
    rng = np.random.default_rng(0)
    with BagWriter(path) as writer:
        for index in range(frames):
            noise = rng.integers(0, 5, (scene.height, scene.width, 3), np.uint8)
            stamp, place = 10**10 + STEP * index, index // 8
            writer.write_frame(scene.frame(place) + noise, stamp)
            writer.write_truth(scene.box(place), stamp)
    return path
