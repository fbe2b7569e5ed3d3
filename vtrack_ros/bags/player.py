"""Publishing a bag over ROS, at the pace at which it was recorded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
import queue
import time
from typing import Any

from vtrack_ros.bags import messages
from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.reader import BagReader
from vtrack_ros.bags.topics import absolute, checked_topic, Topic

#: How long the player waits for reliable subscribers to have what was sent, in seconds.
_LONGEST_WAIT = 2.0
#: How long it waits for them before it looks whether it's to stop, in seconds.
_PAUSE = 0.05
#: Who is later than that, in seconds, was held up: by a busy disk, Ctrl-Z, or Fast DDS, which
#: takes a third of a second to see whether somebody new is alive.
_HELD_UP = 0.02
#: How many messages a publisher keeps for reliable subscribers that are held up: seconds of images
#: at their pace. One that also keeps them for those who subscribe late has fewer.
_DEPTH, _DEPTH_FOR_LATE = 100, 10


@dataclass(frozen=True)
class Pace:
    """
    How a bag is played: twice as fast at rate 2, and again and again in a loop.

    `clock` [Hz] is how often the bag's time is published on ``/clock``; 0 for never.
    """

    rate: float = 1.0
    loop: bool = False
    clock: float = 0.0


@dataclass
class Played:
    """What was published: topic -> number of messages, how many were images, and the time."""

    counts: dict[str, int] = field(default_factory=dict)
    images: int = 0
    seconds: float = 0.0


class StopRequest:
    """
    A request to stop, made at any time and waited for: an event for the handlers of signals.

    The lock of a `threading.Event` may be held by whom a handler interrupts, another handler even.
    """

    def __init__(self) -> None:
        self._requests: queue.SimpleQueue[None] = queue.SimpleQueue()

    def make(self) -> None:
        """Make it."""
        self._requests.put(None)

    def made(self) -> bool:
        """Return whether it was made."""
        return not self._requests.empty()

    def wait(self, seconds: float) -> bool:
        """Wait until it's made, or for so long; return whether it was made."""
        try:
            self._requests.put(self._requests.get(timeout=seconds))
        except queue.Empty:
            return False
        return True


class Player:
    """
    Publishes the raw messages of an open bag through an rclpy node; a context manager.

    `topics` are by default all, `names` topic in the bag -> topic to publish on, where they
    differ. `reliability` is reliable, best_effort, or auto: as was offered at recording;
    durability always is as it was. `stop` ends it. BagError if a topic isn't in the bag, none can
    be played, or a name won't do for ROS.
    """

    def __init__(self, node: Any, bag: BagReader, topics: Iterable[str] | None = None,
                 names: Mapping[str, str] | None = None, reliability: str = 'auto',
                 stop: StopRequest | None = None) -> None:
        self._node = node
        self._bag = bag
        self._names = {absolute(old): absolute(new) for old, new in (names or {}).items()}
        self._reliability = reliability
        self._publishers: dict[str, Any] = {}
        self._images: set[str] = set()
        self.skipped: list[str] = []
        self.topics = self._chosen(topics)
        self._check_names()
        for topic in self.topics:
            self._publishers[topic.name] = self._publisher(topic)
            if topic.message_type in messages.IMAGE_TYPES:
                self._images.add(topic.name)
        self.stop = stop or StopRequest()

    def __enter__(self) -> Player:
        """Return the player."""
        return self

    def __exit__(self, *_: object) -> None:
        """Take the publishers down."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)

    def published_name(self, topic: str) -> str:
        """Return the name that a topic of the bag is published on."""
        return self._names.get(topic, topic)

    def wait_for_subscribers(self, seconds: float) -> bool:
        """Wait until all images have a subscriber (everything, without images) or time is up."""
        needed = [self._publishers[name] for name in self._images or self._publishers]
        deadline = time.monotonic() + seconds
        while not self.stop.made():
            if all(publisher.get_subscription_count() for publisher in needed):
                return True
            if time.monotonic() >= deadline:
                return False
            self.stop.wait(0.01)
        return False

    def play(self, pace: Pace, patience: float = 0.0) -> Played:
        """
        Publish until the end or a request to stop; BagError if the bag turns out to be broken.

        Every message has its time from the first one's, so that delays don't add up; but after a
        hold-up the others keep their distances, for a subscriber that takes the newest image alone
        would miss what comes at once. Only once the reliable subscribers to a topic's first image
        have it, or `patience` [s] is over, time goes on: they may hear of the player later than it
        hears of them.
        """
        played = Played({self.published_name(topic.name): 0 for topic in self.topics})
        clock = self._clock_publisher() if pace.clock else None
        began = time.monotonic()
        while True:
            self._play_once(pace, clock, played, patience)
            if self.stop.made() or not pace.loop:
                break
        played.seconds = time.monotonic() - began
        self._wait_until_received(self._publishers, _LONGEST_WAIT)
        return played

    def _play_once(self, pace: Pace, clock: Any, played: Played, patience: float) -> None:
        began = time.monotonic()
        first: int | None = None
        tick = 0
        for message in self._bag.raw({topic.name for topic in self.topics}):
            first = message.received if first is None else first
            due = (message.received - first) / 1e9 / pace.rate
            while clock is not None and tick / pace.clock <= due:
                if not self._sleep_until(began + tick / pace.clock):
                    return
                clock(first + round(tick / pace.clock * pace.rate * 1e9))
                tick += 1
            if not self._sleep_until(began + due):
                return
            if (late := time.monotonic() - began - due) > _HELD_UP:
                began += late
            self._publishers[message.topic].publish(bytes(message.data))
            name = self.published_name(message.topic)
            played.counts[name] += 1
            if message.topic in self._images:
                played.images += 1
                if played.counts[name] == 1 and patience:
                    sent = time.monotonic()
                    if not self._wait_until_received([message.topic], patience):
                        self._node.get_logger().warning(
                            f'{name}: a subscriber has not received the first image within '
                            f'{patience:g} s (held up, or killed): playing all the same')
                    began += time.monotonic() - sent

    def _wait_until_received(self, topics: Iterable[str], seconds: float) -> bool:
        """
        Wait until reliable subscribers have all of the topics; False if time was up before.

        A request to stop that is made meanwhile ends it: what was sent before one is still theirs.
        """
        from rclpy.duration import Duration
        deadline = time.monotonic() + seconds
        waiting = [self._publishers[topic] for topic in topics]
        stopped = self.stop.made()
        while waiting and self.stop.made() is stopped:
            if waiting[-1].wait_for_all_acked(Duration(seconds=_PAUSE)):
                waiting.pop()
            elif time.monotonic() >= deadline:
                return False
        return True

    def _sleep_until(self, moment: float) -> bool:
        """Wait; return False if stopped."""
        left = moment - time.monotonic()
        return not (self.stop.wait(left) if left > 0 else self.stop.made())

    def _chosen(self, wanted: Iterable[str] | None) -> list[Topic]:
        known = self._bag.topics
        if wanted is None:
            chosen = [topic for topic in known.values() if topic.count]
        else:
            names = dict.fromkeys(map(absolute, wanted))
            self._check_known(names)
            chosen = [known[name] for name in names]
        playable = []
        for topic in chosen:
            try:
                _message_class(topic.message_type)
            except (AttributeError, ImportError):
                kind = topic.message_type
                self.skipped.append(f'{topic.name}: {kind} needs the package '
                                    f'{kind.partition("/")[0]}, which is not installed')
            else:
                playable.append(topic)
        if not playable:
            raise BagError(f'{self._bag.path}: nothing to play; ' + '; '.join(self.skipped))
        return playable

    def _check_known(self, names: Iterable[str]) -> None:
        known = self._bag.topics
        for name in names:
            if name not in known:
                raise BagError(f'{self._bag.path} has no topic {name}; it has ' +
                               ', '.join(known))

    def _check_names(self) -> None:
        """Raise BagError where ROS would take a name not at all, or not for two types."""
        self._check_known(self._names)
        types: dict[str, str] = {}
        for topic in self.topics:
            name = checked_topic(self.published_name(topic.name), '; give --remap FROM:=TO')
            kind = types.setdefault(name, topic.message_type)
            if kind != topic.message_type:
                raise BagError(f'{name} cannot carry both {kind} and {topic.message_type}; give '
                               'another --remap, or choose with --topic')

    def _publisher(self, topic: Topic) -> Any:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
        reliable = topic.reliable
        if self._reliability != 'auto':
            reliable = self._reliability == 'reliable'
        reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        durability = (DurabilityPolicy.TRANSIENT_LOCAL if topic.transient_local
                      else DurabilityPolicy.VOLATILE)
        return self._node.create_publisher(
            _message_class(topic.message_type), self.published_name(topic.name),
            QoSProfile(depth=_DEPTH_FOR_LATE if topic.transient_local else _DEPTH,
                       reliability=reliability, durability=durability))

    def _clock_publisher(self) -> Any:
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from rclpy.time import Time
        from rosgraph_msgs.msg import Clock
        publisher = self._node.create_publisher(
            Clock, '/clock', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
        return lambda now: publisher.publish(Clock(clock=Time(nanoseconds=now).to_msg()))


def _message_class(name: str) -> Any:
    package, _, message = name.split('/')
    return getattr(import_module(f'{package}.msg'), message)
