"""Quality of service: adapts to what the publisher offers, and reports mismatches."""

from collections.abc import Callable
from typing import Any, cast

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

# The graph's name for the node of a publisher that was only just discovered.
_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'


class Input:
    """
    A subscription with the reliability that the publisher offers, and a queue of `depth` messages.

    With `auto` it begins reliable, and changes to best effort as soon as a publisher appears that
    offers no more: a publisher that waits for its match before it sends loses nothing by that.
    With `latched` it likewise changes to transient local, for a message that was sent before,
    while every publisher offers that.
    The callback takes a message, or the message and its info, a dict of time stamps.
    """

    def __init__(self, node: Node, kind: Any, topic: str, callback: Callable[..., None],
                 reliability: str = 'auto', latched: bool = False, depth: int = 1) -> None:
        self._node = node
        self._kind = kind
        self._topic = topic
        self._choice = reliability
        self._callback = callback
        self._latched = latched
        self._depth = depth
        self._durability = DurabilityPolicy.VOLATILE
        self._policy = (ReliabilityPolicy.BEST_EFFORT if reliability == 'best_effort' else
                        ReliabilityPolicy.RELIABLE)
        self._subscription = self._subscribe()
        self._faults: dict[bytes, str] = {}
        self._several = False
        self._type = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
        self.lost = 0

    @property
    def topic(self) -> str:
        """Return the resolved name of the topic."""
        return str(self._subscription.topic_name)

    @property
    def reliability(self) -> str:
        """Return the reliability in force, in lower case."""
        return str(self._policy.name.lower())

    @property
    def faults(self) -> tuple[str, ...]:
        """Return why nothing is received from some publishers; empty while all match."""
        return tuple(dict.fromkeys(self._faults.values()))

    @property
    def publishers(self) -> int:
        """Return the number of publishers on the topic, matching or not."""
        return int(self._node.count_publishers(self.topic))

    def check(self) -> None:
        """Check the publishers: adapt to what they offer, and log those that can't match."""
        offers = self._node.get_publishers_info_by_topic(self.topic)
        fitting = [offer for offer in offers if offer.topic_type == self._type]
        policy, durability = self._policy, self._durability
        if self._choice == 'auto' and fitting:
            weak = any(map(_best_effort, fitting))
            policy = ReliabilityPolicy.BEST_EFFORT if weak else ReliabilityPolicy.RELIABLE
        if self._latched and fitting:
            kept = all(map(_transient_local, fitting))
            durability = DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE
        self._change(policy, durability)
        faults = {bytes(offer.endpoint_gid): fault
                  for offer in offers if (fault := self._fault(offer))}
        for publisher, fault in faults.items():
            if publisher not in self._faults and fault not in self.faults:
                self._node.get_logger().error(fault)
        self._faults = faults

    def warn_of_several(self) -> None:
        """Warn, once, that several publishers send what is taken for one stream."""
        several = self.publishers > 1
        if several and not self._several:
            self._node.get_logger().warning(
                f'{self.topic} has {self.publishers} publishers: their images are treated as one '
                'stream; remap all but one')
        self._several = several

    def destroy(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)

    def _fault(self, offer: Any) -> str:
        known = offer.node_name != _UNKNOWN_NODE
        whose = f'{self.topic}: a publisher' + (f' of node {offer.node_name!r}' if known else '')
        if offer.topic_type != self._type:
            return (f'{whose} sends {offer.topic_type}, not {self._type}: nothing is '
                    'received from it; remap the topic, or set image_transport')
        if _best_effort(offer) and self._policy == ReliabilityPolicy.RELIABLE:
            return (f'{whose} offers best_effort, but reliability is {self._choice!r} (QoS '
                    'mismatch): nothing is received from it; set reliability to auto or '
                    'best_effort')
        return ''

    def _change(self, policy: ReliabilityPolicy, durability: DurabilityPolicy) -> None:
        if (policy, durability) != (self._policy, self._durability):
            self._policy, self._durability = policy, durability
            previous, self._subscription = self._subscription, self._subscribe()
            self._node.destroy_subscription(previous)
            kept = ', transient_local' * (durability == DurabilityPolicy.TRANSIENT_LOCAL)
            self._node.get_logger().info(f'{self.topic}: subscribed {self.reliability}{kept}')

    def _subscribe(self) -> Any:
        events = SubscriptionEventCallbacks(
            incompatible_qos=lambda _: self.check(), message_lost=self._on_lost)
        qos = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=self._depth,
                         reliability=self._policy, durability=self._durability)
        return self._node.create_subscription(
            self._kind, self._topic, cast(Any, self._callback), qos, event_callbacks=events)

    def _on_lost(self, event: Any) -> None:
        self.lost += int(event.total_count_change)


def _best_effort(offer: Any) -> bool:
    return bool(offer.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT)


def _transient_local(offer: Any) -> bool:
    return bool(offer.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)


def image_topic(node: Node, transport: str) -> str:
    """
    Return the topic of the images: `image`, or, as in image_transport, a subtopic of it.

    A remap of ``image/compressed`` itself takes precedence over one of ``image``, which may
    already name the subtopic.
    """
    if transport == 'raw':
        return 'image'
    plain = f'{node.get_namespace().rstrip("/")}/image/{transport}'
    if node.resolve_topic_name(f'image/{transport}') != plain:
        return f'image/{transport}'
    return f'{node.resolve_topic_name("image").removesuffix(f"/{transport}")}/{transport}'
