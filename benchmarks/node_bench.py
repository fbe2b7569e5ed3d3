"""Helpers to measure a node: its process, a stream of images, answers, CPU and memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

import cv2
import numpy as np
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage, Image

from vtrack_ros.bags.messages import detected_box
from vtrack_ros.dds import with_profile
from vtrack_ros.geometry import Box

#: The target's side, [px], and the period of its motion to and fro, [frames].
SIDE, WAY = 64, 12
#: Time-out of whatever is waited for, [s].
PATIENCE = 30.0


class Bench:
    """Sends images and times the poses that come back."""

    def __init__(self) -> None:
        rclpy.init(args=[])
        self.node = Node('bench')
        self.executor = rclpy.executors.SingleThreadedExecutor()
        self.executor.add_node(self.node)

    def close(self) -> None:
        """Leave ROS."""
        rclpy.try_shutdown()

    def until(self, condition: Any, what: str) -> None:
        """Spin until a condition holds; after `PATIENCE`, raise RuntimeError(what)."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > deadline:
                raise RuntimeError(what)
            self.executor.spin_once(timeout_sec=0.02)

    def rest(self, seconds: float) -> None:
        """Spin for a while."""
        end = time.perf_counter() + seconds
        while (left := end - time.perf_counter()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def stream(self, publisher: Any, messages: Sequence[Any], rate: float, count: int,
               began: list[int], first: int) -> None:
        """Publish `count` images at a rate, [Hz], and spin; append the times of sending, [ns]."""
        due = time.perf_counter()
        for index in range(count):
            self.rest(due - time.perf_counter())
            message = messages[(first + index) % len(messages)]
            stamp = (first + index) * round(1e9 / rate)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            began.append(time.perf_counter_ns())
            publisher.publish(message)
            due += 1 / rate
        self.rest(0.3)


class Answers:
    """Record the answers to images that were sent: latency, and box where there is one."""

    def __init__(self) -> None:
        self._sent: dict[int, int] = {}
        self.clear()

    def clear(self) -> None:
        """Reset the records; answers to images sent before are ignored."""
        self._sent.clear()
        self.latency_ms: list[float] = []
        #: The box by the image's stamp, where the target was found.
        self.boxes: dict[int, Box] = {}

    @property
    def found(self) -> int:
        """Return in how many images the target was found."""
        return len(self.boxes)

    def send(self, publisher: Any, image: Any, stamp: int) -> None:
        """Publish an image with a stamp in nanoseconds."""
        image.header.stamp.sec, image.header.stamp.nanosec = divmod(stamp, 10**9)
        self._sent[stamp] = time.perf_counter_ns()
        publisher.publish(image)

    def hear(self, message: Any) -> None:
        """Record the answer to one image."""
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if stamp in self._sent:
            self.latency_ms.append((time.perf_counter_ns() - self._sent.pop(stamp)) / 1e6)
            box = detected_box(message)
            if box is not None:
                self.boxes[stamp] = box

    def percentiles(self) -> tuple[float, float]:
        """Return the latency's median and 99th percentile in milliseconds; NaN without answers."""
        if not self.latency_ms:
            return np.nan, np.nan
        p50, p99 = np.percentile(self.latency_ms, (50, 99))
        return float(p50), float(p99)


@contextmanager
def child(*arguments: str, environment: Mapping[str, str] | None = None,
          ) -> Iterator[subprocess.Popen[bytes]]:
    """Run Python with arguments until the block ends; with the Fast DDS profile by default."""
    process = subprocess.Popen(
        [sys.executable, *arguments], env=environment or with_profile(os.environ))
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            # no error, so that the measurements are kept
            print(f'{process.args} did not end on SIGTERM', file=sys.stderr)
            process.kill()
            process.wait()


def tracker_arguments(name: str, tracker: str, box: str, *more: str) -> list[str]:
    """Return the arguments of a node in a namespace of its own."""
    return ['-m', 'vtrack_ros.ros.main', '--ros-args', '-r', f'__ns:=/{name}',
            '-p', f'tracker:={tracker}', '-p', f'init_box:={box}', *more]


def target_box(index: int, width: int, height: int) -> Box:
    """Return the target's box in an image of the `scene`, which repeats after `WAY` images."""
    across = 4 * (WAY // 2 - abs(index % WAY - WAY // 2))
    return Box(width // 3 + across, height // 3, SIDE, SIDE)


def scene(width: int, height: int) -> tuple[list[Any], str]:
    """Return images of a textured square that moves to and fro, and its first box."""
    rng = np.random.default_rng(1)
    ground = np.kron(rng.integers(40, 120, (height // 20, width // 20, 3)),
                     np.ones((20, 20, 1))).astype(np.uint8)
    target = np.kron(rng.integers(0, 2, (SIDE // 8, SIDE // 8)), np.ones((8, 8), int))
    colours = np.array([[30, 40, 220], [220, 200, 40]], np.uint8)
    messages = []
    for index in range(WAY):
        x, top = (int(value) for value in target_box(index, width, height).as_array()[:2])
        frame = ground.copy()
        frame[top:top + SIDE, x:x + SIDE] = colours[target]
        message = Image(width=width, height=height, encoding='bgr8', step=3 * width)
        message.header.frame_id = 'camera'
        message.data = frame.tobytes()
        messages.append(message)
    return messages, str(target_box(0, width, height).as_array().astype(int).tolist())


def compressed(image: Any) -> Any:
    """Return an image in colour as a driver's image_transport compresses it."""
    frame = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3)
    message = CompressedImage(header=image.header, format='bgr8; jpeg compressed bgr8')
    message.data = cv2.imencode('.jpg', frame)[1].tobytes()
    return message


def cpu_seconds(pid: int) -> float:
    """Return the CPU time that a process has taken, in seconds."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def rss_mb(pid: int, part: str = 'VmRSS') -> float:
    """
    Return the resident memory of a process, [MB]; libraries and DDS segments are included.

    With the `part` `RssAnon`, only private memory counts. Shared memory has a fixed size, but each
    of its pages counts only from its first use on.
    """
    status = dict(line.split(':', 1) for line in
                  Path(f'/proc/{pid}/status').read_text().splitlines() if ':' in line)
    return int(status[part].split()[0]) / 1e3
