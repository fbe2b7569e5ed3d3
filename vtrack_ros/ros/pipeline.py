"""From image to pose: the implementation that the plain and the managed node share."""

from collections.abc import Collection
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from vtrack_ros.messages.images import decoded, stamp_nanoseconds
from vtrack_ros.ros.diagnostics import Diagnostics, state_status
from vtrack_ros.ros.message_types import installed, MessageTypes
from vtrack_ros.ros.parameter_node import INIT_BOX, ParameterNode
from vtrack_ros.ros.pose_publisher import PosePublisher, THROTTLE
from vtrack_ros.ros.publishers import Publishers
from vtrack_ros.ros.qos import image_topic, Input
from vtrack_ros.ros.services import Services
from vtrack_ros.ros.state_file import StateFile
from vtrack_ros.session.frame_flow import Arrival
from vtrack_ros.session.history import FrameHistory
from vtrack_ros.session.target import Target


class NodeLog:
    """Writes what a `Target` reports to the node's log."""

    def __init__(self, node: ParameterNode) -> None:
        self._logger = Node.get_logger(node)

    def info(self, text: str) -> None:
        """Log information."""
        self._logger.info(text)

    def warning(self, text: str) -> None:
        """Log a warning."""
        self._logger.warning(text)

    def error(self, text: str) -> None:
        """Log an error."""
        self._logger.error(text)

    def repeated_error(self, text: str) -> None:
        """Log an error that may recur with every frame, throttled."""
        self._logger.error(text, throttle_duration_sec=THROTTLE)


class Pipeline:
    """Tracks the target through the images that a node receives, and publishes where it is."""

    def __init__(self, node: ParameterNode) -> None:
        self._node = node
        self._session = node.session
        self._log = Node.get_logger(node)
        self._state_name = 'inactive'
        types, log = MessageTypes(), NodeLog(node)
        with_vision = installed(
            'vision_msgs', 'no boxes are published, and ~/init is not available', node)
        settings = node.settings
        self._history = FrameHistory(
            settings.number('history_seconds'), settings.number('history_megabytes'))
        self._session.warm_up()
        self._target = Target(self._session, self._history, log)
        self._target.set_init_box(node.init_box, f'parameter {INIT_BOX}')
        self._state_file = StateFile(node, self._target)
        self._publishers = Publishers(node, types, with_vision)
        self._pose_publisher = PosePublisher(node, types, self._publishers)
        self._services = Services(
            node, types, with_vision, self._target, log, self._give_up, self._changed)
        self._services.listen_to_detector(bool(settings['init_from_detections']))
        self._diagnostics = Diagnostics(node, self._publishers, self._state)
        self._camera_info = Input(
            node, CameraInfo, 'camera_info', self._pose_publisher.on_camera_info, latched=True)
        self._watch_inputs()
        node.on_change = self._on_parameters

    def activate(self) -> None:
        """Begin to take images."""
        self._services.active = True
        settings = self._node.settings
        transport = settings.text('image_transport')
        self._diagnostics.images = Input(
            self._node, CompressedImage if transport == 'compressed' else Image,
            image_topic(self._node, transport), self._on_image, settings.text('reliability'))
        self._log.info(f'images are taken from {self._diagnostics.images.topic}; '
                       + ('the target of state_file is looked for in the first'
                          if self._state_file.waits else self._services.invitation()))
        self._changed()

    def deactivate(self) -> None:
        """Take no more images; the target is kept."""
        self._services.active = False
        if self._diagnostics.images is not None:
            self._diagnostics.images.destroy()
            self._diagnostics.images = None
            self._diagnostics.flow.interrupt()
        self._changed()

    def save(self, keep: bool = True) -> None:
        """Save the target for the last time, or, without `keep`, remove the saved one."""
        self._state_file.close(keep)

    def destroy(self) -> None:
        """Take down all that was set up, and forget the target."""
        self.deactivate()
        self.save()
        self._node.on_change = None
        self._session.forget()
        self._camera_info.destroy()
        self._diagnostics.destroy()
        self._services.destroy()
        self._publishers.destroy()

    def _on_image(self, message: Any, info: Any) -> None:
        """Process the next image; one that can't be read is counted, logged and dropped."""
        began = time.perf_counter_ns()
        flow, header = self._diagnostics.flow, message.header
        stamp = stamp_nanoseconds(header.stamp)
        if self._services.paused:
            self._arrived(stamp, began)
            return
        try:
            frame = decoded(message)
        except ValueError as error:
            flow.count_malformed(stamp, began, str(error))
            self._log.error(f'image dropped: {error}', throttle_duration_sec=THROTTLE)
            self._diagnostics.publish_state()
            return
        flow.largest = max(flow.largest, len(message.data))
        if not self._arrived(stamp, began):
            return
        self._history.append(stamp, frame)
        self._state_file.take_up(frame, stamp, header.frame_id)
        started = time.perf_counter_ns()
        estimate = self._target.update(frame, stamp)
        compute = (time.perf_counter_ns() - started) / 1e6
        if estimate is not None and estimate.measured:
            self._pose_publisher.publish(header, frame, estimate)
        identity = self._target.identity
        self._publishers.publish_boxes(header, estimate, identity)
        flow.processing.append((time.perf_counter_ns() - began) / 1e6)
        sent = int(info['source_timestamp'])
        latency = (time.time_ns() - sent) / 1e6 if sent else float('nan')
        if sent:
            flow.latency.append(latency)
        self._note_state()
        self._diagnostics.publish_state(lambda: self._state({
            'stamp': f'{header.stamp.sec}.{header.stamp.nanosec:09d}',
            'ms_per_frame': f'{compute:.3f}', 'image_sent': str(sent),
            'latency_ms': f'{latency:.3f}'}))
        self._publishers.publish_particles(header, estimate)
        self._publishers.publish_debug_image(header, frame, estimate, identity, self._state_name)

    def _arrived(self, stamp: int, now: int) -> bool:
        """Count a frame; return whether it's to be used."""
        arrival = self._diagnostics.flow.arrived(stamp, now)
        if arrival is Arrival.NEXT:
            return True
        if arrival is Arrival.LATE:
            self._log.warning('image dropped: its stamp is before, or far after, the stamp of the '
                              'previous image',
                              throttle_duration_sec=THROTTLE)
            return False
        again = arrival is Arrival.BEGINNING
        kept = self._target.estimate is None or again and self._target.init_box is not None
        self._log.warning('the image stamps went backwards: ' + (
            'a new stream begins' if again else 'the clock was set back') + (
            '' if kept else '; the target is forgotten, select it again'))
        self._history.clear()
        self._target.begin_stream(from_init_box=again)
        return True

    def _give_up(self) -> None:
        """Forget the target, or the one of the state file that waits for the first image."""
        self._state_file.give_up()
        self._target.forget()

    def _changed(self) -> None:
        """Publish the state after a change between two frames, by a service or a parameter."""
        self._watch_inputs()
        self._note_state()
        self._diagnostics.publish_state()
        if self._target.estimate is None:
            self._state_file.save()

    def _note_state(self) -> None:
        """Log a change of the state, if there was one."""
        name = self._target.state_name
        if self._diagnostics.images is None:
            name = 'inactive'
        elif self._services.paused:
            name = 'paused'
        if name == self._state_name:
            return
        before, self._state_name = self._state_name, name
        text = f'{self._session.tracker}: {name} (was {before})'
        if name in ('searching', 'lost'):
            self._log.warning(text)
        else:
            self._log.info(text)

    def _state(self, values: dict[str, str] | None = None) -> DiagnosticStatus:
        flow, estimate = self._diagnostics.flow, self._target.estimate
        name, silent = self._state_name, self._diagnostics.stale
        if silent and estimate is not None and name == estimate.state.value:
            name = 'stale'
        return state_status(
            self._node.get_fully_qualified_name(), self._session.tracker, name, estimate, {
                **(values or {}), 'pose_units': self._pose_publisher.units,
                'frames_received': str(flow.received), 'frames_missing': str(flow.missing),
                'frames_late': str(flow.late), 'frames_malformed': str(flow.malformed)},
            stale=silent or name in ('paused', 'inactive'))

    def _on_parameters(self, names: Collection[str]) -> None:
        settings = self._node.settings
        self._history.seconds = settings.number('history_seconds')
        self._history.megabytes = settings.number('history_megabytes')
        if INIT_BOX in names:
            self._target.set_init_box(self._node.init_box, f'parameter {INIT_BOX}')
        if self._session.failure:
            self._log.warning(
                f'{self._session.tracker} cannot start on the target: it is forgotten '
                f'({self._session.failure})')
        self._services.listen_to_detector(bool(settings['init_from_detections']))
        self._pose_publisher.offer()
        self._changed()

    def _watch_inputs(self) -> None:
        self._diagnostics.inputs = [self._camera_info, *self._services.inputs]
