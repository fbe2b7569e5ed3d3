"""The target's pose and velocity, published in the units that are available."""

from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo

from vtrack_ros.frame import Array, Frame
from vtrack_ros.geometry import Box
from vtrack_ros.geometry.camera import Camera, locate, locate_velocity, Position
from vtrack_ros.messages import poses
from vtrack_ros.messages.camera_info import camera_from_info
from vtrack_ros.messages.images import stamp_nanoseconds
from vtrack_ros.ros.message_types import MessageTypes
from vtrack_ros.ros.parameter_node import ParameterNode
from vtrack_ros.ros.publishers import Publishers, Velocity
from vtrack_ros.session.motion_filter import LONGEST_FORECAST
from vtrack_ros.tracker import Estimate

#: Least interval between log messages that could recur with every frame, in seconds.
THROTTLE = 2.0
#: Time, [s], by which an image may be stamped ahead of the node's clock without a warning.
_CLOCKS_APART = 0.05
#: Number of different faults of the calibration that are logged.
_MOST_FAULTS = 20
#: The covariance of a box that is known exactly.
_EXACT = np.zeros((4, 4))


class PosePublisher:
    """
    Publishes pose, twist and transform of the target that a node's session measures.

    `units` are those of the latest pose, empty if the latest frame gave none.
    """

    def __init__(self, node: ParameterNode, types: MessageTypes, publishers: Publishers) -> None:
        self._node = node
        self._log = Node.get_logger(node)
        self._types = types
        self._publishers = publishers
        self._camera: Camera | None = None
        self._faults: set[str] = set()
        self.units = self._logged_units = ''
        self.offer()

    def offer(self) -> None:
        """Create /tf, if wanted, before images come, for importing its type takes a while."""
        if self._node.settings.text('target_frame'):
            self._publishers.offer_transforms()

    def publish(self, header: Any, frame: Frame, estimate: Estimate) -> None:
        """Publish the target measured in a frame with this header, or its prediction for now."""
        ahead, age = self._published_at(header)
        motion = self._node.session.motion(age) if age else None
        if motion is not None:
            header = ahead
        located = partial(self._located, self._camera_of(frame))
        position = (located(estimate.upright, estimate.covariance) if motion is None else
                    located(motion.box, motion.covariance[:4, :4]))
        if position is None:
            self.units = ''
            self._warn_of_no_pose()
            return
        self.units = position.units
        if position.units != self._logged_units:
            before, self._logged_units = self._logged_units, position.units
            self._log.info(f'pose units: {position.units}' + (before and f' (was {before})'))
        self._publishers.publish_pose(header, position, estimate.angle)

        def velocity() -> Velocity | None:
            moving = motion or self._node.session.motion()
            return None if moving is None else locate_velocity(
                located, moving.box, moving.velocity, moving.covariance)
        self._publishers.publish_twist(header, velocity)
        child = self._node.settings.text('target_frame')
        if not child or position.units != 'metres':
            return
        if header.frame_id in ('', child):
            # tf2 takes no such transform
            self._log.warning(f'no transform to target_frame {child}: the images have the '
                              f'frame_id {header.frame_id!r}', throttle_duration_sec=THROTTLE)
        else:
            self._publishers.publish_transform(header, position, estimate.angle, child)

    def on_camera_info(self, message: CameraInfo) -> None:
        """Take a calibration; a wrong one is dropped, and the log says why, once each."""
        try:
            self._camera = camera_from_info(message)
        except ValueError as error:
            self._camera = None
            pixels = self._node.settings.text('pose_units') in ('auto', 'pixels')
            fault = f"{error}; {'the pose is in pixels' if pixels else 'there is no pose'}"
            if fault not in self._faults and len(self._faults) < _MOST_FAULTS:
                # the driver of an uncalibrated camera sends this with every image
                self._faults.add(fault)
                self._log.warning(fault)

    def _published_at(self, header: Any) -> tuple[Any, float]:
        """Return the header to publish with, and how far it is ahead of the image [s]."""
        if not self._node.settings['predict_to_now']:
            return header, 0.0
        now = self._node.get_clock().now().nanoseconds
        age = (now - stamp_nanoseconds(header.stamp)) / 1e9
        if 0 <= age <= LONGEST_FORECAST:
            return poses.header(self._types, now, header.frame_id), age
        if not now:
            self._log.warning(
                'predict_to_now: use_sim_time is true, but /clock has had no time yet: published '
                'without prediction', throttle_duration_sec=THROTTLE)
            return header, 0.0
        if -_CLOCKS_APART <= age < 0:
            return header, 0.0
        self._log.warning(
            f'predict_to_now: the image is stamped {abs(age):.3f} s '
            f'{"before" if age > 0 else "after"} the node\'s current time, but poses are '
            f'predicted by 0 to {LONGEST_FORECAST:g} s only: published without prediction',
            throttle_duration_sec=THROTTLE)
        return header, 0.0

    def _camera_of(self, frame: Frame) -> Camera | None:
        """Return the calibrated camera, None if its images aren't of the frame's size."""
        camera = self._camera
        height, width = frame.shape[:2]
        if camera is not None and (camera.width, camera.height) != (width, height):
            self._log.warning(
                f'camera_info is not used: it is for {camera.width} x {camera.height}, but the '
                f'image is {width} x {height}', throttle_duration_sec=THROTTLE)
            camera = None
        return camera

    def _located(self, camera: Camera | None, box: Box,
                 covariance: Array = _EXACT) -> Position | None:
        settings = self._node.settings
        return locate(box, covariance, camera, settings.text('pose_units'),
                      settings.number('target_width'), settings.number('target_height'))

    def _warn_of_no_pose(self) -> None:
        units = self._node.settings.text('pose_units')
        needed = 'camera_info of the image, a box within the range of its distortion model'
        if units == 'metres':
            needed += ', and target_width or target_height'
        self._log.warning(f'no pose: pose_units {units} needs {needed}',
                          throttle_duration_sec=THROTTLE)
