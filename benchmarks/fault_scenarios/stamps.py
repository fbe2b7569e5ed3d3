"""Faults of time: wrong stamps, clocks that jump, bags that loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fault_scenarios.sender import PERIOD, RATE, Sender, tracking_node
from node_bench import child, tracker_arguments, WAY
from rosgraph_msgs.msg import Clock

HOUR = 3600 * 10**9


def sent_with(stamps: Callable[[int, int], list[int]]) -> Callable[..., dict[str, Any]]:
    """Return a fault: `stamps(number, true stamp)` are those that an image is sent with."""
    def run(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
        with tracking_node(sender):
            def send(number: int) -> None:
                for one in stamps(number, sender.index * PERIOD):
                    sender.send(one)
            sender.stream(seconds, send)
            # From here on the stamps are right again.
            return sender.row([sender.recovery()])
    return run


def unstamped(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Send no stamps, as some drivers do, from the first image on."""
    sender.stamped = False
    with tracking_node(sender):
        sender.stream(seconds)
        return sender.row([sender.recovery()])


def bag_loops(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Send the same two seconds again and again; `init_box` applies in each loop."""
    length = 2 * RATE // WAY * WAY
    first, times = sender.index, []
    with child(*tracker_arguments('ours', 'gmpf', sender.box)):
        sender.bench.until(sender.publisher.get_subscription_count, 'the node was not found')
        for _ in range(max(2, round(seconds / 2))):
            sender.index = first - 1
            times.append(sender.recovery())
            sender.stream((length - (sender.index - first + 1)) / RATE)
        return sender.row(times[1:], loops=len(times) - 1)


def clock_jumps(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """
    Let a simulation's clock jump an hour ahead, and back, while images keep coming.

    At first the stamps don't jump, as those of a camera with a clock of its own; then they follow
    the clock. After that was set back, the target has to be selected again.
    """
    clock = sender.bench.node.create_publisher(Clock, '/clock', 10)

    def tick(offset: int) -> None:
        message = Clock()
        now = sender.index * PERIOD + offset
        message.clock.sec, message.clock.nanosec = divmod(now, 10**9)
        clock.publish(message)

    with tracking_node(sender, '-p', 'use_sim_time:=true'):
        def send(number: int) -> None:
            tick((0, HOUR, 0, -5 * 10**9)[4 * number // round(seconds * RATE)])
            sender.send()
        sender.stream(seconds, send)
        times = [sender.recovery()]
        for jump in (HOUR, -HOUR):
            sender.index += jump // PERIOD // WAY * WAY
            if jump < 0:
                # Until the node accepts that these aren't late frames.
                sender.stream(0.5)
                sender.select()
            tick(0)
            times.append(sender.recovery())
        row = sender.row(times, jumps=5)
    sender.bench.node.destroy_publisher(clock)
    return row


FAULTS = {
    'every frame twice': sent_with(lambda number, stamp: [stamp, stamp]),
    'every tenth frame one place late': sent_with(
        lambda number, stamp: [] if number % 10 == 8 else
        [stamp, stamp - PERIOD] if number % 10 == 9 else [stamp]),
    'every 40th stamp 75 ms early': sent_with(
        lambda number, stamp: [stamp - 75 * 10**6 * (number % 40 == 39)]),
    'every stamp zero, from the start': unstamped,
    'one stamp in ten zero': sent_with(lambda number, stamp: [stamp * (number % 10 != 9)]),
    'one stamp an hour ahead': sent_with(
        lambda number, stamp: [stamp + HOUR * (number == 20)]),
    'a bag that loops': bag_loops,
    'clock jumps, with use_sim_time': clock_jumps,
}
