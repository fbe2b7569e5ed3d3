"""The node's reports: state, diagnostics and QoS mismatches; and outputs made on demand."""

import importlib.util
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from node_harness import Client, diagnosis, image_message, NodeProcess, overlap, Scene, STEP
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import SetBool, Trigger

SCENE = Scene()
BOX = '[' + ', '.join(str(value) for value in SCENE.box(0).as_array()) + ']'


@pytest.fixture(scope='module')
def process():
    """Return the process of a node that starts on the scene's first box."""
    with NodeProcess(init_box=BOX) as process:
        yield process


@pytest.fixture(scope='module')
def client(process):
    """Return a client that is listening to the diagnostics as well."""
    with Client() as client:
        client.hear('/diagnostics', DiagnosticArray)
        client.ready()
        yield client


@pytest.fixture(autouse=True)
def _fresh(client):
    """Begin a new stream: its stamps are before the last one's."""
    client.begin_stream()


def send(client, index, visible=True):
    """Send a frame of the scene."""
    return client.send(SCENE.frame(index, visible), client.start + STEP * index)


def test_diagnostics_tell_the_flow(client):
    """/diagnostics has rate, latency, processing time and counts of images, and the state."""
    for index in range(40):
        assert send(client, index).detections
    level, _, values = diagnosis(client, '/tracker: target',
                                 lambda row, values: row.message == 'tracking')
    assert level == b'\x00' and values['tracker'] == 'gmpf' and values['box'] == 'measured'
    for index in range(40, 50):
        assert send(client, index).detections
    _, _, values = diagnosis(client, '/tracker: images',
                             lambda row, values: int(values['frames received']) >= 50)
    assert float(values['frame rate'].split()[0]) > 0
    assert 0 < float(values['processing p50'].split()[0]) <= float(
        values['processing p99'].split()[0])
    assert 0 < float(values['latency p50'].split()[0]) < 10_000
    assert values['frames malformed'] == '0' and values['QoS mismatches'] == 'none'
    assert values['reliability'] == 'reliable'


def test_missing_frames_are_noticed(client):
    """Every other frame is missing: the stamps show it, and the report warns with a cause."""
    for index in range(20):
        send(client, index)
    before = int(client.state_after(send(client, 20))['frames_missing'])
    del client.heard['/diagnostics'][:]
    for index in range(22, 62, 2):
        answer = send(client, index)
    assert int(client.state_after(answer)['frames_missing']) == before + 20
    level, message, _ = diagnosis(client, '/tracker: images',
                                  lambda row, values: 'missing' in row.message)
    reasons = 'lost before', 'faster tracker', 'network is busy'
    assert level == b'\x01' and any(reason in message for reason in reasons)


def test_a_dead_camera_is_no_good_target(client):
    """When no images come the state is stale, with a warning, until the next image."""
    for index in range(3):
        assert send(client, index).detections
    level, message, values = diagnosis(
        client, '/tracker: target', lambda row, values: row.level != b'\x00')
    assert level == b'\x01' and message == 'stale' and values['box'] == 'stale'
    client.until(lambda: client.heard['~/state'][-1].message == 'stale', 'no word of it')
    assert client.heard['~/state'][-1].level == b'\x01'
    # A change of state is published at once, not only with the report of each second.
    assert client.state_after(send(client, 3))['state'] == 'tracking'
    diagnosis(client, '/tracker: target',
              lambda row, values: row.message == 'tracking' and row.level == b'\x00')


def test_one_early_stamp_keeps_the_target(client, process):
    """A frame whose stamp steps back is dropped and counted, and the target stays."""
    for index in range(10):
        assert send(client, index).detections
    since = len(process.log)
    client.send(SCENE.frame(10), client.start + STEP * 9 - 75_000_000, answered=False)
    process.wait_for_log('image dropped: its stamp is before', since)
    for index in range(10, 14):
        answer = send(client, index)
        assert overlap(answer, SCENE.box(index)) > 0.4
    assert int(client.state_after(answer)['frames_late']) == 1


def test_malformed_images_are_told_from_silence(client):
    """If all images are malformed, the diagnostics say so, with the reason."""
    assert send(client, 0).detections
    index = 0

    def told():
        nonlocal index
        index += 1
        broken = image_message(SCENE.frame(index), client.start + STEP * index, 'nonsense')
        client.images.publish(broken)
        client.executor.spin_once(timeout_sec=0.05)
        rows = [row for array in client.heard['/diagnostics'] for row in array.status
                if row.name == '/tracker: images']
        del client.heard['/diagnostics'][:]
        return any("images were malformed: unknown image encoding 'nonsense'" in row.message
                   and row.message.split()[0] == row.message.split()[4] for row in rows)
    client.until(told, 'not a word of malformed images')


def test_lost_and_found(client, process):
    """
    While the target is hidden there is no box and no pose, and the state says so.

    When it's back it's found again, and the log has both changes of state.
    """
    for index in range(15):
        assert overlap(send(client, index), SCENE.box(index)) > 0.4
    since = len(process.log)
    poses = client.heard['pose']
    hidden = [send(client, index, visible=False) for index in range(15, 75)]
    client.until(lambda: client.heard['~/state'][-1].message in ('searching', 'lost'), 'not lost')
    silent = [not answer.detections for answer in hidden]
    assert all(silent[20:])
    stamps = {(pose.header.stamp.sec, pose.header.stamp.nanosec) for pose in poses}
    for answer, quiet in zip(hidden, silent):
        stamp = answer.header.stamp
        assert ((stamp.sec, stamp.nanosec) in stamps) != quiet
    state = client.state_after(hidden[-1])
    assert state['state'] in ('searching', 'lost') and state['box'] == 'predicted'
    assert state['level'] in (b'\x01', b'\x02')
    # It's back where it was last seen, not where it is predicted: the search has to find it.
    back = [client.send(SCENE.frame(14), client.start + STEP * index) for index in range(75, 105)]
    assert overlap(back[-1], SCENE.box(14)) > 0.4
    log = process.log[since:]
    assert 'searching (was tracking)' in log and 'tracking (was ' in log


def test_lazy_pictures_and_particles(client):
    """Particles and debug image are published for subscribers, the latter in the image's frame."""
    assert send(client, 0).detections
    picture = client.hear('~/debug_image', Image)
    particles = client.hear('~/particles', PoseArray)
    client.until(lambda: client.node.count_publishers('/tracker/debug_image'), 'no picture')
    index = 0

    def more():
        nonlocal index
        index += 1
        client.answer = send(client, index)
        return picture and particles
    client.until(more, 'neither picture nor particles')
    assert (picture[-1].width, picture[-1].height) == (SCENE.width, SCENE.height)
    assert picture[-1].encoding == 'bgr8' and picture[-1].header.frame_id == 'camera_optical'
    sent = SCENE.frame(index)
    drawn = np.frombuffer(picture[-1].data, np.uint8).reshape(sent.shape)
    changed = (drawn != sent).any(axis=2).mean()
    assert 0.005 < changed < 0.5
    assert len(particles[-1].poses) == 150
    client.node.destroy_subscription(getattr(client, '_~/debug_image'))
    client.node.destroy_subscription(getattr(client, '_~/particles'))
    del client.heard['~/debug_image'], client.heard['~/particles']


def test_camera_info_makes_rays_and_metres(client, process):
    """With a calibration the pose is a ray; with the target's width it's in metres."""
    poses = client.hear('pose_with_covariance', PoseWithCovarianceStamped)
    client.until(lambda: client.node.count_publishers('/pose_with_covariance'), 'no poses')
    publisher = client.publisher('camera_info', CameraInfo)
    message = CameraInfo(width=SCENE.width, height=SCENE.height, distortion_model='plumb_bob')
    message.k = [200.0, 0.0, 79.5, 0.0, 200.0, 59.5, 0.0, 0.0, 1.0]
    send(client, 0)
    publisher.publish(message)
    index = 0

    def units(wanted):
        nonlocal index
        index += 1
        client.answer = send(client, index)
        return client.state_after(client.answer)['pose_units'] == wanted
    client.until(lambda: units('ray'), 'no ray')
    bounds = client.answer.detections[0].bbox
    x, y = bounds.center.position.x, bounds.center.position.y
    client.until(lambda: client.heard['pose'][-1].header == client.answer.header, 'no pose')
    place = client.heard['pose'][-1].pose.position
    assert (place.x, place.y, place.z) == pytest.approx(((x - 80) / 200, (y - 60) / 200, 1.0))

    said = len(process.log)
    assert client.change(target_width=0.6)[0].successful
    assert units('metres')
    process.wait_for_log('pose units: metres (was ray)', said)
    bounds = client.answer.detections[0].bbox
    depth = 200 * 0.6 / bounds.size_x
    client.until(lambda: poses and poses[-1].header == client.answer.header, 'no pose')
    place = poses[-1].pose.pose.position
    assert (place.x, place.y, place.z) == pytest.approx((
        depth * (bounds.center.position.x - 80) / 200,
        depth * (bounds.center.position.y - 60) / 200, depth))
    covariance = np.array(poses[-1].pose.covariance).reshape(6, 6)
    assert np.array_equal(covariance, covariance.T) or np.allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance[:3, :3]).min() > -1e-12 and covariance[2, 2] > 0

    assert client.change(pose_units='pixels')[0].successful
    assert units('pixels')
    # Units that aren't available aren't replaced by others.
    assert client.change(pose_units='metres', target_width=0.0)[-1].successful
    heard = len(client.heard['pose'])
    assert units('')
    assert len(client.heard['pose']) == heard
    since = len(process.log)
    publisher.publish(CameraInfo())
    process.wait_for_log('camera_info is not calibrated', since)
    assert 'there is no pose' in process.log[since:]
    assert 'in pixels' not in process.log[since:]
    for result in client.change(pose_units='auto'):
        assert result.successful
    publisher.publish(CameraInfo())
    client.until(lambda: units('pixels'), 'still calibrated')


def with_target_frame(client, words, frame_id='camera_optical'):
    """Set calibration, target_width and target_frame; send frames until `words` returns true."""
    publisher = client.publisher('camera_info', CameraInfo)
    message = CameraInfo(width=SCENE.width, height=SCENE.height)
    message.k = [200.0, 0.0, 79.5, 0.0, 200.0, 59.5, 0.0, 0.0, 1.0]
    assert client.change(target_width=0.6, target_frame='ball')[-1].successful
    publisher.publish(message)
    for index in range(100):
        answer = client.send_message(image_message(
            SCENE.frame(index), client.start + STEP * index, frame_id=frame_id))
        assert answer.detections
        if words():
            break
    assert words()
    assert client.change(target_width=0.0, target_frame='')[-1].successful
    publisher.publish(CameraInfo())
    return answer


def test_a_camera_without_calibration_is_told_once(client, process):
    """A driver without one sends zeros with every image: that's said once, not all the time."""
    publisher = client.publisher('camera_info', CameraInfo)
    since, words = len(process.log), 'fx and fy of k are 0 and 7'
    until = time.monotonic() + 2.2
    while time.monotonic() < until or words not in process.log[since:]:
        publisher.publish(CameraInfo(k=[0.0, 0.0, 0.0, 0.0, 7.0, 0.0, 0.0, 0.0, 1.0]))
        client.executor.spin_once(timeout_sec=0.1)
        assert time.monotonic() < until + 20
    assert process.log[since:].count(words) == 1


def test_transform_without_tf2_msgs_is_said(client, process):
    """Without tf2_msgs the node logs what to install, and goes on."""
    if importlib.util.find_spec('tf2_msgs') is not None:
        pytest.skip('tf2_msgs is installed')
    since = len(process.log)
    with_target_frame(client, lambda: 'ros-jazzy-tf2-msgs' in process.log[since:])


def test_a_transform_needs_a_frame(client, process):
    """Where the images have no frame_id, none is sent, for tf2 takes none; the log says so."""
    since = len(process.log)
    with_target_frame(client, lambda: 'no transform to target_frame ball: the images have the '
                      "frame_id ''" in process.log[since:], frame_id='')


def test_transform(client):
    """With tf2_msgs the transform of target_frame equals the pose."""
    tf2 = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs')
    transforms = client.hear('/tf', tf2.TFMessage)
    with_target_frame(client, lambda: bool(transforms))
    told, = transforms[0].transforms
    assert told.child_frame_id == 'ball' and told.header.frame_id == 'camera_optical'
    pose = next(pose for pose in client.heard['pose'] if pose.header == told.header).pose
    place = told.transform.translation
    assert (place.x, place.y, place.z) == (pose.position.x, pose.position.y, pose.position.z)
    assert told.transform.rotation == pose.orientation


def test_subscriber_that_cannot_match_is_told(client, process):
    """A subscriber with incompatible QoS is reported in log and diagnostics while it exists."""
    since = len(process.log)
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    from geometry_msgs.msg import PoseStamped
    subscription = client.node.create_subscription(PoseStamped, '/pose', lambda _: None, qos)
    process.wait_for_log('QoS mismatch', since)
    assert '/pose' in process.log[since:] and 'DURABILITY' in process.log[since:].upper()
    diagnosis(client, '/tracker: images', lambda row, values: 'DURABILITY' in
              values['QoS mismatches'].upper() and row.level == b'\x02')
    client.node.destroy_subscription(subscription)
    diagnosis(client, '/tracker: images', lambda row, values:
              values['QoS mismatches'] == 'none' and row.level != b'\x02')


def test_a_new_stream_during_a_pause(client, process):
    """While paused, stamps that go back end the tracking too, and the log says so at once."""
    for index in (0, 1, 2, 300):
        send(client, index)
    assert client.ask('~/enable', SetBool, data=False).success
    since, index = len(process.log), 150

    def told():
        nonlocal index
        index += 1
        client.send(SCENE.frame(index), client.start + STEP * index, answered=False)
        client.executor.spin_once(timeout_sec=0.1)
        return 'the clock was set back; the target is forgotten' in process.log[since:]
    client.until(told, 'nothing was said')
    assert client.ask('~/enable', SetBool, data=True).success
    client.until(lambda: client.heard['~/state'][-1].message == 'waiting', 'a target is kept')


def test_reset_is_in_the_state(client):
    """After a reset the state is waiting, which is no error."""
    assert send(client, 0).detections
    assert client.ask('~/reset', Trigger).success
    state = client.state_after(send(client, 1))
    assert state['state'] == 'waiting' and state['level'] == b'\x00'
    assert 'box' not in state


def test_large_images_that_are_lost_on_the_way_are_told_of():
    """When large images are lost, as without our profile, the log advises it."""
    frame = np.zeros((480, 640, 3), np.uint8)
    with NodeProcess('-r', '__ns:=/far') as process, Client('/far/tracker') as client:
        client.ready()
        index, step, began = 0, 12 * STEP, time.monotonic()
        while '(logged once)' not in process.log:
            assert time.monotonic() < began + 30, process.log
            index += 1 + (index % 4 == 0)
            client.send(frame, 10**9 + step * index)
            # in real time: a publisher that falls behind its own stamps isn't diagnosed as lossy
            time.sleep(max(0.0, began + 1e-9 * step * index - time.monotonic()))
        assert 'need the Fast DDS profile config/fastdds.xml in the publisher' in process.log
