"""Playing a bag over real DDS to another process."""

import json
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs rclpy')
pytest.importorskip('rosbags', reason='needs rosbags')
from rclpy.publisher import Publisher  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from rosbags.interfaces import (  # noqa: E402
    Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime)
from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: E402
from sensor_msgs.msg import Image  # noqa: E402
from shared_segments import kill  # noqa: E402
from std_msgs.msg import Header  # noqa: E402
from vtrack_play import finish, Listener, PATIENCE, play  # noqa: E402

from vtrack_ros.bags import BagReader, messages  # noqa: E402
from vtrack_ros.bags.player import Pace, Player  # noqa: E402
from vtrack_ros.cli.command_line import main  # noqa: E402
from vtrack_ros.dds import VARIABLES  # noqa: E402
from vtrack_ros.messages.images import stamp_nanoseconds, to_frame  # noqa: E402


def latched_bag(path, topic='/latched'):
    """Write a bag of a latched (transient local) header, and then two images 3 s apart."""
    latched, volatile = (
        Qos(QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, durability, QosTime(0, 0),
            QosTime(0, 0), QosLiveliness.AUTOMATIC, QosTime(0, 0), False)
        for durability in (QosDurability.TRANSIENT_LOCAL, QosDurability.VOLATILE))
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name, message, profile, stamps in (
                (topic, messages.header(1, 'latched'), latched, [10 ** 9]),
                ('/image', messages.image(np.zeros((4, 4), np.uint8), 10 ** 9, 'eye'), volatile,
                 [10 ** 9 + 1, 4 * 10 ** 9])):
            kind = message.__msgtype__
            connection = writer.add_connection(
                name, kind, typestore=messages.typestore(), offered_qos_profiles=[profile])
            data = messages.typestore().serialize_cdr(message, kind)
            for stamp in stamps:
                writer.write(connection, stamp, data)
    return path


@pytest.mark.parametrize('bag, topic', [('face_fast', 'camera'), ('full_occlusion', 'image')])
def test_every_image_arrives(repository, bag, topic):
    """All images come, in order, with their stamps and pixels, at about the recorded pace."""
    path = repository / 'bags' / bag
    with BagReader(path) as reader:
        expected = list(reader.frames())
    with Listener() as listener:
        heard = listener.hear(Image, topic)
        player = play(path, '--topic', 'image', '--remap', f'image:={topic}', '--rate', 2,
                      '--wait', PATIENCE, '--json')
        listener.spin_until(lambda: len(heard) == len(expected) or player.poll() is not None,
                            'not all images came')
        listener.spin_until(lambda: len(heard) == len(expected), 'images are missing')
        code, out, _ = finish(player)
    assert code == 0
    counts = json.loads(out)
    assert counts['images'] == len(expected) == counts['messages'][f'/{topic}']
    for (_, message), image in zip(heard, expected):
        assert stamp_nanoseconds(message.header.stamp) == image.stamp
        assert message.header.frame_id == image.frame_id
        assert (to_frame(message) == image.frame).all()
    # Never sooner than recorded; how much later is the machine's business.
    assert counts['seconds'] >= (expected[-1].received - expected[0].received) / 2e9


def test_a_reliable_subscriber_that_is_held_up_misses_nothing(repository, tmp_path, monkeypatch):
    """Messages that it hasn't received yet aren't replaced by later ones."""
    code = """
import rclpy
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image

def hear(message):
    print('one', flush=True)
    heard.append(message)

rclpy.init()
node, heard = rclpy.create_node('held_up'), []
node.create_subscription(Image, 'image', hear, QoSProfile(depth=1000))
while len(heard) < 50:
    rclpy.spin_once(node)
"""
    # Fast DDS with its default profile, whose shared memory holds a few of these images.
    profile = tmp_path / 'none.xml'
    profile.write_text('<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"/>')
    for name in VARIABLES:
        monkeypatch.setenv(name, str(profile))
    listener = subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True)
    try:
        player = play(repository / 'bags' / 'face_fast', '--topic', 'image', '--rate', 4,
                      '--wait', PATIENCE)
        for _ in range(5):
            listener.stdout.readline()
        listener.send_signal(signal.SIGSTOP)
        # As on a busy machine, for as long as the rest of the bag takes.
        time.sleep(0.6)
        listener.send_signal(signal.SIGCONT)
        assert finish(player)[0] == 0
        # It ends when it has heard all of them.
        assert listener.wait(PATIENCE) == 0
    finally:
        kill(listener)


LATE = """
import rclpy
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image

rclpy.init()
node = rclpy.create_node('late')
node.create_subscription(Image, 'image', lambda message: print(
    message.header.stamp.sec * 10 ** 9 + message.header.stamp.nanosec, flush=True),
    QoSProfile(depth=1))
rclpy.spin(node)
"""


def test_the_first_image_is_waited_for(repository):
    """A subscriber with a queue of 1 misses no image, however late it's ready for the first."""
    listener = subprocess.Popen([sys.executable, '-c', LATE], stdout=subprocess.PIPE, text=True)
    heard = []

    def listen(player):
        for line in listener.stdout:
            heard.append(int(line))
            if len(heard) == 3:
                player.stop.make()

    try:
        with Listener() as own, BagReader(repository / 'bags' / 'face_fast') as bag:
            with Player(own.node, bag, ['image'], pace=Pace(rate=0.05)) as player:
                assert player.wait_for_subscribers(PATIENCE)
                threading.Thread(target=listen, args=(player,), daemon=True).start()
                # Once discovered, it's stopped before the first image, for more than an interval.
                listener.send_signal(signal.SIGSTOP)
                threading.Timer(1.2, listener.send_signal, (signal.SIGCONT,)).start()
                player.play(patience=PATIENCE)
            assert heard[:3] == [image.stamp for image in bag.frames()][:3]
    finally:
        kill(listener)


def test_a_subscriber_that_never_receives_the_first_image_is_named(repository, capfd):
    """A subscriber that hangs delays the player by the given 0.3 s, and a warning says so."""
    hanging = subprocess.Popen([sys.executable, '-c', LATE], stdout=subprocess.DEVNULL)
    try:
        with Listener() as own, BagReader(repository / 'bags' / 'face_fast') as bag:
            with Player(own.node, bag, ['image'], pace=Pace(rate=10.0)) as player:
                assert player.wait_for_subscribers(PATIENCE)
                hanging.send_signal(signal.SIGSTOP)
                played = player.play(patience=0.3)
        assert played.images == 50
        said = capfd.readouterr().err
        assert '/image' in said and 'not received the first image within 0.3 s' in said
    finally:
        kill(hanging)


def test_a_player_that_was_held_up_keeps_the_pace(repository):
    """Overdue images aren't sent in a burst: a subscriber with a queue of 1 would miss some."""
    with Listener() as listener:
        heard = listener.hear(Image, 'image')
        player = play(repository / 'bags' / 'face_fast', '--topic', 'image', '--wait', PATIENCE,
                      '--json')
        listener.spin_until(lambda: len(heard) >= 5, 'no images')
        player.send_signal(signal.SIGSTOP)
        time.sleep(1.0)
        player.send_signal(signal.SIGCONT)
        listener.spin_until(lambda: len(heard) == 50, 'images are missing')
        code, out, _ = finish(player)
    assert code == 0
    assert json.loads(out)['seconds'] > 1.96 + 0.9


def test_a_publication_that_takes_long_is_followed_by_a_whole_interval(repository, monkeypatch):
    """Fast DDS may take 1/3 s; sent at once, the next image would replace it in a queue of 1."""
    began, ended, publish = [], [], Publisher.publish

    def slow(publisher, message):
        if isinstance(message, bytes):
            began.append(time.monotonic())
            time.sleep(0.3 if len(began) == 6 else 0.0)
            publish(publisher, message)
            ended.append(time.monotonic())
        else:
            publish(publisher, message)
    monkeypatch.setattr(Publisher, 'publish', slow)
    with Listener() as own, BagReader(repository / 'bags' / 'face_fast') as bag:
        due = [message.received / 1e9 for message in bag.raw({'/image'})]
        with Player(own.node, bag, ['image']) as player:
            assert player.play().images == len(due)
    # a lower bound: a busy machine only makes the wait longer
    assert began[6] - ended[5] > 0.99 * (due[6] - due[5])


def test_signal_ends_it(repository):
    """Ctrl-C while playing: exit code 130, a summary line, no traceback."""
    player = play(repository / 'bags' / 'full_occlusion', '--rate', 0.01, '--wait', 0)
    for line in player.stdout:
        if line.startswith(str(repository)):
            break
    code, out, _ = finish(player, signal.SIGINT)
    assert code == 130
    assert out.startswith('published')


#: `vtrack`, with another signal injected at each call and return within a signal handler.
NESTED_SIGNALS = """
import signal, sys
from vtrack_ros.cli.command_line import main

install = signal.signal

def nested(number, handler):
    def handle(number, frame):
        def again(*_):
            sys.setprofile(None)
            handler(signal.SIGTERM, frame)
            sys.setprofile(again)
        sys.setprofile(again)
        handler(number, frame)
        sys.setprofile(None)
    return install(number, handle if callable(handler) else handler)

signal.signal = nested
sys.exit(main(sys.argv[1:]))
"""


def test_signals_that_interrupt_each_other_end_it(repository):
    """A player that gets two signals at once, as from Ctrl-C and from its parent, ends with 0."""
    player = play(repository / 'bags' / 'full_occlusion', '--loop', '--rate', 0.01, '--wait', 0,
                  command=('-c', NESTED_SIGNALS))
    for line in player.stdout:
        if line.startswith(str(repository)):
            break
    code, out, _ = finish(player, signal.SIGINT)
    assert code == 0
    assert out.startswith('published')


def play_here(capfd, *arguments):
    """Play in this process; return exit code, output and errors, ROS's too."""
    code = main(['play', *map(str, arguments)])
    return code, *capfd.readouterr()


def test_nobody_listens(repository, capfd):
    """Without subscribers a note is printed, and the bag is played anyway."""
    code, out, _ = play_here(capfd, repository / 'bags' / 'face_fast', '--rate', 20, '--wait', 0.1,
                             '--remap', 'image:=nobody/hears/this')
    assert code == 0
    assert 'no node has subscribed' in out
    assert 'published 50 images' in out.splitlines()[-1]


def test_late_subscribers_get_what_was_latched(tmp_path):
    """Transient local messages reach a subscriber that asks for that durability, also late."""
    path = latched_bag(tmp_path / 'bag')
    with Listener() as listener:
        # Playing starts once the image has a subscriber; the second image comes 30 s later.
        player = play(path, '--qos', 'auto', '--wait', PATIENCE, '--rate', 0.1)
        images = listener.hear(Image, 'image')
        listener.spin_until(lambda: images or player.poll() is not None, 'no image')
        qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        latched = listener.hear(Header, 'latched', qos=qos)
        listener.spin_until(lambda: latched or player.poll() is not None, 'nothing latched came')
        [offered] = listener.node.get_publishers_info_by_topic('/image')
        code, _, _ = finish(player, signal.SIGINT)
    assert code == 130
    assert [message.frame_id for _, message in latched] == ['latched']
    assert offered.qos_profile.durability == DurabilityPolicy.VOLATILE


def test_exchanged_names(repository, capfd):
    """Two topics can exchange their names, and ROS doesn't warn."""
    code, out, err = play_here(capfd, repository / 'bags' / 'face_fast', '--rate', 20, '--wait', 0,
                               '--remap', 'image:=truth', 'truth:=image')
    assert code == 0 and err == ''
    assert '/truth: 50 sensor_msgs/msg/Image' in out
    assert '/image: 50 vision_msgs/msg/Detection2DArray' in out


def test_recorded_name_that_ros_refuses(tmp_path, capfd):
    """An invalid recorded name is reported in one line, and --remap renames it."""
    path = latched_bag(tmp_path / 'bag', '/bad topic')
    code, _, err = play_here(capfd, path, '--wait', 0)
    assert code == 2
    assert len(err.splitlines()) == 1 and "'/bad topic'" in err and '--remap' in err
    code, out, err = play_here(capfd, path, '--wait', 0, '--rate', 100,
                               '--remap', '/bad topic:=good')
    assert code == 0 and err == '' and '1 on /good' in out


@pytest.mark.parametrize('arguments, words', [
    (['--topic', 'nothing'], '/image, /truth'), (['--rate', '0'], 'a positive number'),
    (['--remap', 'a=b'], 'FROM:=TO'), (['--remap', 'imgae:=camera'], '/image, /truth'),
    (['--remap', 'image:=bad topic'], "'/bad topic'"), (['--remap', 'image:=1'], "'/1'"),
    (['--remap', 'image:=truth'], '/truth')])
def test_wrong_arguments(repository, arguments, words, capfd):
    """Wrong arguments are reported in one line, with exit code 2."""
    code, out, err = play_here(capfd, repository / 'bags' / 'face_fast', *arguments)
    assert code == 2
    assert len(err.splitlines()) == 1 and words in err
