"""Once a second: who sends and who listens, what is lost, and how long it takes."""

from __future__ import annotations

from collections.abc import Callable
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from vtrack_ros.ros import diagnostics
from vtrack_ros.ros.outputs import Outputs
from vtrack_ros.ros.qos import ImageInput

#: After so many seconds without an image what was measured is no longer true.
LONGEST_SILENCE = 1.0


class Health:
    """
    Watches the flow of images, and reports on ~/state and /diagnostics.

    Parameters
    ----------
    node : rclpy.node.Node
    outputs : Outputs
    state : callable
        Returns the target's state.

    Attributes
    ----------
    flow : FrameFlow
        What came, and what didn't.
    input : ImageInput or None
        What is watched; None while no images are taken.

    """

    def __init__(self, node: Node, outputs: Outputs,
                 state: Callable[[], DiagnosticStatus]) -> None:
        self._node = node
        self._outputs = outputs
        self._state = state
        self.flow = diagnostics.FrameFlow()
        self.input: ImageInput | None = None
        self._told = False
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        # Simulated time may stand still, and just then somebody wants to know why.
        self._timer = node.create_timer(
            1.0, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy(self) -> None:
        """Take everything down."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    @property
    def stale(self) -> bool:
        """Return whether no good image has come for so long that it's worth a warning."""
        return self.flow.age(time.perf_counter_ns()) > LONGEST_SILENCE

    def publish_state(self, make: Callable[[], DiagnosticStatus]) -> None:
        """Publish the state that `make` returns."""
        self._outputs.publish_state(make)
        self._told = True

    def _on_timer(self) -> None:
        now = time.perf_counter_ns()
        if self.input is not None:
            self.input.check()
        # Who comes while nothing happens, or while it's paused, hears of it as well.
        if not self._told:
            self._outputs.publish_state(self._state)
        self._told = False
        if self._publisher.get_subscription_count() == 0:
            return
        name = self._node.get_fully_qualified_name()
        state = self._state()
        rows = [state]
        if self.input is not None:
            if state.level != DiagnosticStatus.OK and self.stale:
                state.message += f', but no image for {self.flow.age(now):.0f} s'
            faults = (*self.input.faults, *self._outputs.mismatches.faults)
            level, text, values = diagnostics.report(
                self.flow, now, faults, self.input.publishers, self.input.topic)
            values['reliability'] = self.input.reliability
            values['lost by the middleware'] = str(self.input.lost)
            values['QoS mismatches'] = '; '.join(faults) or 'none'
            rows.insert(0, diagnostics.status(f'{name}: images', level, text, values))
        self._publisher.publish(diagnostics.array(self._node.get_clock().now().to_msg(), rows))
