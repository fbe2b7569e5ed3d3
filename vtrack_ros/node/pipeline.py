"""From image to pose: what the plain and the managed node share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from vtrack_ros.follower import Follower
from vtrack_ros.node.controls import Controls
from vtrack_ros.node.view import DebugView
from vtrack_ros.ros import diagnostics, messages
from vtrack_ros.ros.camera import Camera, locate, Position
from vtrack_ros.ros.images import compressed_to_frame, stamp_nanoseconds, to_frame
from vtrack_ros.ros.outputs import optional, Outputs
from vtrack_ros.ros.parameters import INIT_BOX, ParameterServer
from vtrack_ros.ros.qos import ImageInput
from vtrack_ros.ros.selection import (
    best_detection, FrameHistory, Selection, Selector)
from vtrack_ros.trackers import Estimate, Frame, TrackState

#: At most one line of the same kind in the log in that many seconds.
QUIET = 2.0


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
        settings = server.settings
        self._follower = Follower(
            settings.text('tracker'), int(settings.number('seed')), settings.trackers)
        self._history = FrameHistory(
            settings.number('history_seconds'), settings.number('history_megabytes'))
        self._selector = Selector(self._history)
        self._flow = diagnostics.FrameFlow()
        self._camera: Camera | None = None
        self._view = DebugView()
        self._target, self._targets = ('', ''), 0
        self._paused = False
        self._word = 'waiting'
        self._units = ''
        self._refused = ('', 0.0)
        self._begin_stream()
        vision = optional(
            'vision_msgs', 'there are no boxes, and targets come by ~/init_roi or init_box', node)
        self._outputs = Outputs(node, vision)
        self._controls = Controls(node, vision, self)
        self._controls.listen_to_detector(bool(settings.node['init_from_detections']))
        compressed = settings.text('image_transport') == 'compressed'
        self._convert: Callable[[Any], Frame] = compressed_to_frame if compressed else to_frame
        self._input = ImageInput(
            node, CompressedImage if compressed else Image,
            'image/compressed' if compressed else 'image', settings.text('reliability'),
            self.on_image)
        self._camera_input = node.create_subscription(
            CameraInfo, 'camera_info', self._on_camera_info, 1)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._timer = node.create_timer(1.0, self._on_timer)
        node.add_post_set_parameters_callback(self._on_parameters)

    def destroy(self) -> None:
        """Take down all that was set up."""
        self._node.remove_post_set_parameters_callback(self._on_parameters)
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._diagnostics)
        self._node.destroy_subscription(self._camera_input)
        self._input.destroy()
        self._controls.destroy()
        self._outputs.destroy()

    def on_image(self, message: Any, info: Any) -> None:
        """Take the next image; one that can't be read is counted, and nothing else happens."""
        began = time.perf_counter_ns()
        header = message.header
        stamp = stamp_nanoseconds(header.stamp)
        if self._paused:
            self._arrived(stamp, began)
            return
        try:
            frame = self._convert(message)
        except ValueError as error:
            self._flow.malformed += 1
            self._log.error(f'image dropped: {error}', throttle_duration_sec=QUIET)
            return
        self._arrived(stamp, began)
        self._history.append(stamp, frame)
        started = time.perf_counter_ns()
        estimate = self._track(frame, stamp)
        compute = (time.perf_counter_ns() - started) / 1e6
        if estimate is not None and estimate.measured:
            self._publish_place(header, frame, estimate)
        self._outputs.publish_boxes(header, estimate, self._target)
        self._flow.processing.append((time.perf_counter_ns() - began) / 1e6)
        sent = info['source_timestamp']
        if sent:
            self._flow.latency.append((time.time_ns() - sent) / 1e6)
        self._change_word('waiting' if estimate is None else estimate.state.value)
        self._outputs.publish_state(lambda: self._state({
            'stamp': f'{header.stamp.sec}.{header.stamp.nanosec:09d}',
            'ms_per_frame': f'{compute:.3f}',
            'image_sent': str(sent),
            'latency_ms': f'{self._flow.latency[-1]:.3f}' if sent else ''}))
        self._outputs.publish_particles(header, estimate)
        self._view.note(estimate)
        self._outputs.publish_debug(
            header, lambda: self._view.draw(frame, estimate, self._word))

    def select(self, selection: Selection) -> None:
        """Take a target; raises ValueError if its frame can't be had."""
        self._selector.select(selection)

    def refuse(self, source: str, error: Exception) -> None:
        """Say that a selection was wrong; the tracking goes on as it was."""
        text, now = f'{source} refused: {error}', time.monotonic()
        if text != self._refused[0] or now > self._refused[1] + QUIET:
            self._refused = text, now
            self._log.error(text)

    def detected(self, message: Any) -> None:
        """Take the best detection of the wanted class while there is no target, or it's lost."""
        estimate = self._follower.estimate
        if self._selector.pending is not None or (
                estimate is not None and estimate.state is not TrackState.LOST):
            return
        settings = self._server.settings
        best = best_detection(message, settings.text('init_class'),
                              settings.number('init_score'), '~/init_detections')
        if best is not None:
            try:
                self.select(best)
            except ValueError as error:
                self.refuse('~/init_detections', error)

    def reset(self) -> str:
        """Forget the target."""
        self._follower.forget()
        self._selector.clear()
        self._change_word('paused' if self._paused else 'waiting')
        return 'the target is forgotten; select a new one'

    def enable(self, on: bool) -> str:
        """Go on, or pause: no image is looked at, and nothing is published."""
        self._paused = not on
        estimate = self._follower.estimate
        going_on = 'waiting' if estimate is None else estimate.state.value
        self._change_word(going_on if on else 'paused')
        return 'tracking is on' if on else 'tracking is paused'

    def reinit(self) -> str | None:
        """Learn the target afresh where it was last measured."""
        estimate = self._follower.restart()
        if estimate is None:
            return None
        self._change_word(estimate.state.value)
        return 'started again on the last good box'

    def _track(self, frame: Frame, stamp: int) -> Estimate | None:
        had_target = self._follower.estimate is not None
        try:
            estimate = self._started() or self._follower.update(frame, stamp)
        except Exception as error:
            # Whatever a tracker comes across in the pixels, the node must outlive it.
            self._log.error(f'tracker {self._follower.tracker} failed, the target is forgotten: '
                            f'{type(error).__name__}: {error}', throttle_duration_sec=QUIET)
            self._follower.forget()
            return None
        if had_target and estimate is None:
            self._log.warning('the stamps or the image size changed: the target is forgotten')
        return estimate

    def _started(self) -> Estimate | None:
        """Start on the selection whose frame is there; None where there's none."""
        source = getattr(self._selector.pending, 'source', '')
        try:
            ready = self._selector.ready()
            if ready is None:
                return None
            selection, frames = ready
            (stamp, frame), later = frames[0], frames[1:]
            self._follower.start(frame, stamp, selection.box_on(frame))
        except ValueError as error:
            self.refuse(source, error)
            return None
        for stamp, frame in later:
            self._follower.update(frame, stamp)
        self._targets += 1
        self._target = (selection.class_id or 'target',
                        selection.target_id or str(self._targets))
        self._view.clear()
        box = selection.box
        self._log.info(
            f'{selection.source}: started {self._follower.tracker} on the box at '
            f'({box.x:g}, {box.y:g}) of {box.width:g} x {box.height:g} px')
        return self._follower.estimate

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
            self._log.warning(
                f'camera_info is for {camera.width} x {camera.height}, but the image is '
                f'{width} x {height}: it is not used', throttle_duration_sec=QUIET)
            camera = None
        units = settings.text('pose_units')
        position = locate(estimate, camera, units, settings.number('target_width'),
                          settings.number('target_height'))
        if position is None:
            self._log.warning(
                f'no pose: {units} need camera_info of the image'
                + (' and target_width or target_height' if units == 'metres' else ''),
                throttle_duration_sec=QUIET)
        return position

    def _arrived(self, stamp: int, now: int) -> None:
        if self._flow.arrived(stamp, now):
            self._log.warning('the stamps went backwards: another stream begins')
            self._begin_stream()

    def _begin_stream(self) -> None:
        """Forget what belongs to another stream, and wait for the target of this one."""
        self._follower.forget()
        self._selector.clear()
        self._history.clear()
        box = self._server.settings.init_box
        if box is not None:
            self._selector.select(Selection(box, 'parameter init_box'))

    def _change_word(self, word: str) -> None:
        """Say in the log that the state changed."""
        if word == self._word:
            return
        before, self._word = self._word, word
        text = f'{self._follower.tracker}: {word}, after {before}'
        if word in ('searching', 'lost'):
            self._log.warning(text)
        else:
            self._log.info(text)

    def _state(self, values: dict[str, str]) -> DiagnosticStatus:
        return messages.state_status(
            self._node.get_fully_qualified_name(), self._follower.tracker, self._word,
            self._follower.estimate, {
                **values, 'pose_units': self._units,
                'frames_received': str(self._flow.received),
                'frames_missing': str(self._flow.missing),
                'frames_malformed': str(self._flow.malformed)})

    def _on_camera_info(self, message: CameraInfo) -> None:
        try:
            self._camera = Camera.from_message(message)
        except ValueError as error:
            self._camera = None
            self._log.warning(f'{error}; the pose stays in pixels', throttle_duration_sec=30.0)

    def _on_parameters(self, parameters: Sequence[Any]) -> None:
        changes, names = self._server.take(parameters)
        seed = changes.node.get('seed')
        tracker = changes.node.get('tracker')
        self._follower.change(
            None if tracker is None else str(tracker), None if seed is None else int(seed),
            changes.trackers)
        settings = self._server.settings
        self._history.seconds = settings.number('history_seconds')
        self._history.megabytes = settings.number('history_megabytes')
        self._controls.listen_to_detector(bool(settings.node['init_from_detections']))
        if INIT_BOX in names:
            pending = self._selector.pending
            if changes.init_box is not None:
                self._selector.select(Selection(changes.init_box, 'parameter init_box'))
            elif pending is not None and pending.source == 'parameter init_box':
                self._selector.clear()

    def _on_timer(self) -> None:
        self._input.check()
        now = time.perf_counter_ns()
        faults = (*self._input.faults, *self._outputs.mismatches.faults)
        if self._flow.silence(now) > 1:
            self._outputs.publish_state(lambda: self._state({}))
        if self._diagnostics.get_subscription_count() == 0:
            return
        name = self._node.get_fully_qualified_name()
        level, text, values = diagnostics.report(
            self._flow, now, faults, self._input.publishers, self._input.topic)
        values['reliability'] = self._input.reliability
        values['lost by the middleware'] = str(self._input.lost)
        values['QoS mismatches'] = '; '.join(faults) or 'none'
        self._diagnostics.publish(diagnostics.array(
            self._node.get_clock().now().to_msg(),
            [diagnostics.status(f'{name}: images', level, text, values), self._state({})]))
