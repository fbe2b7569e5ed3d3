"""Playing: a bag that takes no time, and what can't be played."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs rclpy')
pytest.importorskip('rosbags', reason='needs rosbags')
from vtrack_ros.bags import BagReader, BagWriter, messages  # noqa: E402
from vtrack_ros.bags.player import Pace, Player  # noqa: E402
from vtrack_ros.bags.topics import Topic  # noqa: E402
from vtrack_ros.signals import StopRequest  # noqa: E402


class Publisher:
    """A mock publisher that makes a request to stop after a number of messages."""

    def __init__(self, stop, count):
        self.stop, self.left = stop, count

    def publish(self, _):
        """Count a message."""
        self.left -= 1
        if not self.left:
            self.stop.make()

    def wait_for_all_acked(self, _):
        """Return that all were received."""
        return True


class Node:
    """A mock node with one publisher."""

    def __init__(self, publisher):
        self.publisher = publisher

    def create_publisher(self, *_):
        """Return the publisher."""
        return self.publisher

    def destroy_publisher(self, _):
        """Do nothing."""


def test_a_single_image_is_repeated_at_the_rate_of_a_video(tmp_path):
    """It isn't published as fast as the processor can, which would flood every subscriber."""
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_frame(np.zeros((8, 8, 3), np.uint8), 10**9)
    stop = StopRequest()
    node = Node(Publisher(stop, 6))
    began = time.monotonic()
    with BagReader(tmp_path / 'bag') as bag, (
            Player(node, bag, stop=stop, pace=Pace(loop=True))) as player:
        played = player.play()
    assert played.images == 6 and 0.15 < time.monotonic() - began < 5


@pytest.mark.parametrize('kind, words', [
    ('std_srvs/srv/Empty_Event', 'not a message'), ('std_msgs/String', 'not a message'),
    ('__schemaless__', 'not a message'), ('std_msgs/msg/Nothing', 'not a message'),
    ('nothing_msgs/msg/Nothing', 'the package nothing_msgs, which is not installed')])
def test_what_is_no_message_is_left_out(kind, words):
    """A service's events, or what other programs write into an MCAP file, don't end the player."""
    topics = [Topic(name, of, 1, True, False)
              for name, of in (('/image', messages.IMAGE), ('/other', kind))]
    bag = SimpleNamespace(path='bag', topics={topic.name: topic for topic in topics})
    player = Player(Node(Publisher(StopRequest(), 1)), bag)
    assert player.topics == topics[:1]
    [reason] = player.skipped
    assert reason.startswith(f'/other: {kind} ') and words in reason
