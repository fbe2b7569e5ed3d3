"""A short bag for tests of what is done with it."""

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
