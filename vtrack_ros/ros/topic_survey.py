"""A survey of all image topics: subscribes to each for some seconds, and reports on it."""

from dataclasses import dataclass
import time
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_check_compatible, QoSCompatibility, QoSProfile, ReliabilityPolicy

from vtrack_ros.ros.diagnostics import SEGMENT
from vtrack_ros.ros.message_types import MessageTypes

_IMAGES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')
#: The topic of this package's annotated images is left out: it's no camera.
_DRAWN = '/debug_image'
#: Discovery ends after a period without a change of the graph, or at its time-out, in seconds.
_QUIET, _LONGEST = 2.0, 10.0
#: Queue depth of a subscription, in images.
_DEPTH = 30


@dataclass(frozen=True)
class ImageTopic:
    """
    What was observed of an image topic.

    `reliable`: all publishers offer it. `mismatches` name the subscribers that get nothing;
    `received` is the number of images, `lost` that of images that the middleware reported lost,
    `rate` that of received ones in Hz; `size` is the largest one's in bytes, `form` dimensions
    and encoding of the latest, or its format if it's compressed.
    """

    name: str
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]
    reliable: bool
    mismatches: tuple[str, ...]
    received: int
    lost: int
    rate: float
    size: int
    form: str

    @property
    def exceeds_shared_memory(self) -> bool:
        """Return whether images are too large for Fast DDS without the profile."""
        return self.size > SEGMENT // 2


@dataclass(frozen=True)
class AwaitedTopic:
    """An image topic that no node publishes, its subscribers, and published ones of its type."""

    name: str
    subscribers: tuple[str, ...]
    published: tuple[str, ...]


def awaited(node: Node) -> list[AwaitedTopic]:
    """Return the topics that nodes wait for images on, but none publishes, sorted by name."""
    topics = _image_topics(node)
    published = [(name, kind) for name, kind in topics if node.count_publishers(name)]
    return [AwaitedTopic(name, _readers(node, name),
                         tuple(other for other, its in published if its == kind))
            for name, kind in topics if not node.count_publishers(name) and _readers(node, name)]


def survey(node: Node, executor: SingleThreadedExecutor, seconds: float) -> list[ImageTopic]:
    """Listen for `seconds` on every published image topic; return them sorted by name."""
    known: set[object] = set()
    end = time.monotonic() + _LONGEST
    while time.monotonic() < end:
        _spin(executor, _QUIET)
        seen: set[object] = {(name, *kinds) for name, kinds in node.get_topic_names_and_types()}
        seen |= set(node.get_node_names_and_namespaces())
        if seen == known:
            break
        known = seen
    # a participant can't subscribe to a topic as two types: as what is published, if possible
    kinds: dict[str, str] = {}
    for name, kind in _image_topics(node):
        published = {one.topic_type for one in node.get_publishers_info_by_topic(name)}
        if kind in published or published and name not in kinds:
            kinds[name] = kind
    listeners = [_Listener(node, name, kind) for name, kind in kinds.items()]
    _spin(executor, seconds if listeners else 0.0)
    found = [listener.result() for listener in listeners]
    for listener in listeners:
        listener.destroy()
    return found


def _image_topics(node: Node) -> list[tuple[str, str]]:
    """Return name and type of every image topic, sorted by name."""
    return [(name, kind) for name, kinds in sorted(node.get_topic_names_and_types())
            for kind in kinds if kind in _IMAGES and not name.endswith(_DRAWN)]


def _readers(node: Node, topic: str) -> tuple[str, ...]:
    """Return the names of the nodes that have subscribed to a topic."""
    return tuple(sorted({_name(one) for one in node.get_subscriptions_info_by_topic(topic)}))


class _Listener:
    """A subscription that accepts whatever the publishers offer, and counts images."""

    def __init__(self, node: Node, topic: str, kind: str) -> None:
        self._node, self._topic = node, topic
        self._arrivals: list[float] = []
        self._lost = self._size = 0
        self._form = ''
        offers = node.get_publishers_info_by_topic(topic)
        self._reliable = all(one.qos_profile.reliability == ReliabilityPolicy.RELIABLE
                             for one in offers)
        self._publishers = tuple(sorted({_name(one) for one in offers}))
        readers = node.get_subscriptions_info_by_topic(topic)
        self._subscribers = _readers(node, topic)
        self._mismatches = tuple(sorted(
            f'{_name(reader)} receives nothing from {_name(offer)}: {reason}'
            for reader in readers for offer in offers
            if (reason := _mismatch(offer, reader))))
        policy = ReliabilityPolicy.RELIABLE if self._reliable else ReliabilityPolicy.BEST_EFFORT
        callback: Any = self._on_image
        self._subscription = node.create_subscription(
            MessageTypes()[kind], topic, callback, QoSProfile(depth=_DEPTH, reliability=policy),
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost))

    def result(self) -> ImageTopic:
        """Return what was observed up to now."""
        times = self._arrivals
        rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0
        return ImageTopic(
            self._topic, self._publishers, self._subscribers, self._reliable, self._mismatches,
            len(times), self._lost, rate, self._size, self._form)

    def destroy(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)

    def _on_image(self, message: Any) -> None:
        self._arrivals.append(time.monotonic())
        self._size = max(self._size, len(message.data))
        self._form = (f'{message.width} x {message.height} {message.encoding}'
                      if hasattr(message, 'encoding') else str(message.format))

    def _on_lost(self, event: Any) -> None:
        self._lost += int(event.total_count_change)


def _spin(executor: SingleThreadedExecutor, seconds: float) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        executor.spin_once(timeout_sec=left)


def _name(one: Any) -> str:
    return f'{one.node_namespace.rstrip("/")}/{one.node_name}'


def _mismatch(offer: Any, reader: Any) -> str:
    if offer.topic_type != reader.topic_type:
        return f'it publishes {offer.topic_type}, not {reader.topic_type}'
    # the reason is such as 'ERROR: one fault;ERROR: another;'
    compatibility, reason = qos_check_compatible(offer.qos_profile, reader.qos_profile)
    faults = [fault for each in str(reason).split(';')
              if (fault := each.removeprefix('ERROR: ').strip())]
    return ', '.join(faults) if compatibility == QoSCompatibility.ERROR else ''
