"""The target's motion over DDS: the twist, and a pose that is predicted to the present."""

import subprocess
import sys

from diagnostic_msgs.msg import DiagnosticArray
from drawn_card import DrawnCard
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from node_harness import Client, NodeProcess, Scene, STEP
import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo

from vtrack_ros.bags import BagReader

SCENE = Scene()
BOX = '[' + ', '.join(str(value) for value in SCENE.box(0).as_array()) + ']'
#: Speed of the scene's square to the right, [px/s]: two pixels per frame.
SPEED = 2e9 / STEP
FRAMES = 13
PLACE = ('pose', 'pose_with_covariance', 'twist')


@pytest.fixture(scope='module')
def process():
    """Return the process of a node that starts on the scene's first box."""
    with NodeProcess(init_box=BOX, use_sim_time='true') as process:
        yield process


@pytest.fixture(scope='module')
def client(process):
    """Return a client that subscribes to poses, twists and diagnostics."""
    with Client() as client:
        client.hear('/diagnostics', DiagnosticArray)
        client.hear('pose_with_covariance', PoseWithCovarianceStamped)
        client.hear('twist', TwistWithCovarianceStamped)
        client.ready()
        yield client


@pytest.fixture(autouse=True)
def _fresh(client):
    """Begin a new stream: its stamps are before the last one's."""
    client.begin_stream(*PLACE)


def play(client, visible=lambda index: True):
    """Send the scene; return non-empty detections, poses, poses with covariance, and twists."""
    answers = [client.send(SCENE.frame(i, visible(i)), client.start + STEP * i)
               for i in range(FRAMES)]
    heard = [client.heard[topic] for topic in PLACE]
    count = sum(bool(answer.detections) for answer in answers)
    client.until(lambda: all(len(one) == count for one in heard), 'no pose, or no twist')
    return [answer for answer in answers if answer.detections], *heard


def stamp(message):
    """Return a message's stamp in nanoseconds."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_twist_comes_with_every_pose(client):
    """Twists are in px/s, with the image's header, and only sent while the target is measured."""
    answers, poses, exact, twists = play(client, lambda index: not 8 <= index < 11)
    assert 8 <= len(answers) < FRAMES
    for answer, pose, sure, twist in zip(answers, poses, exact, twists):
        assert answer.header == pose.header == sure.header == twist.header
        covariance = np.reshape(twist.twist.covariance, (6, 6))
        assert (covariance[:2, :2].diagonal() > 0).all()
        assert not covariance[2].any() and (covariance[3:, 3:].diagonal() >= 1e6).all()
        linear, angular = twist.twist.twist.linear, twist.twist.twist.angular
        assert linear.z == angular.x == angular.y == angular.z == 0
    assert (twists[0].twist.twist.linear.x, twists[0].twist.twist.linear.y) == (0, 0)
    known = twists[7].twist
    assert known.twist.linear.x == pytest.approx(SPEED, rel=0.3)
    assert 0 < known.covariance[0] < twists[0].twist.covariance[0] / 4


def test_pose_is_ahead_of_its_image(client, process):
    """
    With predict_to_now the pose has the clock's time, and is moved by velocity times age.

    Before the clock has a time, and for images older than half a second, it isn't predicted,
    which is logged. The clock is simulated, and stands still.
    """
    assert client.get('predict_to_now') == [False]
    assert client.change(predict_to_now=True)[0].successful
    answers, poses, _, twists = play(client)
    assert all(answer.header == pose.header == twist.header
               for answer, pose, twist in zip(answers, poses, twists))
    process.wait_for_log('/clock has had no time yet')

    client.begin_stream()
    now = client.start + FRAMES * STEP + 120_000_000
    clock = client.publisher('/clock', Clock)
    message = Clock()
    message.clock.sec, message.clock.nanosec = divmod(now, 10**9)

    def told():
        clock.publish(message)
        return any(stamp(one) == now for one in client.heard['/diagnostics'])
    client.until(told, 'no time')
    for topic in PLACE:
        del client.heard[topic][:]
    answers, poses, exact, twists = play(client)
    assert [stamp(answer) for answer in answers] == [
        client.start + STEP * i for i in range(FRAMES)]
    for answer, pose, sure, twist in zip(answers, poses, exact, twists):
        age = (now - stamp(answer)) / 1e9
        assert pose.header == sure.header == twist.header
        assert stamp(pose) == (now if age <= 0.5 else stamp(answer))
        assert pose.header.frame_id == 'camera_optical'
    assert [stamp(pose) == now for pose in poses].count(False) == 2
    age = (now - stamp(answers[-1])) / 1e9
    center = answers[-1].detections[0].bbox.center.position
    speed = twists[-1].twist.twist.linear
    way = poses[-1].pose.position.x - center.x, poses[-1].pose.position.y - center.y
    assert speed.x == pytest.approx(SPEED, rel=0.3)
    assert way == pytest.approx((age * speed.x, age * speed.y), rel=0.3, abs=0.5)
    own = answers[-1].detections[0].results[0].pose.covariance
    assert exact[-1].pose.covariance[0] > own[0] and exact[-1].pose.covariance[7] > own[7]

    client.begin_stream(*PLACE)
    assert client.change(predict_to_now=False)[0].successful
    answers, poses, *_ = play(client)
    for answer, pose in zip(answers, poses):
        center = answer.detections[0].bbox.center.position
        assert answer.header == pose.header
        assert (pose.pose.position.x, pose.pose.position.y) == (center.x, center.y)


def test_a_clock_that_is_a_little_behind_is_nothing_to_warn_of():
    """
    A pose isn't predicted for an image stamped after the node's time.

    /clock is another topic than the image, so a bag's image may come before its own time.
    """
    with NodeProcess('-r', '__ns:=/behind', init_box=BOX, use_sim_time='true',
                     predict_to_now='true') as process, Client('/behind/tracker') as client:
        client.hear('/diagnostics', DiagnosticArray)
        client.ready()
        clock, message = client.publisher('/clock', Clock), Clock()
        message.clock.sec, message.clock.nanosec = divmod(client.start, 10**9)

        def told():
            clock.publish(message)
            return any(stamp(one) == client.start for one in client.heard['/diagnostics'])
        client.until(told, 'no time')
        behind = [20_000_000, 40_000_000]
        for index, time in enumerate(behind):
            client.send(SCENE.frame(index), client.start + time)
        poses = client.heard['pose']
        client.until(lambda: len(poses) == 2, 'no pose')
        assert [stamp(pose) - client.start for pose in poses] == behind
        assert 'predict_to_now' not in process.log
        client.send(SCENE.frame(2), client.start + 200_000_000)
        process.wait_for_log('the image is stamped 0.200 s after the node')


def test_a_bag_sets_the_clock_before_each_image(repository):
    """
    While a bag is played with its clock, no image comes before its time.

    The first may come before there is any: /clock, as best effort, isn't resent.
    """
    path = repository / 'bags' / 'face_fast'
    with BagReader(path) as bag:
        truth = bag.truth()
        last = max(truth)
    box = truth[min(truth)].as_array().tolist()
    with NodeProcess('-r', '__ns:=/bag', init_box=box, use_sim_time='true',
                     predict_to_now='true') as process, (
            Client('/bag/tracker', publish=None)) as client:
        client.ready()
        player = subprocess.run(
            [sys.executable, '-m', 'vtrack_ros.cli.command_line', 'play', str(path), '--clock',
             '--topic', 'image', '--remap', 'image:=/bag/image', '--wait', '20'], check=False)
        assert player.returncode == 0
        heard = client.heard['detections']
        client.until(lambda: heard and stamp(heard[-1]) == last, 'no last image')
        assert client.heard['pose'] and 'after the node' not in process.log


def test_images_without_stamps_give_no_velocity():
    """Their pose comes without a twist; there is one with the first image that has a stamp."""
    with NodeProcess('-r', '__ns:=/unstamped', init_box=BOX), (
            Client('/unstamped/tracker')) as client:
        twists = client.hear('twist', TwistWithCovarianceStamped)
        client.ready()
        for index in range(6):
            client.send(SCENE.frame(index), STEP if index == 5 else 0)
        client.until(lambda: twists and len(client.heard['pose']) == 6, 'no twist, or no pose')
        assert [stamp(twist) for twist in twists] == [STEP]


def test_a_pose_without_a_velocity_is_not_predicted(client):
    """With predict_to_now, of two images with one stamp the second has that as its pose's, too."""
    assert client.change(predict_to_now=True)[0].successful
    clock, message = client.publisher('/clock', Clock), Clock()
    now = client.start + STEP
    message.clock.sec, message.clock.nanosec = divmod(now, 10**9)

    def told():
        clock.publish(message)
        return any(stamp(one) == now for one in client.heard['/diagnostics'])
    client.until(told, 'no time')
    for _ in range(2):
        client.send(SCENE.frame(0), client.start)
    client.until(lambda: len(client.heard['pose']) == 2, 'no pose')
    assert [stamp(pose) for pose in client.heard['pose']] == [now, client.start]
    assert client.change(predict_to_now=False)[0].successful


def test_metres_per_second(client):
    """With calibration and width twists are in m/s: 0.24 m are 24 px at fx = 200 px and 2 m."""
    message = CameraInfo(width=SCENE.width, height=SCENE.height, distortion_model='plumb_bob')
    message.k = [200.0, 0.0, 79.5, 0.0, 200.0, 59.5, 0.0, 0.0, 1.0]
    assert client.change(target_width=0.24)[0].successful
    publisher = client.publisher('camera_info', CameraInfo)

    def in_metres():
        publisher.publish(message)
        client.begin_stream()
        answer = client.send(SCENE.frame(0), client.start)
        client.until(lambda: all(
            client.heard[topic] and client.heard[topic][-1].header == answer.header
            for topic in PLACE),
            'no pose, or no twist')
        return client.state_after(answer)['pose_units'] == 'metres'
    client.until(in_metres, 'no metres')
    client.begin_stream(*PLACE)
    _, poses, _, twists = play(client)
    depth = poses[-1].pose.position.z
    assert depth == pytest.approx(2.0, rel=0.15)
    twist = twists[-1].twist
    assert twist.twist.linear.x == pytest.approx(SPEED * depth / 200, rel=0.4)
    assert abs(twist.twist.linear.z) < 3 * twist.covariance[14]**0.5
    assert twist.covariance[14] > 0


def test_a_turned_target_is_as_far_away_as_before(client):
    """Its depth is computed from its own width, not its bound's; and the pose rotates with it."""
    drawn, center, angle = DrawnCard(), (150.0, 120.0), 1.2
    message = CameraInfo(width=320, height=240, distortion_model='plumb_bob')
    message.k = [200.0, 0.0, 159.5, 0.0, 200.0, 119.5, 0.0, 0.0, 1.0]
    box = drawn.box(center).as_array().tolist()
    assert all(one.successful for one in client.change(init_box=box, target_width=0.6))
    publisher = client.publisher('camera_info', CameraInfo)

    def in_metres():
        publisher.publish(message)
        client.begin_stream()
        answer = client.send(drawn.frame(center), client.start)
        return client.state_after(answer)['pose_units'] == 'metres'
    client.until(in_metres, 'no metres')
    for index in range(1, 31):
        answer = client.send(
            drawn.frame(center, angle * index / 30, seed=index), client.start + STEP * index)
    heard = client.heard['pose']
    client.until(lambda: heard and heard[-1].header == answer.header, 'no pose')
    place, turn = heard[-1].pose.position, heard[-1].pose.orientation
    assert place.z == pytest.approx(200 * 0.6 / 60, rel=0.06)
    assert 2 * np.arctan2(turn.z, turn.w) == pytest.approx(angle, abs=0.15)
