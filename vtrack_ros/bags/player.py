"""Publishing a bag over ROS, at the pace at which it was recorded."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
import queue
from threading import TIMEOUT_MAX
import time
from typing import Any, Self

from vtrack_ros.bags import messages
from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.reader import BagReader
from vtrack_ros.bags.topics import absolute, checked_topic, Topic

#: Time-out at the end for reliable subscribers to acknowledge what was sent, in seconds.
_LONGEST_WAIT = 2.0
#: Interval at which a request to stop is checked during such a wait, in seconds.
_PAUSE = 0.05
#: Delay, in seconds, above which the schedule of the remaining messages is shifted: a hold-up by a
#: busy disk, Ctrl-Z, or Fast DDS, which takes 1/3 s to check whether a new participant is alive.
_MOST_DELAY = 0.02
#: Least time of one repetition, in seconds: a bag of a single image has no pace of its own.
_LEAST_PERIOD = 0.04
#: Queue depths of publishers, in messages: of volatile ones, seconds of images for reliable
#: subscribers that are held up, and of transient local ones, which serve late subscribers too.
_DEPTH, _DEPTH_FOR_LATE = 100, 10


@dataclass(frozen=True)
class Pace:
    """
    The pace at which a bag is played: `rate` is a factor of the speed, `loop` repeats for ever.

    `clock` [Hz] is the rate at which the bag's time is published on ``/clock``, as it also is
    before each image; 0: never.
    """

    rate: float = 1.0
    loop: bool = False
    clock: float = 0.0


@dataclass
class Played:
    """What was published: messages by topic, images among them, and the time it took [s]."""

    counts: dict[str, int]
    images: int = 0
    seconds: float = 0.0


class StopRequest:
    """
    A request to stop that can be waited for, like `threading.Event`, but safe in signal handlers.

    The lock of a `threading.Event` may be held by the code that a handler interrupts, which may
    even be another handler.
    """

    def __init__(self) -> None:
        self._requests: queue.SimpleQueue[None] = queue.SimpleQueue()

    def make(self) -> None:
        """Make the request."""
        self._requests.put(None)

    def made(self) -> bool:
        """Return whether the request was made."""
        return not self._requests.empty()

    def wait(self, seconds: float) -> bool:
        """Wait until it's made, for `seconds` at most; return whether it was made."""
        try:
            self._requests.put(self._requests.get(timeout=min(seconds, TIMEOUT_MAX)))
        except queue.Empty:
            return False
        return True


class Player:
    """
    Publishes the raw messages of an open bag through an rclpy node; a context manager.

    `topics` are by default all with messages; `names` maps topics of the bag to the names to
    publish on, where these differ. `reliability` is reliable, best_effort, or auto: as it was
    offered at recording; durability always is as it was offered. `stop` ends the playing.
    BagError if a topic isn't in the bag, none can be played, or a name isn't valid in ROS.
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

    def __enter__(self) -> Self:
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
        """Wait until all image topics (all topics, if none) have a subscriber, or time is up."""
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

        Every message is scheduled relative to the first one, so that delays don't add up; but a
        hold-up shifts the rest of the schedule, for a subscriber with a queue of one image would
        miss those that come in a burst. After the first image of a topic the schedule is suspended
        until its reliable subscribers have acknowledged it, or for `patience` [s]: they may
        discover the player later than it discovers them.
        """
        played = Played({self.published_name(topic.name): 0 for topic in self.topics})
        clock = self._clock_publisher() if pace.clock else None
        began = time.monotonic()
        while True:
            again = time.monotonic() + _LEAST_PERIOD
            self._play_once(pace, clock, played, patience)
            if self.stop.made() or not pace.loop or not self._sleep_until(again):
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
            if clock is not None and message.topic in self._images:
                # Since the last tick time has stood still: the image would come before its time.
                clock(message.received)
            self._publishers[message.topic].publish(bytes(message.data))
            # publishing itself may be held up, so the delay is measured after it
            if (late := time.monotonic() - began - due) > _MOST_DELAY:
                began += late
            name = self.published_name(message.topic)
            played.counts[name] += 1
            if message.topic in self._images:
                played.images += 1
                if played.counts[name] == 1 and patience:
                    sent = time.monotonic()
                    if not self._wait_until_received([message.topic], patience):
                        self._node.get_logger().warning(
                            f'{name}: a subscriber has not received the first image within '
                            f'{patience:g} s (suspended or killed?): playing anyway')
                    began += time.monotonic() - sent

    def _wait_until_received(self, topics: Iterable[str], seconds: float) -> bool:
        """
        Wait until reliable subscribers have acknowledged all topics; False if it timed out.

        A request to stop that is made meanwhile ends the wait; after one that was made before, it
        still waits for what was sent.
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
        """Wait until a monotonic time [s]; return False if stopped."""
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
            reason = _why_not(topic)
            if reason:
                self.skipped.append(f'{topic.name}: {topic.message_type} {reason}')
            else:
                playable.append(topic)
        if not playable:
            raise BagError(f'{self._bag.path}: nothing to play; ' + '; '.join(self.skipped))
        return playable

    def _check_known(self, names: Iterable[str]) -> None:
        known = self._bag.topics
        for name in names:
            if name not in known:
                raise BagError(f'{self._bag.path} has no topic {name}; it has ' + ', '.join(known))

    def _check_names(self) -> None:
        """Raise BagError if a name isn't valid in ROS, or would carry two message types."""
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


def _why_not(topic: Topic) -> str:
    """Return why a topic can't be played; empty if it can."""
    package = topic.message_type.partition('/')[0]
    try:
        _message_class(topic.message_type)
    except ImportError:
        return f'needs the package {package}, which is not installed'
    except (AttributeError, ValueError):
        # such as a service's, or one that another version of the package has
        return 'is not a message of an installed package'
    return '' if topic.convertible else 'of ROS 1 has other fields than that of ROS 2'


def _message_class(name: str) -> Any:
    package, kind, message = name.split('/')
    if kind != 'msg':
        raise ValueError(f'{name} is not a message')
    return getattr(import_module(f'{package}.msg'), message)
