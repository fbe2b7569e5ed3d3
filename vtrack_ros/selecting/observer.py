"""What a page shows: a tracking node's images, matched with its answers (its detections)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseArray
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_parameter_events
from sensor_msgs.msg import CompressedImage, Image
from vision_msgs.msg import Detection2DArray

from vtrack_ros.drawing import TRAIL_LENGTH
from vtrack_ros.messages.images import stamp_nanoseconds
from vtrack_ros.ros.qos import Input

if TYPE_CHECKING:
    from vtrack_ros.selecting.recording import Recording

#: Buffer length of the newest images and answers, each of which may wait for the other.
_BUFFER_LENGTH = 8
#: Queue depth of images and answers: a recording holds the executor up, its first image longest.
_DEPTH = 30
#: An answer is shown on a later image only if their stamps differ by less, in nanoseconds.
_RECENT = 1_000_000_000
#: The values of ~/state that the page shows.
_SHOWN = ('confidence', 'ms_per_frame')
_KINDS: dict[str, Any] = {
    'sensor_msgs/msg/Image': Image, 'sensor_msgs/msg/CompressedImage': CompressedImage,
    'vision_msgs/msg/Detection2DArray': Detection2DArray}


class Observer:
    """
    Listens to one tracking node, whose topics are looked up in the graph.

    Images are only received while `watched`, particles only while also `wanted`: the node makes
    none without a subscriber. Callbacks run in the executor's thread: `changed` is called there
    when there's something new to show, `said` with each warning or error that the node logs,
    `configured` with the values by name of parameters that anyone has set.
    """

    def __init__(self, node: Node, target: str, changed: Callable[[], None],
                 said: Callable[[str], None],
                 configured: Callable[[dict[str, Any]], None]) -> None:
        self._node = node
        self._target = target
        self._changed, self._said, self._configured = changed, said, configured
        self._images: deque[Any] = deque(maxlen=_BUFFER_LENGTH)
        self._answers: deque[Any] = deque(maxlen=_BUFFER_LENGTH)
        self._trail: deque[tuple[float, float]] = deque(maxlen=TRAIL_LENGTH)
        self._identity = ''
        self._state: dict[str, str] = {}
        self._inputs: dict[str, Input] = {}
        self._sources: dict[str, tuple[str, str]] = {}
        self._particles: Any = None
        self._recording: Recording | None = None
        self.watched = self.wanted = False
        self._inputs['state'] = Input(node, DiagnosticStatus, f'{target}/state', self._on_state)
        self._events = [
            node.create_subscription(Log, '/rosout', self._on_log, 10),
            node.create_subscription(ParameterEvent, '/parameter_events', self._on_parameters,
                                     qos_profile_parameter_events)]
        self._timer = node.create_timer(0.5, self.look)

    def look(self) -> None:
        """Query the graph: find the node's topics, and adapt the subscriptions."""
        wanted = self.watched and self.wanted
        # first, for the camera may go on where the node has ended
        if not self.watched:
            self._unsubscribe('image')
            self._images.clear()
            self._end_recording('nobody watches')
        if not wanted:
            self._unsubscribe('particles')
            self._particles = None
        name, _, base = self._target.rpartition('/')
        name = name or '/'
        try:
            outputs = self._node.get_publisher_names_and_types_by_node(base, name)
            inputs = self._node.get_subscriber_names_and_types_by_node(base, name)
        except NodeNameNonExistentError:
            # its images may go on, and what it said of the target is no longer true
            if self._state:
                self._state = {}
                self._changed()
            return
        self._subscribe('answer', outputs, ('vision_msgs/msg/Detection2DArray',), self._on_answer)
        if self.watched:
            self._subscribe(
                'image', inputs, ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage'),
                self._on_image)
        if wanted and 'particles' not in self._inputs:
            self._inputs['particles'] = Input(
                self._node, PoseArray, f'{self._target}/particles', self._on_particles)
        for one in self._inputs.values():
            one.check()

    @property
    def state(self) -> dict[str, str]:
        """Return the node's state: its `name`, `tracker` and so on; empty without a node."""
        return dict(self._state)

    @property
    def recording(self) -> bool:
        """Return whether a recording is being made."""
        return self._recording is not None

    def picture(self) -> tuple[Any, dict[str, Any]] | None:
        """
        Return the image to show, with its state, box, trail and so on; None before the first.

        It's the newest one that the node has answered, or the newest of all if none that's kept
        is answered, such as while the node is paused.
        """
        # copies, for the executor's thread changes the buffers
        images, answers, particles = tuple(self._images), tuple(self._answers), self._particles
        if not images:
            return None
        message, answer = _answered(images, answers) or (
            images[-1], answers[-1] if answers else None)
        shown: dict[str, Any] = {'state': self.state, 'trail': list(self._trail),
                                 'recording': self.recording}
        stamp = stamp_nanoseconds(message.header.stamp)
        if answer and 0 <= stamp - stamp_nanoseconds(answer.header.stamp) < _RECENT:
            shown |= _of_detection(answer)
            if particles is not None:
                shown['particles'] = [[round(one.position.x, 1), round(one.position.y, 1)]
                                      for one in particles.poses]
        shown['stamp'] = str(stamp)
        return message, shown

    def record(self, folder: Path) -> str:
        """Start recording to a bag in a folder; BagError if it can't be written."""
        if self._recording is None:
            try:
                # Imported here, for nothing else needs rosbags.
                from vtrack_ros.selecting.recording import Recording
            except ModuleNotFoundError as error:
                raise ModuleNotFoundError(
                    f"recording needs rosbags: pip install 'vtrack_ros[tools]' ({error})"
                ) from None
            self._recording = Recording(folder)
            self._changed()
        return 'recording'

    def finish_recording(self) -> str:
        """Complete the bag, if there is one, and say where it is."""
        recording, self._recording = self._recording, None
        if recording is None:
            return ''
        self._changed()
        return recording.finish()

    def destroy(self) -> None:
        """Take everything down."""
        self.finish_recording()
        self._node.destroy_timer(self._timer)
        for events in self._events:
            self._node.destroy_subscription(events)
        for one in self._inputs.values():
            one.destroy()

    def _subscribe(self, name: str, topics: Any, kinds: tuple[str, ...],
                   callback: Callable[[Any], None]) -> None:
        """Subscribe to the node's topic of these kinds; anew if a restarted one has another."""
        found = [(topic, kind) for topic, offered in topics for kind in kinds if kind in offered]
        if not found or name in self._inputs and self._sources[name] in found:
            return
        if name in self._inputs:
            self._inputs[name].destroy()
        topic, kind = self._sources[name] = found[0]
        self._inputs[name] = Input(self._node, _KINDS[kind], topic, callback, depth=_DEPTH)

    def _unsubscribe(self, name: str) -> None:
        if name in self._inputs:
            self._inputs.pop(name).destroy()

    def _record(self, add: Callable[[Recording], None]) -> None:
        """Add to the recording, if there is one; where that fails, the viewers are told."""
        if self._recording is None:
            return
        try:
            add(self._recording)
            why = 'the disk is full' if self._recording.full else ''
        except (OSError, ValueError) as error:
            # such as of a drive that was unplugged; it must not end the executor's thread
            why = f'the recording has ended: {error}'
        if why:
            self._end_recording(why)

    def _end_recording(self, why: str) -> None:
        """Complete the bag, if there is one; tell the viewers why, and where it is."""
        if self._recording is None:
            return
        try:
            where = self.finish_recording()
        except (OSError, ValueError) as error:
            where = f'there is no bag: {error}'
        self._said(f'{why}: {where}')

    def _on_image(self, message: Any) -> None:
        self._record(lambda recording: recording.add_image(message))
        self._images.append(message)
        answered = _answered(self._images, self._answers)
        if answered is None or answered[0] is message:
            self._changed()

    def _on_answer(self, message: Any) -> None:
        self._record(lambda recording: recording.add_answer(message))
        self._answers.append(message)
        one = message.detections[0] if message.detections else None
        if one is None or one.id != self._identity:
            self._trail.clear()
        self._identity = one.id if one is not None else ''
        if one is not None:
            center = one.bbox.center.position
            self._trail.append((round(center.x, 1), round(center.y, 1)))
        self._changed()

    def _on_particles(self, message: Any) -> None:
        self._particles = message

    def _on_state(self, message: Any) -> None:
        values = {row.key: row.value for row in message.values}
        self._state = {'name': message.message, 'tracker': message.hardware_id, **{
            key: values[key] for key in _SHOWN if key in values}}
        self._changed()

    def _on_log(self, message: Any) -> None:
        if message.name == self._target.strip('/').replace('/', '.') and message.level >= 30:
            self._said(str(message.msg))

    def _on_parameters(self, message: Any) -> None:
        if message.node == self._target:
            self._configured({row.name: parameter_value_to_python(row.value)
                              for row in message.changed_parameters})


def _answered(images: Sequence[Any], answers: Sequence[Any]) -> tuple[Any, Any] | None:
    """Return the newest answer whose image is kept, as (image, answer); None if there's none."""
    for answer in reversed(answers):
        for message in reversed(images):
            if message.header.stamp == answer.header.stamp:
                return message, answer
    return None


def _of_detection(answer: Any) -> dict[str, Any]:
    """Return the box, and the covariance of its centre (xx, xy, yy) in px^2, if given."""
    if not answer.detections:
        return {}
    one = answer.detections[0]
    center = one.bbox.center.position
    shown = {'box': [center.x - one.bbox.size_x / 2, center.y - one.bbox.size_y / 2,
                     one.bbox.size_x, one.bbox.size_y]}
    # another node may publish on the topic, and needn't give a result
    if one.results:
        rows = one.results[0].pose.covariance
        shown['covariance'] = [rows[0], rows[1], rows[7]]
    return shown
