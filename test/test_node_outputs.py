"""What the node publishes: detections, boxes and poses, with the image's header."""

from node_harness import Client, NodeProcess, overlap, Scene
import pytest


@pytest.fixture(scope='module')
def talk():
    """Return a scene and a client of a node that starts on the scene's first box."""
    scene = Scene()
    box = scene.box(0)
    text = f'[{box.x}, {box.y}, {box.width}, {box.height}]'
    with NodeProcess(init_box=text) as process, Client() as client:
        client.ready()
        yield scene, client, process


def test_tracks(talk):
    """Every image gets its detections, and the box follows the target."""
    scene, client, process = talk
    for index, answer in enumerate(client.play(scene, range(30))):
        assert overlap(answer, scene.box(index)) > 0.5, process.log
        assert len(answer.detections) == 1
    client.until(lambda: len(client.heard['bounding_box']) >= 30, 'boxes are missing')
    poses = client.heard['pose']
    assert len(poses) == 30
    assert len(client.heard['bounding_box']) == 30
    for pose, answer, bounds in zip(poses, client.heard['detections'],
                                    client.heard['bounding_box']):
        assert pose.header == answer.header == answer.detections[0].header
        assert pose.header.frame_id == 'camera_optical'
        center = answer.detections[0].bbox.center.position
        assert (pose.pose.position.x, pose.pose.position.y) == (center.x, center.y)
        assert pose.pose.position.z == 0.0
        assert bounds == answer.detections[0].bbox
