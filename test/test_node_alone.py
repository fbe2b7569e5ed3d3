"""Nodes in processes of their own: QoS mismatches, clocks, and several nodes side by side."""

import re
import subprocess
import sys

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from node_harness import Client, diagnosis, image_message, NodeProcess, overlap, Scene, STEP
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, RegionOfInterest
from shared_segments import kill

SCENE = Scene()
BOX = '[' + ', '.join(str(value) for value in SCENE.box(0).as_array()) + ']'


def test_image_publisher_that_cannot_match_is_said_within_a_second():
    """A reliable node reports a best-effort publisher in the log and the diagnostics at once."""
    with NodeProcess(reliability='reliable') as process, Client(publish=None) as client:
        client.hear('/diagnostics', DiagnosticArray)
        client.ready()
        since = len(process.log)
        camera = client.node.create_publisher(
            Image, '/image', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
        process.wait_for_log('QoS mismatch', since)
        log = process.log[since:]
        assert '/image' in log and 'best_effort' in log
        level, message, values = diagnosis(
            client, '/tracker: images', lambda row, values: row.level == b'\x02')
        assert 'QoS mismatch' in message and "of node 'client'" in message
        assert values['reliability'] == 'reliable'
        client.node.destroy_publisher(camera)
        diagnosis(client, '/tracker: images',
                  lambda row, values: row.message == 'no node publishes /image')


def test_wrong_type_on_the_image_topic_is_said():
    """A publisher of CompressedImage on the topic image is logged as one of the wrong type."""
    with NodeProcess() as process, Client(publish=CompressedImage) as client:
        process.wait_for_log('sends sensor_msgs/msg/CompressedImage, not sensor_msgs/msg/Image')
        assert client.images is not None


def test_every_input_takes_what_its_publisher_offers():
    """A best-effort calibration is used; a wrong type on a selection topic is reported."""
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    with NodeProcess(init_box=BOX) as process, Client() as client:
        client.hear('/diagnostics', DiagnosticArray)
        client.ready()
        camera = client.node.create_publisher(CameraInfo, '/camera_info', best_effort)
        process.wait_for_log('/camera_info: subscribed best_effort')
        client.until(camera.get_subscription_count, 'nobody takes the calibration')
        message = CameraInfo(width=SCENE.width, height=SCENE.height)
        message.k = [200.0, 0.0, 79.5, 0.0, 200.0, 59.5, 0.0, 0.0, 1.0]
        index = 0

        def calibrated():
            nonlocal index
            index += 1
            camera.publish(message)
            answer = client.send(SCENE.frame(index), 10**9 + STEP * index)
            return client.state_after(answer)['pose_units'] == 'ray'
        client.until(calibrated, 'no ray')
        client.node.create_publisher(Image, '/tracker/init_roi', 1)
        diagnosis(client, '/tracker: images', lambda row, values: (
            '/tracker/init_roi' in values['QoS mismatches'] and row.level == b'\x02'))


def test_a_calibration_that_was_published_before():
    """A latched calibration is received by a node that starts later, and then a volatile one."""
    message = CameraInfo(width=SCENE.width, height=SCENE.height)
    message.k = [200.0, 0.0, 79.5, 0.0, 200.0, 59.5, 0.0, 0.0, 1.0]
    with Client() as client:
        latched = client.node.create_publisher(CameraInfo, '/camera_info', QoSProfile(
            depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        latched.publish(message)
        with NodeProcess(init_box=BOX) as process:
            client.ready()
            index = 0

            def calibrated():
                nonlocal index
                index += 1
                answer = client.send(SCENE.frame(index), 10**9 + STEP * index)
                return client.state_after(answer)['pose_units'] == 'ray'
            client.until(calibrated, 'no ray')
            client.node.destroy_publisher(latched)
            client.publisher('camera_info', CameraInfo).publish(CameraInfo())
            process.wait_for_log('camera_info is not calibrated')


def test_two_cameras_on_one_topic_are_told_once():
    """Two publishers of images are warned of once: their images would be taken as one stream."""
    with NodeProcess() as process, Client() as client, Client() as other:
        client.ready()
        process.wait_for_log('/image has 2 publishers')
        other.ready()
        heard = client.heard['~/state']
        del heard[:]
        # An idle node publishes its state once a second: wait for three seconds.
        client.until(lambda: len(heard) >= 3, 'no state')
        assert process.log.count('publishers: their images') == 1


#: Writes the name of every module that Python imports to the standard error.
TELL_LOADS = """
class Loads:
    def find_spec(self, name, path=None, target=None):
        sys.stderr.write(f'loads {name}\\n')
sys.meta_path.insert(0, Loads())
"""


def test_nothing_is_loaded_while_images_come():
    """No module is imported once images come: that would stop the node for several frames."""
    with NodeProcess(prelude=TELL_LOADS, init_box=BOX, target_width=0.6,
                     target_frame='ball') as process, Client() as client:
        camera = client.publisher('camera_info', CameraInfo)
        for topic, kind in (('/diagnostics', DiagnosticArray), ('~/debug_image', Image),
                            ('~/particles', PoseArray)):
            client.hear(topic, kind)
        client.ready()
        assert 'loads numpy' in process.log
        calibration = CameraInfo(width=SCENE.width, height=SCENE.height)
        calibration.k = [200.0, 0.0, 79.5, 0.0, 200.0, 59.5, 0.0, 0.0, 1.0]
        camera.publish(calibration)
        since, stamp = process.log.index('images are taken'), 10**9
        for index in range(40):
            # dropped frames, jitter of the stamps and, from frame 30 on, a target that jumps
            stamp += STEP * (4 if index % 9 == 8 else 1) + index % 5 * STEP // 20
            client.send(SCENE.frame(index if index < 30 else 9 * index), stamp)
        _, _, values = diagnosis(client, '/tracker: images',
                                 lambda _, values: int(values['frames received']) == 40)
        assert int(values['frames missing']) > 0
        client.until(lambda: client.heard['~/debug_image'] and client.heard['~/particles'],
                     'neither picture nor particles')
        assert 'pose units: metres' in process.log
        assert 'loads' not in process.log[since:]


def test_first_line_says_what_to_do():
    """It names the topic of the images, and the topics and the parameter that select a target."""
    with NodeProcess('-r', '__ns:=/arm', '-r', 'image:=/camera/image_raw') as process:
        process.wait_for_log('\n')
        line = process.log.splitlines()[0]
        for name in ('/camera/image_raw', '/arm/tracker/init_roi', '/arm/tracker/init,',
                     'init_box'):
            assert name in line
    with NodeProcess(init_box=BOX) as process:
        process.wait_for_log('\n')
        assert 'init_box' in process.log.splitlines()[0]


def test_sim_time():
    """With use_sim_time diagnostics have the time of /clock; images keep their own stamps."""
    with NodeProcess(use_sim_time='true', init_box=BOX), Client() as client:
        arrays = client.hear('/diagnostics', DiagnosticArray)
        client.ready()
        clock = client.publisher('/clock', Clock)
        for index in range(5):
            assert send_at(client, index).detections

        def told():
            clock.publish(Clock(clock=Time(sec=77)))
            return arrays and arrays[-1].header.stamp.sec == 77
        client.until(told, 'the clock is not used')
        assert send_at(client, 5).detections


def send_at(client, index):
    """Send a frame of the scene, stamped at 30 Hz from 1 s on."""
    return client.send(SCENE.frame(index), 10**9 + STEP * index)


def test_trackers_in_namespaces():
    """Three nodes on one image topic answer every image, each with the target's box in it."""
    names = ['/a', '/b', '/c']
    processes, clients = [], []
    try:
        for name in names:
            processes.append(NodeProcess('-r', f'__ns:={name}', '-r', 'image:=/image',
                                         init_box=BOX))
        with Client(publish=None) as sender:
            camera = sender.node.create_publisher(Image, '/image', 10)
            for name in names:
                client = Client(f'{name}/tracker', publish=None)
                clients.append(client)
                client.ready()
            sender.until(lambda: camera.get_subscription_count() == len(names),
                         'not all take images')
            for index in range(10):
                message = image_message(SCENE.frame(index), 10**9 + STEP * index)
                camera.publish(message)
                for client in clients:
                    heard = client.heard['detections']
                    client.until(lambda: heard and heard[-1].header == message.header, 'no answer')
                    assert overlap(heard[-1], SCENE.box(index)) > 0.4
    finally:
        for client in clients:
            client.__exit__()
        for process in processes:
            assert process.stop() == 0, process.log


def test_without_vision_msgs():
    """Without vision_msgs the node logs what to install, takes a region and publishes poses."""
    with NodeProcess(prelude="sys.modules['vision_msgs'] = None") as process, Client() as client:
        process.wait_for_log('ros-jazzy-vision-msgs')
        client.until(lambda: client.images.get_subscription_count(), 'takes no images')
        client.until(lambda: client.node.count_publishers('/pose'), 'sends no poses')
        region = client.publisher('~/init_roi', RegionOfInterest)
        box = SCENE.box(0)
        region.publish(RegionOfInterest(x_offset=int(box.x), y_offset=int(box.y),
                                        width=int(box.width), height=int(box.height)))
        poses, index = client.heard['pose'], 0

        def tracked():
            nonlocal index
            client.images.publish(image_message(SCENE.frame(0), 10**9 + STEP * index))
            index += 1
            client.executor.spin_once(timeout_sec=0.05)
            return len(poses) > 5
        client.until(tracked, 'no pose')
        place = poses[-1].pose.position
        assert abs(place.x - box.center[0]) < 4 and abs(place.y - box.center[1]) < 4


def test_slip_of_the_pen_from_the_start_is_told():
    """An unknown parameter on the command line is logged, with the valid name."""
    with NodeProcess(gmpf__particels=100) as process:
        log = process.wait_for_log("unknown parameter 'gmpf.particels' ignored")
        assert 'gmpf.particles' in log


def test_quality_of_service_that_is_not_overridden_is_told():
    """qos_overrides of an input have no effect: the log names the parameter to use instead."""
    name = 'qos_overrides./image.subscription.reliability'
    clock = 'qos_overrides./clock.subscription.depth'
    with NodeProcess('-p', f'{name}:=best_effort', '-p', f'{clock}:=2') as process:
        log = process.wait_for_log(f"unknown parameter '{name}' ignored; each subscription adopts")
        assert "'reliability'" in log
        process.wait_for_log('waiting (was inactive)')
        assert '/clock' not in process.log


def test_example_of_the_manual(repository):
    """The program in node.md selects a target, and prints its boxes."""
    text = (repository / 'docs' / 'node.md').read_text()
    program, = re.findall('```python\n(.*?)```', text, re.DOTALL)
    scene = Scene(480, 360)
    with NodeProcess(), Client() as client:
        client.ready()
        example = subprocess.Popen(
            [sys.executable, '-u', '-c', program], stdout=subprocess.PIPE, text=True)
        try:
            index = 0

            def tracked():
                nonlocal index
                index += 1
                answer = client.send(scene.frame(0), 10**9 + STEP * index)
                return answer.detections
            client.until(tracked, 'no target was pointed out')
            line = next(line for line in example.stdout if line != '[]\n')
            assert 'BoundingBox2D' in line
            example.terminate()

            def ended():
                # A signal that comes just when rclpy goes to sleep fails to wake it: the next
                # message does, as a camera's would.
                tracked()
                return example.poll() is not None
            client.until(ended, 'the example did not end')
        finally:
            kill(example)
