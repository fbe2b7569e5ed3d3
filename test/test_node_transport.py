"""Images of real size, with the profile that is shipped."""

import time

from node_harness import Client, image_message, NodeProcess, Scene, STEP
import pytest

SCENE = Scene(640, 480, 60)
COUNT = 60
#: In seconds, by when an answer is taken for one that never comes.
PATIENCE = 2.0


def send(client, messages):
    """Send images, each after the answer to the last one, at most 30 a second; return answers."""
    answers = client.heard['detections']
    for message in messages:
        start = time.monotonic()
        client.images.publish(message)
        while (passed := time.monotonic() - start) < PATIENCE:
            client.executor.spin_once(timeout_sec=0.01)
            if passed >= 1 / 30 and answers and answers[-1].header == message.header:
                break
    return [answer.header.stamp.sec * 10**9 + answer.header.stamp.nanosec for answer in answers]


@pytest.mark.parametrize('reliability', ['BEST_EFFORT', 'RELIABLE'])
def test_vga_arrives(reliability):
    """
    Of VGA nothing is lost on the way, whatever the publisher offers.

    An image is a burst of hundreds of packets. Without the profile, half of the best-effort ones
    are lost always. However busy the machine is, none is sent while the node is at work: what
    isn't answered was lost on the way.
    """
    box = SCENE.box(0)
    init = f'[{box.x}, {box.y}, {box.width}, {box.height}]'
    with NodeProcess(init_box=init), Client(reliability=reliability) as client:
        client.ready()
        stamps = send(client, [image_message(SCENE.frame(i), 10**9 + STEP * i)
                               for i in range(COUNT)])
        # Never an older frame after a newer one.
        assert stamps == sorted(set(stamps))
        assert len(stamps) >= 0.9 * COUNT
