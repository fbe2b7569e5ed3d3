"""A sender of images of a target to a node, which also judges the node's answers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import subprocess
import time
from typing import Any

from geometry_msgs.msg import PoseStamped
from node_bench import Bench, child, scene, SIDE, tracker_arguments, WAY
from sensor_msgs.msg import Image, RegionOfInterest
from vision_msgs.msg import Detection2DArray

from vtrack_ros.geometry import Box

WIDTH, HEIGHT, RATE = 640, 480, 30
PERIOD = 10**9 // RATE
FRAME_ID = 'camera'
#: Time-out of a recovery, [s]: after it the target counts as lost for good.
PATIENCE = 15.0


def truth(index: int) -> Box:
    """Return the target's box in the image with this number."""
    x = WIDTH // 3 + 4 * (WAY // 2 - abs(index % WAY - WAY // 2))
    return Box(x, HEIGHT // 3, SIDE, SIDE)


class Sender:
    """Send images to the node `ours`, and receive its boxes and poses."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.images, self.box = scene(WIDTH, HEIGHT)
        self.publisher = bench.node.create_publisher(Image, '/ours/image', 10)
        self.selection = bench.node.create_publisher(
            RegionOfInterest, '/ours/tracker/init_roi', 1)
        self._hearing = [
            bench.node.create_subscription(
                Detection2DArray, '/ours/detections', self._on_detections, 1000),
            bench.node.create_subscription(PoseStamped, '/ours/pose', self._on_pose, 1000)]
        self.index = 10_000 // WAY * WAY
        self.stamped = True
        self._numbers: dict[int, int] = {}
        #: Whether another process sends the images; their stamps are multiples of `PERIOD`.
        self.elsewhere = False
        self.clear()

    def clear(self) -> None:
        """Reset the counts."""
        self.sent = self.answers = self.right = self.wrong = self.foreign = 0
        self.last_right = 0.0

    def send(self, stamp: int | None = None, image: Any = None) -> None:
        """Send the next image, or another one, with its own stamp [ns] or another."""
        image = self.images[self.index % WAY] if image is None else image
        if stamp is None:
            stamp = self.index * PERIOD if self.stamped else 0
        image.header.stamp.sec, image.header.stamp.nanosec = divmod(stamp, 10**9)
        image.header.frame_id = FRAME_ID
        self._numbers[stamp] = self.index
        self.publisher.publish(image)
        self.sent += 1

    def stream(self, seconds: float, send: Callable[[int], None] | None = None) -> None:
        """Send images at `RATE`; `send(number)`, if given, sends each instead of `self.send`."""
        due = time.perf_counter()
        for number in range(round(seconds * RATE)):
            self.index += 1
            send(number) if send else self.send()
            due += 1 / RATE
            self.bench.rest(due - time.perf_counter())
        self.bench.rest(0.2)

    def recovery(self) -> float:
        """Send images until the target is tracked; return the time that took, [s], or infinity."""
        began, self.last_right = time.perf_counter(), 0.0
        while not self.last_right and time.perf_counter() - began < PATIENCE:
            self.stream(1 / RATE)
        return self.last_right - began if self.last_right else float('inf')

    def select(self) -> None:
        """Select the target, for the next image."""
        box = truth(self.index + 1)
        self.selection.publish(RegionOfInterest(
            x_offset=int(box.x), y_offset=int(box.y), width=SIDE, height=SIDE))
        self.bench.rest(0.1)

    def row(self, recovered: list[float], **more: Any) -> dict[str, Any]:
        """Return the figures of a fault."""
        return {'sent': None if self.elsewhere else self.sent, 'answered': self.answers,
                'right': self.right, 'wrong': self.wrong, 'foreign': self.foreign,
                'recovered_s': recovered, **more}

    def _known(self, header: Any) -> int:
        """Return an answer's stamp, [ns]; count it as foreign if no image had its header."""
        stamp = int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)
        sent = stamp % PERIOD == 0 if self.elsewhere else stamp in self._numbers
        self.foreign += not sent or header.frame_id != FRAME_ID
        return stamp

    def _on_pose(self, message: Any) -> None:
        x = message.pose.position.x
        number = self._numbers.get(stamp := self._known(message.header), round(stamp / PERIOD))
        # A pose beside the target is wrong: nothing was visible there.
        self.wrong += abs(x - truth(number).center[0]) > SIDE / 2

    def _on_detections(self, message: Any) -> None:
        self.answers += 1
        stamp = self._known(message.header)
        for detection in message.detections:
            center, bounds = detection.bbox.center.position, detection.bbox
            box = Box.from_center(center.x, center.y, bounds.size_x, bounds.size_y)
            if box.iou(truth(self._numbers.get(stamp, round(stamp / PERIOD)))) > 0.5:
                self.right += 1
                self.last_right = time.perf_counter()
            else:
                self.wrong += 1


@contextmanager
def tracking_node(sender: Sender, *more: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run the node on the target, until the block ends."""
    with child(*tracker_arguments('ours', 'gmpf', sender.box, *more)) as process:
        sender.bench.until(sender.publisher.get_subscription_count, 'the node was not found')
        show_target(sender)
        sender.stream(1.0)
        sender.clear()
        yield process


def show_target(sender: Sender) -> None:
    """Send the image that `init_box` is for, until the node finds the target."""
    sender.clear()
    while not sender.right:
        sender.index = (sender.index // WAY + 1) * WAY
        sender.send()
        sender.bench.rest(0.1)
