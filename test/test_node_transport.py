"""Images of real size at a real rate, with the profile that is shipped."""

import time

from node_harness import Client, image_message, NodeProcess, Scene, STEP
import pytest

pytestmark = pytest.mark.realtime

SCENE = Scene(640, 480, 60)
COUNT = 60


@pytest.mark.parametrize('reliability', ['BEST_EFFORT', 'RELIABLE'])
def test_vga_at_30_hz_arrives(reliability):
    """
    Of two seconds of VGA nothing is lost on the way, whatever the publisher offers.

    What is sent while the node is at work replaces what waits, so that on a machine that is busy
    otherwise a frame may be missing: the latest answer is that to the last frame all the same.
    """
    box = SCENE.box(0)
    init = f'[{box.x}, {box.y}, {box.width}, {box.height}]'
    messages = [image_message(SCENE.frame(i), 10**9 + STEP * i) for i in range(COUNT)]
    with NodeProcess(init_box=init), Client(reliability=reliability) as client:
        client.ready()
        answers = client.heard['detections']
        due = time.monotonic()
        for message in messages:
            while (left := due - time.monotonic()) > 0:
                client.executor.spin_once(timeout_sec=left)
            client.images.publish(message)
            due += 1 / 30
        client.until(lambda: answers and answers[-1].header == messages[-1].header,
                     'the last frame was not answered')
        assert len(answers) >= 0.9 * COUNT
        stamps = [answer.header.stamp.sec * 10**9 + answer.header.stamp.nanosec
                  for answer in answers]
        # Never an older frame after a newer one.
        assert stamps == sorted(set(stamps))
