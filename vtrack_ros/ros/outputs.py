"""The node's output topics: nothing is made that nobody listens to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import (
    PoseArray, PoseStamped, PoseWithCovarianceStamped, TransformStamped)
import numpy as np
from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image

from vtrack_ros.geometry.camera import Position
from vtrack_ros.messages.images import fill_image
from vtrack_ros.ros import messages
from vtrack_ros.ros.qos import OutputFaults
from vtrack_ros.trackers import Estimate, Frame

#: What every output offers; the durations are the defaults, but said as the graph says them.
OFFERED = QoSProfile(depth=10, deadline=Infinite, liveliness_lease_duration=Infinite)


def optional(package: str, lost: str, node: Node) -> Any:
    """Import the messages of a package that a node can live without; None where it's missing."""
    try:
        return __import__(f'{package}.msg', fromlist=['msg'])
    except ImportError:
        dashed = package.replace('_', '-')
        built = ', or run scripts/setup' if package == 'vision_msgs' else ''
        node.get_logger().warning(
            f'{package} is not installed: {lost}. Install ros-jazzy-{dashed} (apt){built}')
        return None


class Outputs:
    """
    The publishers of a tracking node.

    Parameters
    ----------
    node : rclpy.node.Node
    vision : module or None
        vision_msgs.msg, where it's installed.

    """

    def __init__(self, node: Node, vision: Any) -> None:
        self._node = node
        self._vision = vision
        self.mismatches = OutputFaults(node, OFFERED)
        self._pose = self._publisher(PoseStamped, 'pose')
        self._covariance = self._publisher(
            PoseWithCovarianceStamped, 'pose_with_covariance')
        self._state = self._publisher(DiagnosticStatus, '~/state')
        self._particles = self._publisher(PoseArray, '~/particles')
        self._debug = self._publisher(Image, '~/debug_image')
        self._detections: Any = None
        self._bounds: Any = None
        self._tf2: Any = None
        self._transforms: Any = None
        if vision is not None:
            self._detections = self._publisher(vision.Detection2DArray, 'detections')
            self._bounds = self._publisher(vision.BoundingBox2D, 'bounding_box')

    def publish_pose(self, header: Any, position: Position, angle: float) -> None:
        """Publish a measured pose; the angle is in rad."""
        pose = None
        x, y, z = (float(value) for value in position.point)
        if self._wanted(self._pose):
            pose = messages.pose((x, y, z), angle)
            self._pose.publish(PoseStamped(header=header, pose=pose))
        if self._wanted(self._covariance):
            message = PoseWithCovarianceStamped(header=header)
            message.pose.pose = pose or messages.pose((x, y, z), angle)
            message.pose.covariance = messages.covariance36(position.covariance)
            self._covariance.publish(message)

    def publish_transform(self, header: Any, position: Position, angle: float,
                          child: str) -> None:
        """Publish the transform from the image's frame to the target's, given tf2_msgs."""
        if self._tf2 is None:
            # Only asked for once: what isn't installed now won't be later.
            self._tf2 = optional('tf2_msgs', 'no transform is sent', self._node) or False
            if self._tf2:
                self._transforms = self._node.create_publisher(
                    self._tf2.TFMessage, '/tf', QoSProfile(depth=100))
        if not self._wanted(self._transforms):
            return
        transform = TransformStamped(header=header, child_frame_id=child)
        place = transform.transform.translation
        place.x, place.y, place.z = (float(value) for value in position.point)
        transform.transform.rotation = messages.rotation(angle)
        self._transforms.publish(self._tf2.TFMessage(transforms=[transform]))

    def publish_boxes(self, header: Any, estimate: Estimate | None,
                      target: tuple[str, str]) -> None:
        """
        Publish the box if it's measured, and no detection if it isn't.

        Parameters
        ----------
        header : std_msgs/msg/Header
            The image's.
        estimate : Estimate or None
            What the tracker knows.
        target : tuple of str
            The target's class and id.

        """
        measured = estimate if estimate is not None and estimate.measured else None
        if self._wanted(self._detections):
            array = self._vision.Detection2DArray(header=header)
            if measured is not None:
                array.detections = [self._detection(header, measured, target)]
            self._detections.publish(array)
        if measured is not None and self._wanted(self._bounds):
            bounds = self._vision.BoundingBox2D()
            messages.fill_oriented(bounds, measured)
            self._bounds.publish(bounds)

    def publish_state(self, make: Callable[[], DiagnosticStatus]) -> None:
        """Publish the state that `make` returns."""
        if self._wanted(self._state):
            self._state.publish(make())

    def publish_particles(self, header: Any, estimate: Estimate | None) -> None:
        """Publish the particles' centres."""
        if estimate is not None and self._wanted(self._particles):
            self._particles.publish(messages.particle_poses(header, estimate.particles))

    def publish_debug(self, header: Any, draw: Callable[[], Frame]) -> None:
        """Publish the picture that `draw` returns."""
        if self._wanted(self._debug):
            message = Image(header=header)
            fill_image(message, np.ascontiguousarray(draw()))
            self._debug.publish(message)

    def destroy(self) -> None:
        """Take the publishers down."""
        found = [self._pose, self._covariance, self._state, self._particles, self._debug,
                 self._detections, self._bounds, self._transforms]
        for publisher in found:
            if publisher is not None:
                self._node.destroy_publisher(publisher)

    def _detection(self, header: Any, estimate: Estimate, target: tuple[str, str]) -> Any:
        detection = self._vision.Detection2D(header=header, id=target[1])
        messages.fill_bounds(detection.bbox, estimate.box)
        result = self._vision.ObjectHypothesisWithPose()
        result.hypothesis.class_id = target[0]
        result.hypothesis.score = float(estimate.confidence)
        cx, cy = estimate.box.center
        result.pose.pose = messages.pose((cx, cy, 0.0), estimate.angle)
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = estimate.covariance[:2, :2]
        result.pose.covariance = messages.covariance36(covariance)
        detection.results = [result]
        return detection

    def _publisher(self, kind: Any, topic: str) -> Any:
        return self._node.create_publisher(
            kind, topic, OFFERED, event_callbacks=self.mismatches.callbacks(topic))

    @staticmethod
    def _wanted(publisher: Any) -> bool:
        return publisher is not None and publisher.get_subscription_count() > 0
