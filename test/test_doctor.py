"""`vtrack doctor`: what it reports of real publishers, and without ROS."""

import os
import subprocess
import sys
import threading

from node_harness import Client, END_WITH_PARENT, image_message, Scene
import pytest
from rclpy.qos import qos_profile_sensor_data, QoSProfile
from sensor_msgs.msg import CompressedImage, Image
from shared_segments import kill, segments
from vtrack_ros.cli import installation
from vtrack_ros.cli.command_line import main
from vtrack_ros.dds import abandoned_memory, profile_path, SHARED_MEMORY, VARIABLES, with_profile

#: A camera that sends images in colour, best effort, 30 a second, until it is ended. They're
#: large: all VGA images may arrive, if they're read as fast as a socket's buffer fills.
CAMERA = END_WITH_PARENT + """
import time
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image
rclpy.init()
node = rclpy.create_node('camera')
publisher = node.create_publisher(Image, 'camera/image_raw', qos_profile_sensor_data)
message = Image(height=1280, width=1920, encoding='bgr8', step=5760, data=bytes(7372800))
while True:
    publisher.publish(message)
    time.sleep(1 / 30)
"""

#: A node that does nothing until it is ended.
IDLE = """
import rclpy
rclpy.init()
node = rclpy.create_node('idle')
print('ready', flush=True)
input()
"""


def lines(capsys, *arguments):
    """Return the exit code of `vtrack doctor`, and its lines."""
    code = main(['doctor', *arguments])
    return code, capsys.readouterr().out.splitlines()


def starting(found, text):
    """Return the only line that starts with a text."""
    [line] = [line for line in found if line.startswith(text)]
    return line


def test_without_ros(monkeypatch, capsys):
    """It lists what is installed, what is missing, and how to install it."""
    for name in ('rclpy', 'aiohttp', 'rosbags', 'tqdm', 'threadpoolctl'):
        monkeypatch.setitem(sys.modules, name, None)
    code, found = lines(capsys)
    assert code == 0
    assert 'Python' in starting(found, 'ok    vtrack_ros')
    assert 'gmpf' in starting(found, 'ok    trackers')
    assert 'no vtrack select' in starting(found, 'note  aiohttp')
    line = starting(found, 'note  rosbags')
    assert 'apt' not in found[found.index(line) + 1]
    # one that isn't only for progress bars, and one that can be done without
    assert 'evaluate' in line and 'replay' in starting(found, 'note  tqdm')
    assert 'evaluate' not in starting(found, 'note  threadpoolctl')
    assert 'needs rclpy' in starting(found, 'note  no ROS') and 'scripts/setup' in found[-1]


@pytest.mark.parametrize('value, words', [
    ('', 'note  no Fast DDS profile is set'), ('/nowhere.xml', 'wrong the Fast DDS profile /now'),
    (str(profile_path()), 'ok    the Fast DDS profile is'),
    (__file__, f'note  the Fast DDS profile is {__file__}, not')])
def test_profile(monkeypatch, capsys, value, words):
    """It reports whether the environment's profile is unset, missing, ours or another."""
    for name in VARIABLES:
        monkeypatch.setenv(name, value)
    code, found = lines(capsys, '--seconds', '0')
    assert code == int(words.startswith('wrong'))
    assert starting(found, words)
    assert starting(found, 'note  no node publishes images')


def test_transports_that_are_chosen():
    """Where the transports are chosen by Fast DDS's own variable, no profile is advised."""
    found = installation.profile({'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'})
    assert 'FASTDDS_BUILTIN_TRANSPORTS=UDPv4' in found.text and not found.advice


def test_memory_of_killed_processes(tmp_path, monkeypatch, capsys):
    """The 64 MiB segment of a killed process is reported; that of a running process isn't."""
    camera = subprocess.Popen(
        [sys.executable, '-c', END_WITH_PARENT + IDLE],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=with_profile(os.environ))
    assert camera.stdout.readline()
    for segment in segments([camera.pid]):
        for path in (segment, segment.with_name(f'{segment.name}_el')):
            (tmp_path / path.name).symlink_to(path)
    monkeypatch.setattr(installation, 'SHARED_MEMORY', tmp_path)
    try:
        assert abandoned_memory(tmp_path) == 0
        assert 'killed' not in installation.shared_memory().text
        camera.kill()
        camera.wait()
        assert 64 * 2**20 <= abandoned_memory(tmp_path) < 70 * 2**20
        _, found = lines(capsys, '--seconds', '0')
        text = next(line for line in found if 'of shared memory are free' in line)
        assert 'MiB are still held for processes that were killed' in text
        assert any('fastdds shm clean' in line for line in found)
    finally:
        camera.kill()
        for path in tmp_path.iterdir():
            (SHARED_MEMORY / path.name).unlink()


def test_middleware_that_is_not_there(monkeypatch, capsys):
    """It's named, with a remedy, where ROS alone would end the process."""
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_nothing_cpp')
    code, found = lines(capsys)
    assert code == 1 and starting(found, 'wrong RMW_IMPLEMENTATION is set to rmw_nothing_cpp')
    assert 'ros-jazzy-rmw-nothing-cpp' in found[-1] and 'unset RMW_IMPLEMENTATION' in found[-1]


def test_topics(capsys):
    """An arriving image, a reliable subscriber without any, and a silent topic are reported."""
    frame = image_message(Scene().frame(0), 10**9)
    done = threading.Event()
    with Client('/camera/driver', reliability='BEST_EFFORT', topic='image_raw') as client:
        client.node.create_subscription(Image, '/camera/image_raw', print, QoSProfile(depth=1))
        for topic in ('/silent', '/tracker/debug_image'):
            client.node.create_publisher(Image, topic, qos_profile_sensor_data)
        still = client.node.create_publisher(Image, '/still', 1)

        def send():
            taken = False
            while not done.wait(0.02):
                client.images.publish(frame)
                if not taken and still.get_subscription_count():
                    still.publish(frame)
                    taken = True
        thread = threading.Thread(target=send)
        thread.start()
        try:
            code, found = lines(capsys, '--seconds', '0.6')
        finally:
            done.set()
            thread.join()
    assert code == 1
    line = starting(found, 'ok    /camera/image_raw: best effort, from /client to /client; 160 x')
    assert line.endswith('lost')
    mismatch = starting(found, 'wrong /camera/image_raw')
    assert mismatch.endswith(
        '/client receives nothing from /client: Best effort publisher and reliable subscription')
    assert 'no image was received in 0.6 s' in starting(found, 'wrong /silent')
    # one image has no rate
    assert starting(found, 'ok    /still').endswith('bgr8, one image, none of 1 lost')
    # A tracker's debug image, for viewers, is no camera.
    assert not any('debug_image' in line for line in found)


def test_a_topic_that_nobody_publishes(capsys):
    """A node that waits for images is named, with its topic and those that are published."""
    with Client('/camera/driver', topic='image_raw') as client:
        for topic in ('/camera/image', '/tracker/debug_image'):
            client.node.create_subscription(Image, topic, print, 1)
        client.node.create_subscription(CompressedImage, '/image/compressed', print, 1)
        code, found = lines(capsys, '--seconds', '0')
    assert code == 1
    assert starting(found, 'ok    /camera/image_raw').endswith('to no node; not listened to')
    line = starting(found, 'wrong /camera/image: no node publishes it, but /client waits for')
    assert found[found.index(line) + 1].endswith('one that is published: /camera/image_raw')
    line = starting(found, 'wrong /image/compressed: no node publishes it')
    assert 'no topic of its type is published' in found[found.index(line) + 1]
    # A viewer may wait for a tracker's debug image.
    assert not any('debug_image' in line for line in found)


@pytest.mark.parametrize('two_kinds', [False, True])
def test_images_of_another_type_than_awaited(capsys, two_kinds):
    """A node that waits for raw images on a topic of compressed ones is named."""
    with (Client('/camera/driver', publish=CompressedImage, topic='image') as camera,
          Client(publish=Image if two_kinds else None, topic='camera/image') as client):
        client.node.create_subscription(Image, '/camera/image', print, 1)
        camera.until(lambda: camera.node.count_subscribers('/camera/image'), 'nobody waits')
        code, found = lines(capsys, '--seconds', '0')
    assert code == 1
    assert starting(found, 'ok    /camera/image').endswith('not listened to')
    assert '/client receives nothing from /client: it publishes sensor_msgs/msg/CompressedImage, '\
        'not sensor_msgs/msg/Image' in starting(found, 'wrong /camera/image')


def test_lost_images(capsys):
    """Without the profile large images are lost, on a busy machine all; the remedy is given."""
    environment = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    camera = subprocess.Popen([sys.executable, '-c', CAMERA], env=environment)
    try:
        with Client(publish=None) as client:
            client.until(lambda: client.node.count_publishers('/camera/image_raw'), 'no camera')
            code, found = lines(capsys, '--seconds', '1')
    finally:
        kill(camera)
    assert code == 1
    line = starting(found, 'wrong /camera/image_raw')
    assert 'lost in transit' in line or 'no image was received' in line
    assert 'fastdds.xml' in found[found.index(line) + 1]
