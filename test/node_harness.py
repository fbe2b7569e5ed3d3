"""A tracking node in a process of its own, and a client that talks with it over real DDS."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

from diagnostic_msgs.msg import DiagnosticStatus
from forked_process import ForkedProcess
from geometry_msgs.msg import PoseStamped
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from vision_msgs.msg import BoundingBox2D, Detection2DArray

from vtrack_ros.dds import leave, with_profile
from vtrack_ros.geometry import Box

# The sender of images needs the profile, too; Fast DDS reads it when the first context is made.
os.environ.update(with_profile(os.environ))

#: Time-out of each wait of a test, in seconds.
PATIENCE = 20.0
#: Interval of the frame stamps, in nanoseconds: 30 Hz.
STEP = 33_333_333


#: Lets the kernel end the node's process with ours (PR_SET_PDEATHSIG is 1), however ours ends.
END_WITH_PARENT = 'import ctypes, signal; ctypes.CDLL(None).prctl(1, signal.SIGKILL)'


class NodeProcess:
    """
    The node in a process of its own.

    With a prelude it's a new interpreter, not a fork, which executes that code before it loads.
    """

    def __init__(self, *arguments: str, entry: str = 'main', prelude: str | None = None,
                 **parameters: object) -> None:
        words = ['--ros-args', *arguments]
        for name, value in parameters.items():
            words += ['-p', f'{name.replace("__", ".")}:={value}']
        self._lines: list[str] = []
        environment = with_profile(os.environ)
        self.process: subprocess.Popen[str] | ForkedProcess
        if prelude is None:
            self.process = ForkedProcess('vtrack_ros.ros.main', entry, words, environment)
        else:
            self.process = subprocess.Popen(
                [sys.executable, '-c', f'{END_WITH_PARENT}\nimport sys; {prelude}\n'
                 f'from vtrack_ros.ros.main import {entry}; sys.exit({entry}())', *words],
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def log(self) -> str:
        """Return what the process wrote so far."""
        return ''.join(self._lines)

    def wait_for_log(self, text: str, since: int = 0) -> str:
        """Wait until the process has written `text` after the first `since` characters."""
        deadline = time.monotonic() + PATIENCE
        while text not in self.log[since:]:
            assert time.monotonic() < deadline, f'never said {text!r}, but:\n{self.log}'
            assert self.process.poll() is None or text in self.log[since:], self.log
            time.sleep(0.01)
        return self.log[since:]

    def stop(self, number: int = signal.SIGTERM) -> int:
        """Send a signal, and return the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            code = self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise AssertionError(f'did not end on signal {number}:\n{self.log}') from None
        self._reader.join(PATIENCE)
        return code

    def __enter__(self) -> NodeProcess:
        """Return the process."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, and check that it ended cleanly."""
        assert self.stop() == 0, self.log
        assert 'Traceback' not in self.log, self.log

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.append(line)


class Scene:
    """A textured square that moves over a textured ground."""

    def __init__(self, width: int = 160, height: int = 120, size: int = 24,
                 seed: int = 5) -> None:
        rng = np.random.default_rng(seed)
        self.width, self.height, self.size = width, height, size
        self._ground = rng.integers(60, 110, (height, width, 3), np.uint8)
        colours = np.array([[20, 30, 220], [230, 220, 30]], np.uint8)
        coarse = rng.integers(0, 2, (size // 6, size // 6))
        self._patch = colours[np.kron(coarse, np.ones((6, 6), int))]

    def box(self, index: int) -> Box:
        """Return the target's box in a frame."""
        span = self.width - self.size - 40
        x = 20 + span - abs(2 * index % (2 * span) - span)
        return Box(x, self.height // 4 + abs(index % 12 - 6), self.size, self.size)

    def frame(self, index: int, visible: bool = True) -> np.ndarray:
        """Return a frame, BGR."""
        frame = self._ground.copy()
        if visible:
            x, y = int(self.box(index).x), int(self.box(index).y)
            frame[y:y + self.size, x:x + self.size] = self._patch
        return frame


def image_message(frame: np.ndarray, stamp: int, encoding: str | None = None,
                  frame_id: str = 'camera_optical') -> Image:
    """Return a frame as a message."""
    message = Image()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.header.frame_id = frame_id
    message.height, message.width = frame.shape[:2]
    message.encoding = encoding or ('bgr8' if frame.ndim == 3 else 'mono8')
    message.step = frame.strides[0]
    message.data = frame.tobytes()
    return message


class Client:
    """A client that sends images and stores what the node publishes."""

    def __init__(self, node_name: str = '/tracker', reliability: str = 'RELIABLE',
                 publish: type | None = Image, topic: str = 'image') -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node('client', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.name = node_name
        self.namespace = node_name.rsplit('/', 1)[0]
        self.heard: dict[str, list] = {}
        self.start = 10**12
        """The first stamp of the current stream, in ns, for tests that count from it."""
        self.images = None
        if publish is not None:
            qos = QoSProfile(depth=10, reliability=getattr(ReliabilityPolicy, reliability))
            self.images = self.node.create_publisher(publish, f'{self.namespace}/{topic}', qos)
        self.hear('pose', PoseStamped)
        self.hear('detections', Detection2DArray)
        self.hear('bounding_box', BoundingBox2D)
        self.hear('~/state', DiagnosticStatus)
        self.parameters = AsyncParameterClient(self.node, node_name)

    def resolved(self, topic: str) -> str:
        """Return a topic's name as the node under test has it."""
        if topic.startswith('/'):
            return topic
        return topic.replace('~', self.name, 1) if topic.startswith('~') else (
            f'{self.namespace}/{topic}')

    def begin_stream(self, *forgotten: str) -> None:
        """Begin a new stream with earlier stamps; clear what was heard on the forgotten topics."""
        self.start -= 10**10
        for topic in forgotten:
            del self.heard[topic][:]

    def hear(self, topic: str, kind: type, qos: QoSProfile | None = None) -> list:
        """Subscribe to an output; returns the list that the messages go into."""
        messages: list = []
        self.heard[topic] = messages
        subscription = self.node.create_subscription(
            kind, self.resolved(topic), messages.append, qos or QoSProfile(depth=1000))
        setattr(self, f'_{topic}', subscription)
        return messages

    def publisher(self, topic: str, kind: type, qos: QoSProfile | int = 10) -> object:
        """Return a publisher to an input, matched with the node."""
        publisher = self.node.create_publisher(kind, self.resolved(topic), qos)
        self.until(lambda: publisher.get_subscription_count() > 0, f'nobody takes {topic}')
        return publisher

    def until(self, condition, what: str, patience: float = PATIENCE) -> None:
        """Spin until a condition holds."""
        deadline = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < deadline, what
            self.executor.spin_once(timeout_sec=0.02)

    def ready(self) -> Client:
        """Wait until node and client see each other, both ways."""
        if self.images is not None:
            self.until(lambda: self.images.get_subscription_count() > 0, 'no node takes images')
        topics = [self.resolved(topic) for topic in self.heard]
        self.until(lambda: all(map(self.node.count_publishers, topics)), 'outputs are missing')
        # The answer of a service comes after the discovery of everything before it.
        assert self.parameters.wait_for_services(PATIENCE)
        # Subscriptions are announced in the order of their creation: once the last one receives
        # messages, all do. An idle node publishes its state once a second.
        last: list = []
        subscription = self.node.create_subscription(
            DiagnosticStatus, self.resolved('~/state'), last.append, 10)
        self.until(lambda: last and self.heard['~/state'], 'no state was heard')
        self.node.destroy_subscription(subscription)
        return self

    def send(self, frame: np.ndarray, stamp: int, encoding: str | None = None,
             answered: bool = True) -> object:
        """Send a frame; wait for its detections, and return them."""
        message = image_message(frame, stamp, encoding)
        return self.send_message(message, answered)

    def send_message(self, message: object, answered: bool = True) -> object:
        """Send an image message; wait for the detections of its stamp, and return them."""
        heard = self.heard['detections']
        before = len(heard)
        self.images.publish(message)
        if not answered:
            return None
        self.until(lambda: len(heard) > before, 'no answer to an image')
        assert heard[-1].header == message.header, (
            message.header.stamp, [answer.header.stamp for answer in heard[before - 1:]])
        return heard[-1]

    def state_after(self, answer: object) -> dict:
        """Return the state after an answered frame: its message as ``state``, and its values."""
        stamp = f'{answer.header.stamp.sec}.{answer.header.stamp.nanosec:09d}'
        found: dict = {}

        def heard() -> bool:
            for status in self.heard['~/state'][-20:]:
                values = {row.key: row.value for row in status.values}
                if values.get('stamp') == stamp:
                    found.update(values, state=status.message, level=status.level)
            return bool(found)
        self.until(heard, f'no state of {stamp}')
        return found

    def play(self, scene: Scene, indices, stamp: int = 10**9) -> list:
        """Send frames of a scene one by one; return the detections."""
        return [self.send(scene.frame(i), stamp + STEP * i) for i in indices]

    def call(self, future) -> object:
        """Wait for the answer of a service."""
        self.until(future.done, 'no answer to a service call')
        return future.result()

    def change(self, **values: object) -> list:
        """Set parameters one by one; return the results."""
        rows = [Parameter(name.replace('__', '.'), value=value)
                for name, value in values.items()]
        return self.call(self.parameters.set_parameters(rows)).results

    def set_atomically(self, **values: object) -> object:
        """Set parameters all or none; return the result."""
        rows = [Parameter(name.replace('__', '.'), value=value)
                for name, value in values.items()]
        return self.call(self.parameters.set_parameters_atomically(rows)).result

    def get(self, *names: str) -> list:
        """Return the values of parameters."""
        from rclpy.parameter import parameter_value_to_python
        values = self.call(self.parameters.get_parameters(list(names))).values
        return [parameter_value_to_python(value) for value in values]

    def ask(self, service: str, kind: type, **fields: object) -> object:
        """Call a service of the node."""
        client = self.node.create_client(kind, self.resolved(service))
        assert client.wait_for_service(PATIENCE)
        answer = self.call(client.call_async(kind.Request(**fields)))
        self.node.destroy_client(client)
        return answer

    def __enter__(self) -> Client:
        """Return the client."""
        return self

    def __exit__(self, *_: object) -> None:
        """Take everything down."""
        self.executor.shutdown()
        leave(self.node)
        rclpy.try_shutdown(context=self.context)


def overlap(detections, box: Box) -> float:
    """Return the IoU of the only detection with a box; 0 where there's none."""
    if not detections.detections:
        return 0.0
    bounds = detections.detections[0].bbox
    center = bounds.center.position
    return Box.from_center(center.x, center.y, bounds.size_x, bounds.size_y).iou(box)


def diagnosis(client, name, wanted):
    """Wait for a wanted row of /diagnostics; return its level, message and values."""
    heard = client.heard['/diagnostics']
    found = []

    def look():
        for array in heard:
            assert array.header.stamp.sec > 0 or array.header.stamp.nanosec > 0
            for row in array.status:
                values = {pair.key: pair.value for pair in row.values}
                if row.name == name and wanted(row, values):
                    found.append((row.level, row.message, values))
        del heard[:]
        return bool(found)
    client.until(look, f'no such diagnosis of {name}')
    return found[-1]
