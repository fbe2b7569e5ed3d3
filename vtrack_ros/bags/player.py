"""Publishing a bag over ROS, at the pace at which it was recorded."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
import time
from typing import Any, Self

from vtrack_ros.bags import messages
from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.reader import BagReader, RawMessage
from vtrack_ros.bags.topics import absolute, checked_topic, Topic
from vtrack_ros.signals import StopRequest

#: Time-out at the end for reliable subscribers to acknowledge what was sent, in seconds.
_LONGEST_WAIT = 2.0
#: Interval at which a request to stop is checked during such a wait, in seconds.
_PAUSE = 0.05
#: For how long, in seconds, /clock has a time before the first image: as best effort, it isn't
#: acknowledged, and reaches no subscriber that doesn't know the player yet.
_CLOCK_LEAD = 0.2
#: Interval at which it's published meanwhile, and at which subscribers are looked for, in seconds.
_CLOCK_INTERVAL = 0.02
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


class Player:
    """
    Publishes the raw messages of an open bag through an rclpy node; a context manager.

    `topics` are by default all with messages; `names` maps topics of the bag to the names to
    publish on, where these differ. `reliability` is reliable, best_effort, or auto: as it was
    offered at recording; durability always is as it was offered. `stop` ends the playing.
    BagError if a topic isn't in the bag, none can be played, a name isn't valid in ROS, or the bag
    has a ``/clock`` of its own and the pace another.
    """

    def __init__(self, node: Any, bag: BagReader, topics: Iterable[str] | None = None,
                 names: Mapping[str, str] | None = None, reliability: str = 'auto',
                 stop: StopRequest | None = None, pace: Pace = Pace()) -> None:
        self._node = node
        self._pace = pace
        self._bag = bag
        self._names = {absolute(old): absolute(new) for old, new in (names or {}).items()}
        self._reliability = reliability
        self._publishers: dict[str, Any] = {}
        self._images: set[str] = set()
        self.skipped: list[str] = []
        self.topics = self._chosen(topics)
        self._check_names()
        # Before the others, for publishers are discovered in the order of their creation.
        self._clock = self._clock_publisher() if pace.clock else None
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
        for publisher in filter(None, (self._clock, *self._publishers.values())):
            self._node.destroy_publisher(publisher)

    def published_name(self, topic: str) -> str:
        """Return the name that a topic of the bag is published on."""
        return self._names.get(topic, topic)

    def wait_for_subscribers(self, seconds: float) -> bool:
        """
        Wait until all image topics (all topics, if none) have a subscriber, or time is up.

        Meanwhile ``/clock`` has the time of the beginning, as a program may wait for a time before
        it subscribes.
        """
        needed = [self._publishers[name] for name in self._images or self._publishers]
        # read for a clock only: to begin a bag that is compressed as a whole takes a while
        beginning = next((one.received for one in self._messages()), 0) if self._pace.clock else 0
        deadline = time.monotonic() + seconds
        found: float | None = None
        while not self.stop.made():
            self._publish_clock(beginning)
            now = time.monotonic()
            if all(publisher.get_subscription_count() for publisher in needed):
                found = now if found is None else found
                if self._clock is None or now - found >= _CLOCK_LEAD:
                    return True
            elif now >= deadline:
                return False
            self.stop.wait(_CLOCK_INTERVAL)
        return False

    def play(self, patience: float = 0.0) -> Played:
        """
        Publish until the end or a request to stop; BagError if the bag turns out to be broken.

        Every message is scheduled relative to the first one, so that delays don't add up; but a
        hold-up shifts the rest of the schedule, for a subscriber with a queue of one image would
        miss those that come in a burst. After the first image of a topic the schedule is suspended
        until its reliable subscribers have acknowledged it, or for `patience` [s]: they may
        discover the player later than it discovers them.
        """
        played = Played({self.published_name(topic.name): 0 for topic in self.topics})
        began = time.monotonic()
        while True:
            again = time.monotonic() + _LEAST_PERIOD
            self._play_once(played, patience)
            if self.stop.made() or not self._pace.loop or not self._sleep_until(again):
                break
        played.seconds = time.monotonic() - began
        self._wait_until_received(self._publishers, _LONGEST_WAIT)
        return played

    def _play_once(self, played: Played, patience: float) -> None:
        pace = self._pace
        began = time.monotonic()
        first: int | None = None
        tick = 0
        for message in self._messages():
            first = message.received if first is None else first
            due = (message.received - first) / 1e9 / pace.rate
            while pace.clock and tick / pace.clock <= due:
                if not self._sleep_until(began + tick / pace.clock):
                    return
                self._publish_clock(first + round(tick / pace.clock * pace.rate * 1e9))
                tick += 1
            if not self._sleep_until(began + due):
                return
            if message.topic in self._images:
                # Since the last tick time has stood still: the image would come before its time.
                self._publish_clock(message.received)
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

    def _messages(self) -> Iterator[RawMessage]:
        return self._bag.raw({topic.name for topic in self.topics})

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
        if self._pace.clock and '/clock' in types:
            raise BagError(f'{self._bag.path} has a /clock of its own, which --clock would '
                           'contradict: leave out --clock, or give --remap /clock:=OTHER')

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
        return self._node.create_publisher(
            _message_class('rosgraph_msgs/msg/Clock'), '/clock',
            QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))

    def _publish_clock(self, now: int) -> None:
        """Publish a time [ns], if there's to be a clock."""
        if self._clock is not None:
            from rclpy.time import Time
            self._clock.publish(self._clock.msg_type(clock=Time(nanoseconds=now).to_msg()))


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
