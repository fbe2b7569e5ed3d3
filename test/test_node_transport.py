"""Transport of VGA images with the package's Fast DDS profile."""

import time

from node_harness import Client, image_message, NodeProcess, Scene, STEP
import pytest

SCENE = Scene(640, 480, 60)
COUNT = 60
#: Time-out for an answer, in seconds.
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
    At least 90 % of VGA images are answered, in order, whatever the publisher's reliability.

    An image is a burst of hundreds of packets. Without the profile, half of the best-effort ones
    are always lost. Each image is sent after the answer to the last one (or the time-out), so an
    image without an answer was lost in transport, however busy the machine is.
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
