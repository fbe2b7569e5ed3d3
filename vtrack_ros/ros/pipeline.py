"""From image to pose: what the plain and the managed node share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from vtrack_ros.geometry.camera import Camera, locate, Position
from vtrack_ros.messages.camera_info import camera_from_info
from vtrack_ros.messages.images import compressed_to_frame, stamp_nanoseconds, to_frame
from vtrack_ros.ros import messages
from vtrack_ros.ros.controls import Controls
from vtrack_ros.ros.health import Health
from vtrack_ros.ros.outputs import optional, Outputs
from vtrack_ros.ros.parameters import ParameterServer, Settings
from vtrack_ros.ros.qos import ImageInput
from vtrack_ros.ros.quiet_log import QuietLog
from vtrack_ros.ros.target import Target
from vtrack_ros.ros.view import DebugView
from vtrack_ros.trackers import Estimate, Frame


class Pipeline:
    """
    Follows the target through the images that a node receives, and publishes where it is.

    Parameters
    ----------
    node : rclpy.node.Node
    server : ParameterServer

    """

    def __init__(self, node: Node, server: ParameterServer) -> None:
        self._node = node
        self._server = server
        self._log = node.get_logger()
        self._quiet = QuietLog(self._log)
        self._camera: Camera | None = None
        self._view = DebugView()
        self._word = 'inactive'
        self._units = ''
        vision = optional(
            'vision_msgs', 'there are no boxes, and targets come by ~/init_roi or init_box', node)
        self._target = Target(server.settings, self._log)
        self._outputs = Outputs(node, vision)
        self._controls = Controls(node, vision, self._target, self._changed)
        self._controls.listen_to_detector(bool(server.settings.node['init_from_detections']))
        self._health = Health(node, self._outputs, self._state)
        self._compressed = server.settings.text('image_transport') == 'compressed'
        self._convert: Callable[[Any], Frame] = (
            compressed_to_frame if self._compressed else to_frame)
        self._camera_input = node.create_subscription(
            CameraInfo, 'camera_info', self._on_camera_info, 1)
        server.listener = self._on_parameters

    def activate(self) -> None:
        """Begin to take images."""
        self._health.input = ImageInput(
            self._node, CompressedImage if self._compressed else Image,
            'image/compressed' if self._compressed else 'image',
            self._server.settings.text('reliability'), self.on_image)
        self._log.info(f'images are taken from {self._health.input.topic}; '
                       + self._controls.invitation(self._server.settings.init_box is not None))
        self._changed()

    def deactivate(self) -> None:
        """Take no more images; the target is kept."""
        if self._health.input is not None:
            self._health.input.destroy()
            self._health.input = None
            self._health.flow.interrupt()
        self._changed()

    def destroy(self) -> None:
        """Take down all that was set up."""
        self.deactivate()
        self._server.listener = None
        self._node.destroy_subscription(self._camera_input)
        self._health.destroy()
        self._controls.destroy()
        self._outputs.destroy()

    def on_image(self, message: Any, info: Any) -> None:
        """Take the next image; one that can't be read is counted, and nothing else happens."""
        began = time.perf_counter_ns()
        flow, header = self._health.flow, message.header
        stamp = stamp_nanoseconds(header.stamp)
        if self._controls.paused:
            self._arrived(stamp, began)
            return
        try:
            frame = self._convert(message)
        except ValueError as error:
            flow.spoilt(stamp, began, str(error))
            self._quiet.error(f'image dropped: {error}')
            return
        self._arrived(stamp, began)
        started = time.perf_counter_ns()
        estimate = self._target.update(frame, stamp)
        compute = (time.perf_counter_ns() - started) / 1e6
        if estimate is not None and estimate.measured:
            self._publish_place(header, frame, estimate)
        self._outputs.publish_boxes(header, estimate, self._target.identity)
        flow.processing.append((time.perf_counter_ns() - began) / 1e6)
        sent = int(info['source_timestamp'])
        latency = (time.time_ns() - sent) / 1e6 if sent else float('nan')
        if sent:
            flow.latency.append(latency)
        self._note_change()
        self._health.publish_state(lambda: self._state({
            'stamp': f'{header.stamp.sec}.{header.stamp.nanosec:09d}',
            'ms_per_frame': f'{compute:.3f}', 'image_sent': str(sent),
            'latency_ms': f'{latency:.3f}'}))
        self._outputs.publish_particles(header, estimate)
        self._view.note(estimate, self._target.identity)
        self._outputs.publish_debug(
            header, lambda: self._view.draw(frame, estimate, self._word))

    def _publish_place(self, header: Any, frame: Frame, estimate: Estimate) -> None:
        position = self._position(frame, estimate)
        if position is None:
            self._units = ''
            return
        self._units = position.units
        self._outputs.publish_pose(header, position, estimate.angle)
        child = self._server.settings.text('target_frame')
        if child and position.units == 'metres':
            self._outputs.publish_transform(header, position, estimate.angle, child)

    def _position(self, frame: Frame, estimate: Estimate) -> Position | None:
        settings, camera = self._server.settings, self._camera
        height, width = frame.shape[:2]
        if camera is not None and (camera.width, camera.height) != (width, height):
            self._quiet.warning(
                f'camera_info is for {camera.width} x {camera.height}, but the image is '
                f'{width} x {height}: it is not used')
            camera = None
        units = settings.text('pose_units')
        position = locate(estimate.box, estimate.covariance, camera, units,
                          settings.number('target_width'), settings.number('target_height'))
        if position is None:
            needed = 'camera_info of the image, a box within the reach of its lens model'
            if units == 'metres':
                needed += ', and target_width or target_height'
            self._quiet.warning(f'no pose: pose_units {units} needs {needed}')
        return position

    def _arrived(self, stamp: int, now: int) -> None:
        if self._health.flow.arrived(stamp, now):
            self._log.warning('the stamps went backwards: another stream begins')
            self._target.begin_stream()

    def _changed(self) -> None:
        """Say what the state is now: something was done to it between two frames."""
        self._note_change()
        self._health.publish_state(self._state)

    def _note_change(self) -> None:
        """Say in the log that the state changed, if it did."""
        word = self._target.word
        if self._health.input is None:
            word = 'inactive'
        elif self._controls.paused:
            word = 'paused'
        if word == self._word:
            return
        before, self._word = self._word, word
        text = f'{self._target.tracker}: {word}, after {before}'
        if word in ('searching', 'lost'):
            self._log.warning(text)
        else:
            self._log.info(text)

    def _state(self, values: dict[str, str] | None = None) -> DiagnosticStatus:
        flow = self._health.flow
        return messages.state_status(
            self._node.get_fully_qualified_name(), self._target.tracker, self._word,
            self._target.estimate, {
                **(values or {}), 'pose_units': self._units,
                'frames_received': str(flow.received), 'frames_missing': str(flow.missing),
                'frames_malformed': str(flow.malformed)},
            stale=self._word in ('paused', 'inactive') or self._health.stale)

    def _on_camera_info(self, message: CameraInfo) -> None:
        try:
            self._camera = camera_from_info(message)
        except ValueError as error:
            self._camera = None
            pixels = self._server.settings.text('pose_units') in ('auto', 'pixels')
            self._quiet.warning(
                f"{error}; {'the pose stays in pixels' if pixels else 'there is no pose'}")

    def _on_parameters(self, changes: Settings, names: Sequence[str]) -> None:
        settings = self._server.settings
        self._target.change(settings, changes, names)
        self._controls.listen_to_detector(bool(settings.node['init_from_detections']))
        self._changed()
