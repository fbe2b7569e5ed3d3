"""Diagnostics of the node: the target's state, and the flow of images."""

from collections.abc import Callable, Mapping, Sequence
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from vtrack_ros.ros.publishers import Publishers
from vtrack_ros.ros.qos import Input
from vtrack_ros.session.frame_flow import FrameFlow
from vtrack_ros.tracker import Estimate, TrackState

#: Share of missing frames above which a warning is reported.
NOTABLE_LOSS = 0.01
#: Time-out, in seconds: without a good image for longer, the last measurement is stale.
STALE_AFTER = 1.0
#: Size of Fast DDS's shared-memory segment without our profile, in bytes.
SEGMENT = 512 * 1024
#: The advice where large images are missing.
_PROFILE_ADVICE = ('not sent, or lost before they reached this node: images of this size need the '
                   'Fast DDS profile config/fastdds.xml in the publisher and the node')

_LEVELS = {
    TrackState.TRACKING: DiagnosticStatus.OK,
    TrackState.SEARCHING: DiagnosticStatus.WARN,
    TrackState.LOST: DiagnosticStatus.ERROR,
}


class Diagnostics:
    """
    Monitors the flow of images, and reports on ~/state and /diagnostics.

    `inputs` are checked for QoS mismatches, and so is `images`, None while none are taken.
    `make_state` returns the target's state.
    """

    def __init__(self, node: Node, publishers: Publishers,
                 make_state: Callable[[], DiagnosticStatus]) -> None:
        self._node = node
        self._publishers = publishers
        self._make_state = make_state
        self.flow = FrameFlow()
        self.inputs: list[Input] = []
        self.images: Input | None = None
        self._published_since_tick = False
        self._reported: tuple[str, bytes] = ('', b'')
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        # On a steady clock, for simulated time may stand still, and the reports must go on.
        self._timer = node.create_timer(
            1.0, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy(self) -> None:
        """Take everything down."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    @property
    def stale(self) -> bool:
        """Return whether no good image has come for more than `STALE_AFTER`."""
        return self.flow.age(time.perf_counter_ns()) > STALE_AFTER

    def publish_state(self, make: Callable[[], DiagnosticStatus] | None = None) -> None:
        """Publish the target's state; on /diagnostics too if it has changed."""
        self._publishers.publish_state(make or self._make_state)
        self._published_since_tick = True
        if self._publisher.get_subscription_count():
            state = self._make_state()
            if (state.message, state.level) != self._reported:
                self._publish(state)

    def _on_timer(self) -> None:
        for one in (*self.inputs, *filter(None, [self.images])):
            one.check()
        if self.images is not None:
            self.images.warn_of_several()
        # Without frames, or paused, once a second for subscribers that came meanwhile.
        if not self._published_since_tick:
            self._publishers.publish_state(self._make_state)
        self._published_since_tick = False
        rows = []
        if self.images is not None:
            faults = [fault for one in (self.images, *self.inputs) for fault in one.faults]
            faults += self._publishers.faults
            level, text, values = report(self.flow, time.perf_counter_ns(), faults,
                                         self.images.publishers, self.images.topic)
            if text.endswith(_PROFILE_ADVICE):
                # In the log as well: few people read diagnostics while all seems to work.
                self._node.get_logger().warning(f'{text} (logged once)', once=True)
            values['reliability'] = self.images.reliability
            values['lost by the middleware'] = str(self.images.lost)
            values['QoS mismatches'] = '; '.join(faults) or 'none'
            name = self._node.get_fully_qualified_name()
            rows.append(_status(f'{name}: images', bytes([level]), text, values))
        if self._publisher.get_subscription_count():
            self._publish(*rows, self._make_state())

    def _publish(self, *rows: DiagnosticStatus) -> None:
        """Publish rows, the target's last, stamped with the node's time."""
        self._reported = (rows[-1].message, rows[-1].level)
        message = DiagnosticArray(status=list(rows))
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def state_status(name: str, tracker: str, state_name: str, estimate: Estimate | None,
                 values: Mapping[str, str], stale: bool = False) -> DiagnosticStatus:
    """
    Return the target's state as a DiagnosticStatus.

    `name` is the node's full name; `tracker` and `state_name` name the tracker and the state.
    `values` are added to the message; `stale`: the estimate isn't of the camera's current image.
    """
    rows = {'tracker': tracker, **values}
    level = DiagnosticStatus.OK
    if estimate is not None:
        if state_name == 'stale':
            level = max(_LEVELS[estimate.state], DiagnosticStatus.WARN)
        elif state_name == estimate.state.value:
            # No warning where the node is paused or inactive: somebody asked for it.
            level = _LEVELS[estimate.state]
        box = estimate.box
        rows['box'] = 'stale' if stale else 'measured' if estimate.measured else 'predicted'
        rows['confidence'] = f'{estimate.confidence:.3f}'
        rows['x'], rows['y'] = f'{box.x:.2f} px', f'{box.y:.2f} px'
        rows['width'], rows['height'] = f'{box.width:.2f} px', f'{box.height:.2f} px'
    return _status(f'{name}: target', level, state_name, rows, tracker)


def report(flow: FrameFlow, now: int, faults: Sequence[str], publishers: int,
           topic: str) -> tuple[int, str, dict[str, str]]:
    """
    Return level (0 OK, 1 warning, 2 error), text and values for the flow since the last report.

    `now` [ns] is on the clock of `FrameFlow.arrived`; `faults` are QoS mismatches, `publishers`
    those of the image topic.
    """
    rate = flow.rate(now)
    received, malformed, missing = flow.recent()
    processing, latency = percentiles(flow.processing), percentiles(flow.latency)
    values = {'frame rate': f'{rate:.1f} Hz'}
    for name in ('received', 'missing', 'late', 'malformed'):
        values[f'frames {name}'] = str(getattr(flow, name))
    for name, (p50, p99) in (('processing', processing), ('latency', latency)):
        values |= {f'{name} p50': f'{p50:.2f} ms', f'{name} p99': f'{p99:.2f} ms'}
    if faults:
        return 2, faults[0], values
    if not publishers:
        return 1, f'no node publishes {topic}', values
    if malformed:
        return 1, (f'{malformed} of the last {received + malformed} images were malformed: '
                   f'{flow.fault}'), values
    if not received:
        silence = flow.silence(now)
        since = 'yet' if silence == float('inf') else f'for {silence:.0f} s'
        return 1, f'no image on {topic} {since}', values
    share = missing / (received + missing)
    if share > NOTABLE_LOSS:
        interval = 1e3 / rate * (1 - share) if rate else 0.0
        if processing[0] > interval:
            reason = (f'a frame takes {processing[0]:.1f} ms: choose a faster tracker or fewer '
                      'particles')
        elif np.percentile(flow.latency or [0.0], 100 * (1 - share / 2)) > interval:
            # late: latency above the interval; at least half as many are late as are missing
            reason = 'and others are answered late: the processor or the network is busy'
        elif flow.largest > SEGMENT // 2:
            reason = _PROFILE_ADVICE
        else:
            reason = 'not sent, or lost before they reached this node'
        return 1, (f'{missing} of the last {received + missing} frames are missing, '
                   f'{reason}'), values
    return 0, f'{rate:.1f} Hz', values


def percentiles(values: Sequence[float]) -> tuple[float, float]:
    """Return the median and the 99th percentile; NaN for no values."""
    if not values:
        return float('nan'), float('nan')
    p50, p99 = np.percentile(np.asarray(values), (50, 99))
    return float(p50), float(p99)


def _status(name: str, level: bytes, message: str, values: Mapping[str, str],
            hardware_id: str = '') -> DiagnosticStatus:
    return DiagnosticStatus(
        level=level, name=name, message=message, hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()])
