"""Our vision_msgs is the one that other machines have: same type hashes, same wire format."""

from pathlib import Path
import subprocess
import sys
import time

import pytest
from shared_segments import kill

INTERFACES = Path(__file__).resolve().parents[1] / 'interfaces' / 'vision_msgs'
#: The type hashes of upstream's definitions.
HASHES = dict(line.split() for line in (INTERFACES / 'type_hashes.txt').read_text().splitlines()
              if not line.startswith('#'))
#: Time-out for discovery and delivery, in seconds.
PATIENCE = 20.0

PUBLISHER = """
import rclpy
from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose

rclpy.init()
node = rclpy.create_node('publisher')
publisher = node.create_publisher(Detection2DArray, 'detections', 1)
hypothesis = ObjectHypothesisWithPose()
hypothesis.hypothesis.class_id = 'face'
hypothesis.hypothesis.score = 0.75
hypothesis.pose.pose.position.x = -1.5
detection = Detection2D(id='7', results=[hypothesis])
detection.header.frame_id = 'camera'
detection.bbox.center.position.x = 10.25
detection.bbox.center.theta = 0.5
detection.bbox.size_y = 3.0
message = Detection2DArray(detections=[detection])
message.header.stamp.nanosec = 999999999
node.create_timer(0.02, lambda: publisher.publish(message))
rclpy.spin(node)
"""


def definition(name: str) -> str:
    """Return the text of one of our definitions."""
    return (INTERFACES / 'msg' / f'{name}.msg').read_text()


def test_every_definition_has_a_known_hash() -> None:
    """There is a reference hash for every definition, and for nothing else."""
    assert {path.stem for path in (INTERFACES / 'msg').iterdir()} == set(HASHES)


@pytest.mark.parametrize('name', HASHES)
def test_type_hash(name: str) -> None:
    """What rosbags computes from each of our definitions is upstream's hash."""
    typesys = pytest.importorskip('rosbags.typesys', reason='needs rosbags')
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    for other in HASHES:
        store.register(typesys.get_types_from_msg(definition(other), f'vision_msgs/msg/{other}'))
    assert store.hash_rihs01(f'vision_msgs/msg/{name}') == HASHES[name]


def test_over_dds() -> None:
    """What another process sends arrives whole, under upstream's type hash."""
    rclpy = pytest.importorskip('rclpy', reason='needs rclpy')
    messages = pytest.importorskip('vision_msgs.msg', reason='needs vision_msgs')
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('subscriber', context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    heard: list[object] = []
    subscription = node.create_subscription(
        messages.Detection2DArray, 'detections', heard.append, 1)
    process = subprocess.Popen([sys.executable, '-c', PUBLISHER])
    try:
        deadline = time.monotonic() + PATIENCE
        while not heard:
            assert time.monotonic() < deadline and process.poll() is None, 'nothing arrived'
            executor.spin_once(timeout_sec=0.1)
        [info] = node.get_publishers_info_by_topic('detections')
    finally:
        kill(process)
        node.destroy_subscription(subscription)
        node.destroy_node()
        rclpy.shutdown(context=context)

    assert str(info.topic_type_hash) == HASHES['Detection2DArray']
    message = heard[0]
    assert message.header.stamp.nanosec == 999999999
    [detection] = message.detections
    assert (detection.id, detection.header.frame_id) == ('7', 'camera')
    assert (detection.bbox.center.position.x, detection.bbox.center.theta) == (10.25, 0.5)
    assert (detection.bbox.size_x, detection.bbox.size_y) == (0.0, 3.0)
    [result] = detection.results
    assert (result.hypothesis.class_id, result.hypothesis.score) == ('face', 0.75)
    assert result.pose.pose.position.x == -1.5
