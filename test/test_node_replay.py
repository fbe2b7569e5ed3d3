"""The node and a session without a node give the same results, bit for bit."""

from itertools import islice

from node_harness import Client, NodeProcess
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image

from vtrack_ros.bags import BagReader
from vtrack_ros.session.session import TrackingSession

COUNT = 25


@pytest.mark.parametrize('tracker', ['gmpf', 'pqkpf', 'abmspf', 'appf'])
def test_node_and_replay_agree(repository, tracker):
    """With the same seed, and no frame dropped, every box is the same double."""
    path = repository / 'bags' / 'face_fast'
    with BagReader(path) as bag:
        frames = list(islice(bag.frames(), COUNT))
        images = [deserialize_message(bytes(raw.data), Image)
                  for raw in islice(bag.raw({bag.image_topic().name}), COUNT)]
        truth = bag.truth()
    box = truth[frames[0].stamp]
    session = TrackingSession(tracker, seed=11)
    expected = [session.start(frames[0].frame, frames[0].stamp, box)]
    expected += [session.update(frame.frame, frame.stamp) for frame in frames[1:]]

    numbers = ', '.join(map(repr, box.as_array().tolist()))
    with NodeProcess(tracker=tracker, seed=11, init_box=f'[{numbers}]'), Client() as client:
        client.ready()
        answers = [client.send_message(image) for image in images]
    assert len(answers) == len(expected) == COUNT
    for answer, estimate in zip(answers, expected):
        if not estimate.measured:
            assert not answer.detections
            continue
        bounds = answer.detections[0].bbox
        assert (bounds.center.position.x, bounds.center.position.y) == estimate.box.center
        assert (bounds.size_x, bounds.size_y) == (estimate.box.width, estimate.box.height)
        assert answer.detections[0].results[0].hypothesis.score == estimate.confidence
