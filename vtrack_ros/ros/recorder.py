"""Records a tracking node's outputs for every frame."""

from dataclasses import dataclass
import time
from typing import Any, Self

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseArray
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from vision_msgs.msg import Detection2DArray

from vtrack_ros.dds import leave
from vtrack_ros.frame import Array
from vtrack_ros.geometry import Box
from vtrack_ros.messages.images import stamp_nanoseconds
from vtrack_ros.signals import handling_signals
from vtrack_ros.tracker import Estimate, TrackState

#: Largest number of particles that are kept of a frame.
KEPT_PARTICLES = 150


@dataclass
class Answer:
    """
    The node's outputs for one image; None or 0 where nothing was received.

    `received` is when its detections arrived, `sent` when the image was published, both in ns;
    `milliseconds` is the tracker's computing time, `particles` (N, 2) are the centres of the first
    N [px].
    """

    received: int = 0
    estimate: Estimate | None = None
    particles: Array | None = None
    state: str | None = None
    milliseconds: float | None = None
    sent: int = 0

    @property
    def latency(self) -> float | None:
        """Return the time from publishing the image to receiving its detections, [ms]."""
        return (self.received - self.sent) / 1e6 if self.received and self.sent else None


class Recorder:
    """
    A node that subscribes to another one's detections, state and particles; a context manager.

    `answers` are keyed by the image's stamp [ns]; `received` counts the detections messages.
    """

    def __init__(self) -> None:
        self.answers: dict[int, Answer] = {}
        self.received = 0
        self._interrupted = False

    def __enter__(self) -> Self:
        """Subscribe."""
        self._context = Context()
        rclpy.init(args=[], context=self._context,
                   signal_handler_options=rclpy.SignalHandlerOptions.NO)
        # KeyboardInterrupt within the making of a message would come out as another exception.
        self._signals = handling_signals(self._interrupt)
        self._signals.__enter__()
        self._node = rclpy.create_node('recorder', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        qos = QoSProfile(depth=1000)
        self._subscriptions = [
            self._node.create_subscription(kind, topic, hear, qos) for kind, topic, hear in (
                (Detection2DArray, 'detections', self._on_detections),
                (DiagnosticStatus, 'tracker/state', self._on_state),
                (PoseArray, 'tracker/particles', self._on_particles))]
        return self

    def __exit__(self, *_: object) -> None:
        """Leave ROS."""
        self._signals.__exit__(None, None, None)
        leave(self._node)
        rclpy.try_shutdown(context=self._context)

    @property
    def matched(self) -> bool:
        """Return whether all of the topics have a publisher."""
        return all(subscription.get_publisher_count() for subscription in self._subscriptions)

    def listen(self, seconds: float) -> None:
        """Take the next message, if one comes in time; raise KeyboardInterrupt after a signal."""
        self._executor.spin_once(timeout_sec=seconds)
        if self._interrupted:
            raise KeyboardInterrupt

    def _interrupt(self, *_: object) -> None:
        self._interrupted = True

    def _on_detections(self, message: Any) -> None:
        answer = self._answer(message.header)
        answer.received = time.time_ns()
        self.received += 1
        for detection in message.detections[:1]:
            center, bounds = detection.bbox.center.position, detection.bbox
            [result] = detection.results
            answer.estimate = Estimate(
                Box.from_center(center.x, center.y, bounds.size_x, bounds.size_y), 0.0,
                np.reshape(result.pose.covariance, (6, 6))[:2, :2], result.hypothesis.score,
                TrackState.TRACKING)

    def _on_particles(self, message: Any) -> None:
        self._answer(message.header).particles = np.array(
            [[pose.position.x, pose.position.y] for pose in message.poses[:KEPT_PARTICLES]])

    def _on_state(self, message: Any) -> None:
        values = {row.key: row.value for row in message.values}
        if 'stamp' in values:
            seconds, nanoseconds = map(int, values['stamp'].split('.'))
            answer = self.answers.setdefault(seconds * 10**9 + nanoseconds, Answer())
            answer.state = message.message
            answer.milliseconds = float(values['ms_per_frame'])
            answer.sent = int(values['image_sent'])

    def _answer(self, header: Any) -> Answer:
        return self.answers.setdefault(stamp_nanoseconds(header.stamp), Answer())
