"""The node's output topics: a message is only made where the topic has a subscriber."""

from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import (
    PoseArray, PoseStamped, PoseWithCovarianceStamped, TransformStamped,
    TwistWithCovarianceStamped, Vector3)
import numpy as np
from rclpy.duration import Infinite
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    qos_check_compatible, qos_policy_name_from_kind, QoSCompatibility, QoSProfile)
from sensor_msgs.msg import Image

from vtrack_ros.drawing import AnnotatedFrame, STATES, TRAIL_LENGTH, TRUTH
from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry.camera import Position
from vtrack_ros.messages import detections, poses
from vtrack_ros.messages.images import fill_image
from vtrack_ros.ros.message_types import installed, MessageTypes
from vtrack_ros.tracker import Estimate

#: QoS of the outputs except /tf. The durations are the defaults, in the form the graph reports.
OFFERED = QoSProfile(depth=10, deadline=Infinite, liveliness_lease_duration=Infinite)
#: A velocity (3,) and its covariance (3, 3).
Velocity: TypeAlias = tuple[Array, Array]


class Publishers:
    """The publishers of a tracking node; those of vision_msgs only `with_vision`."""

    def __init__(self, node: Node, types: MessageTypes, with_vision: bool) -> None:
        self._node = node
        self._types = types
        self._faults: dict[str, str] = {}
        self._trail: deque[tuple[float, float]] = deque(maxlen=TRAIL_LENGTH)
        self._identity = ('', '')
        self._with_transforms: bool | None = None
        self._all: list[Any] = []
        self._pose = self._publisher(PoseStamped, 'pose')
        self._covariance = self._publisher(PoseWithCovarianceStamped, 'pose_with_covariance')
        self._twist = self._publisher(TwistWithCovarianceStamped, 'twist')
        self._state = self._publisher(DiagnosticStatus, '~/state')
        self._particles = self._publisher(PoseArray, '~/particles')
        self._debug = self._publisher(Image, '~/debug_image')
        self._transforms: Any = None
        self._detections: Any = None
        self._bounds: Any = None
        if with_vision:
            self._detections = self._publisher(
                types['vision_msgs/msg/Detection2DArray'], 'detections')
            self._bounds = self._publisher(types['vision_msgs/msg/BoundingBox2D'], 'bounding_box')

    @property
    def faults(self) -> tuple[str, ...]:
        """Return the QoS mismatches of subscribers that are still there, one sentence a topic."""
        return tuple(fault for topic, fault in self._faults.items() if any(
            qos_check_compatible(OFFERED, one.qos_profile)[0] == QoSCompatibility.ERROR
            for one in self._node.get_subscriptions_info_by_topic(topic)))

    def publish_pose(self, header: Any, position: Position, angle: float) -> None:
        """Publish a measured pose; the angle is in rad."""
        if self._wanted(self._pose):
            self._pose.publish(PoseStamped(
                header=header, pose=poses.pose(self._types, position.point, angle)))
        if self._wanted(self._covariance):
            self._covariance.publish(PoseWithCovarianceStamped(
                header=header, pose=poses.pose_with_covariance(
                    self._types, position.point, angle, position.covariance)))

    def publish_twist(self, header: Any, make: Callable[[], Velocity | None]) -> None:
        """Publish the velocity that `make` returns with its covariance, if it returns any."""
        velocity = make() if self._wanted(self._twist) else None
        if velocity is not None:
            self._twist.publish(TwistWithCovarianceStamped(
                header=header, twist=poses.twist_with_covariance(self._types, *velocity)))

    def offer_transforms(self) -> None:
        """Create the publisher of /tf; the log says once if tf2_msgs is missing."""
        if self._with_transforms is None:
            # Checked once: a package that isn't installed now won't be later.
            self._with_transforms = installed('tf2_msgs', 'no transform is sent', self._node)
            if self._with_transforms:
                self._transforms = self._node.create_publisher(
                    self._types['tf2_msgs/msg/TFMessage'], '/tf', QoSProfile(depth=100))
                self._all.append(self._transforms)

    def publish_transform(self, header: Any, position: Position, angle: float, child: str) -> None:
        """Publish the transform from the image's frame to the target's, if it's offered."""
        if self._wanted(self._transforms):
            x, y, z = (float(value) for value in position.point)
            transform = TransformStamped(header=header, child_frame_id=child)
            transform.transform.translation = Vector3(x=x, y=y, z=z)
            transform.transform.rotation = poses.rotation(self._types, angle)
            self._transforms.publish(self._types['tf2_msgs/msg/TFMessage'](transforms=[transform]))

    def publish_boxes(self, header: Any, estimate: Estimate | None,
                      identity: tuple[str, str]) -> None:
        """Publish the box if it's measured, and an empty list of detections if it isn't."""
        measured = estimate if estimate is not None and estimate.measured else None
        if self._wanted(self._detections):
            if measured is None:
                found = detections.detections(self._types, header, None)
            else:
                covariance = np.zeros((3, 3))
                covariance[:2, :2] = measured.covariance[:2, :2]
                found = detections.detections(
                    self._types, header, measured.box, measured.angle, measured.confidence,
                    *identity, covariance)
            self._detections.publish(found)
        if measured is not None and self._wanted(self._bounds):
            self._bounds.publish(detections.oriented_box(self._types, measured))

    def publish_state(self, make: Callable[[], DiagnosticStatus]) -> None:
        """Publish the state that `make` returns."""
        if self._wanted(self._state):
            self._state.publish(make())

    def publish_particles(self, header: Any, estimate: Estimate | None) -> None:
        """Publish the particles' centres."""
        if estimate is not None and self._wanted(self._particles):
            self._particles.publish(poses.particle_poses(self._types, header, estimate.particles))

    def publish_debug_image(self, header: Any, frame: Frame, estimate: Estimate | None,
                            identity: tuple[str, str], state_name: str) -> None:
        """Publish the frame with box, ellipse, particles, trail and state drawn on it."""
        if estimate is None or identity != self._identity:
            self._trail.clear()
        self._identity = identity
        if estimate is not None and estimate.measured:
            self._trail.append(estimate.box.center)
        if not self._wanted(self._debug):
            return
        picture = AnnotatedFrame(frame, enlarge=False)
        picture.trail(self._trail)
        if estimate is None:
            picture.text(state_name)
        else:
            picture.estimate(estimate)
            picture.text(f'{state_name} {estimate.confidence:.2f}',
                         STATES.get(estimate.state, TRUTH))
        message = Image(header=header)
        fill_image(message, np.ascontiguousarray(picture.picture))
        self._debug.publish(message)

    def destroy(self) -> None:
        """Take the publishers down."""
        for publisher in self._all:
            self._node.destroy_publisher(publisher)

    def _publisher(self, kind: Any, topic: str) -> Any:
        def on_mismatch(event: Any) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind)
            name = self._node.resolve_topic_name(topic)
            self._faults[name] = (
                f'{name}: a subscriber requests a {policy} that is not offered (QoS mismatch): '
                'it receives nothing; subscribe with reliable or best_effort, and volatile')
            self._node.get_logger().error(self._faults[name])
        publisher = self._node.create_publisher(
            kind, topic, OFFERED,
            event_callbacks=PublisherEventCallbacks(incompatible_qos=on_mismatch))
        self._all.append(publisher)
        return publisher

    @staticmethod
    def _wanted(publisher: Any) -> bool:
        return publisher is not None and publisher.get_subscription_count() > 0
