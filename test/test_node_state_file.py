"""The state file: after a node was killed, the next one continues with its saved target."""

import json
import os
import signal
import time

from node_harness import Client, NodeProcess, overlap, Scene, STEP
import pytest
from vtrack_ros.dds import give_memory_back

START = 10**9


@pytest.fixture
def scene():
    """Return the images."""
    return Scene()


def box_parameter(box):
    """Return a box as init_box."""
    return str(box.as_array().tolist())


def saved(path, process, client, scene, index):
    """Send frames until the file has been written (again); return the next frame's index."""
    before = path.stat().st_mtime_ns if path.exists() else 0
    deadline = time.monotonic() + 20
    while not path.exists() or path.stat().st_mtime_ns == before:
        assert time.monotonic() < deadline, process.log
        client.send(scene.frame(index), START + STEP * index)
        index += 1
        time.sleep(0.03)
    return index


def test_a_killed_node_goes_on_with_its_target(tmp_path, scene):
    """A new node tracks the same target, with its id, where it is by now, whatever init_box is."""
    path = tmp_path / 'target.json'
    process = NodeProcess(state_file=path, init_box=box_parameter(scene.box(0)))
    try:
        with Client() as client:
            client.ready()
            index = saved(path, process, client, scene, 0)
            first = client.send(scene.frame(index), START + STEP * index)
    finally:
        # The client has ended before: where another process was killed, Fast DDS sometimes (1 in
        # 70 times on a busy machine) crashes when it removes a participant's shared memory.
        give_memory_back(process.process.pid)
        assert process.stop(signal.SIGKILL) != 0
    index += 12
    # The target isn't in this init_box, over which the saved target takes precedence.
    with NodeProcess(state_file=path, init_box='[100, 90, 30, 20]') as process, (
            Client()) as client:
        client.ready()
        answers = [client.send(scene.frame(i), START + STEP * i)
                   for i in range(index, index + 10)]
        process.wait_for_log('the target of state_file is looked for in the first')
        process.wait_for_log('gmpf continues with the target at')
        assert overlap(answers[-1], scene.box(index + 9)) > 0.5
        assert answers[-1].detections[0].id == first.detections[0].id
        assert client.state_after(answers[-1])['state'] == 'tracking'
        # Another target has another id.
        assert client.change(init_box=[*scene.box(index + 10).as_array()])[0].successful
        answers.append(client.send(scene.frame(index + 10), START + STEP * (index + 10)))
        assert answers[-1].detections[0].id not in ('', first.detections[0].id)
    # When it ends cleanly, it saves the target as of the latest frame.
    state, latest = json.loads(path.read_text()), answers[-1].header.stamp
    assert state['stamp'] == latest.sec * 10**9 + latest.nanosec
    assert os.listdir(tmp_path) == ['target.json']


def test_a_target_that_was_given_up_stays_so(tmp_path, scene):
    """~/reset removes the file."""
    from std_srvs.srv import Trigger
    path = tmp_path / 'target.json'
    with NodeProcess(state_file=path, init_box=box_parameter(scene.box(0))) as process:
        with Client() as client:
            client.ready()
            saved(path, process, client, scene, 0)
            client.ask('~/reset', Trigger)
            client.until(lambda: not path.exists(), 'the file is taken away')


def test_a_target_that_is_given_up_before_the_first_image(tmp_path, scene):
    """~/reset removes the file, and nothing is restored from it."""
    from std_srvs.srv import Trigger
    path = tmp_path / 'target.json'
    with NodeProcess(state_file=path, init_box=box_parameter(scene.box(0))), Client() as client:
        client.ready().send(scene.frame(0), START)
    assert path.exists()
    with NodeProcess(state_file=path), Client() as client:
        client.ready()
        client.ask('~/reset', Trigger)
        client.until(lambda: not path.exists(), 'the file is taken away')
        assert not client.send(scene.frame(1), START + STEP).detections


def test_a_detector_does_not_replace_a_saved_target(tmp_path, scene):
    """A detection that comes before the first image, as while a node restarts, isn't taken."""
    from rclpy.duration import Duration
    from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose
    path = tmp_path / 'target.json'
    with NodeProcess(state_file=path, init_box=box_parameter(scene.box(0))), Client() as client:
        before = client.ready().send(scene.frame(0), START)
    detection = Detection2D(results=[ObjectHypothesisWithPose()])
    detection.results[0].hypothesis.score = 0.9
    detection.bbox.center.position.x, detection.bbox.center.position.y = 120.0, 90.0
    detection.bbox.size_x = detection.bbox.size_y = 24.0
    with NodeProcess(state_file=path, init_from_detections='true') as process, (
            Client()) as client:
        detector = client.ready().publisher('~/init_detections', Detection2DArray)
        detector.publish(Detection2DArray(detections=[detection]))
        assert detector.wait_for_all_acked(Duration(seconds=10))
        answer = client.send(scene.frame(1), START + STEP)
        assert overlap(answer, scene.box(1)) > 0.5, process.log
        assert answer.detections[0].id == before.detections[0].id


def test_a_full_disk_is_told_once(tmp_path, scene):
    """If the file can't be written that's logged once, tracking goes on, and no file is left."""
    path = tmp_path / 'target.json'
    limit = 'import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))'
    with NodeProcess(prelude=limit, state_file=path,
                     init_box=box_parameter(scene.box(0))) as process, Client() as client:
        client.ready()
        for index in range(1000):
            told = 'could not be written' in process.log
            assert client.send(scene.frame(index), START + STEP * index).detections
            if told:
                break
            time.sleep(0.03)
    assert process.log.count('could not be written') == 1
    assert os.listdir(tmp_path) == []


def test_what_cannot_be_used_is_refused_once(tmp_path, scene):
    """A damaged file is logged once and overwritten; a file that isn't the node's is kept."""
    damaged, foreign = tmp_path / 'damaged.json', tmp_path / 'foreign.yaml'
    damaged.write_text('{"format": "vtrack_ros target 1", "node": "/tra')
    foreign.write_text('tracker: gmpf\n')
    begin = box_parameter(scene.box(0))
    with NodeProcess(state_file=damaged, init_box=begin) as process, Client() as client:
        client.ready()
        process.wait_for_log('is not used: it is damaged')
        saved(damaged, process, client, scene, 0)
        assert json.loads(damaged.read_text())['node'] == '/tracker'
        assert process.log.count('is not used') == 1
    # The file that the node before saved isn't used for images of another size.
    other = Scene(200, 100)
    with NodeProcess(state_file=damaged, init_box=box_parameter(other.box(0))) as process, (
            Client()) as client:
        client.ready()
        answer = client.send(other.frame(0), START + 10**9 * 60)
        process.wait_for_log('is not used: its image is 160 x 120 x 3, but the received '
                             'image is 200 x 100 x 3')
        assert overlap(answer, other.box(0)) > 0.9
    with NodeProcess(state_file=foreign) as process:
        process.wait_for_log('left unchanged; the target will not be saved')
    assert foreign.read_text() == 'tracker: gmpf\n'
