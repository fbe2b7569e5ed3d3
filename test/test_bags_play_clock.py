"""Playing with a clock: the bag's time is published."""

import signal

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs rclpy')
pytest.importorskip('rosbags', reason='needs rosbags')
from rclpy.qos import ReliabilityPolicy  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import Image  # noqa: E402
from vtrack_play import finish, Listener, PATIENCE, play  # noqa: E402

from vtrack_ros.bags import BagReader, BagWriter, messages  # noqa: E402
from vtrack_ros.cli.command_line import main  # noqa: E402
from vtrack_ros.messages.images import stamp_nanoseconds  # noqa: E402


def test_clock_loop_and_best_effort(repository):
    """The bag's time is published on /clock; a loop runs until it's stopped, with exit code 0."""
    with Listener() as listener:
        ticks = listener.hear(Clock, '/clock', ReliabilityPolicy.BEST_EFFORT)
        heard = listener.hear(Image, 'image', ReliabilityPolicy.BEST_EFFORT)
        player = play(repository / 'bags' / 'face_fast', '--loop', '--clock', 150, '--rate', 4,
                      '--qos', 'best_effort', '--wait', PATIENCE)
        listener.spin_until(lambda: len(heard) > 120 or player.poll() is not None, 'no loop')
        code, out, _ = finish(player, signal.SIGINT)
    assert code == 0
    assert 'images in' in out.splitlines()[-1]
    stamps = [stamp_nanoseconds(message.header.stamp) for _, message in heard]
    assert any(later < earlier for earlier, later in zip(stamps, stamps[1:]))
    times = [stamp_nanoseconds(message.clock) for _, message in ticks]
    assert min(times) >= min(stamps) and max(times) <= max(stamps)
    # Before each image; and 150 times a second, at four times the speed every 26.7 ms.
    assert set(times) > set(stamps)
    assert min(set(times) - set(stamps)) - min(stamps) == 26_666_667


def test_time_stands_at_the_beginning_until_there_is_a_subscriber(repository):
    """A program may wait until there is a time before it subscribes to the images."""
    path = repository / 'bags' / 'face_fast'
    with BagReader(path) as bag:
        beginning = next(bag.raw({'/image'})).received
    with Listener() as listener:
        ticks = listener.hear(Clock, '/clock', ReliabilityPolicy.BEST_EFFORT)
        player = play(path, '--clock', '--topic', 'image', '--wait', PATIENCE)
        listener.spin_until(lambda: len(ticks) > 2 or player.poll() is not None, 'no time')
        images = listener.hear(Image, 'image')
        listener.spin_until(lambda: len(images) == 50 or player.poll() is not None, 'no images')
        assert finish(player)[0] == 0
    assert len(images) == 50
    times = [stamp_nanoseconds(message.clock) for _, message in ticks]
    assert times[:3] == [beginning] * 3 and times == sorted(times) and times[-1] > beginning


def test_two_clocks(tmp_path, capfd):
    """A simulation's bag has a /clock: with --clock, time would jump to and fro."""
    types = messages.typestore().types
    now = types['builtin_interfaces/msg/Time'](12, 0)
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write_frame(np.zeros((8, 8, 3), np.uint8), 10**9)
        bag.write('/clock', types['rosgraph_msgs/msg/Clock'](now), 10**9)
    playing = ['play', str(tmp_path / 'bag'), '--wait', '0']
    assert main([*playing, '--clock']) == 2
    [line] = capfd.readouterr().err.splitlines()
    assert 'has a /clock of its own' in line
    assert main([*playing, '--clock', '--remap', 'clock:=simulated']) == 0
    assert main([*playing, '--clock', '--topic', 'image']) == 0
    assert main(playing) == 0
