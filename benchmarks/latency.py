"""
Latency, loss, CPU and memory of the node, beside a node that does nothing.

`.venv/bin/python benchmarks/latency.py [--tracker T] [--seconds S]` writes latency.json and
latency.md into docs/results. The null node takes the image and publishes a pose at once; it's
measured in alternation with ours, block by block, so that both have the same conditions. Run it on
an otherwise idle machine.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
import os
from pathlib import Path
import platform
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseArray, PoseStamped
from node_bench import (
    Bench, child, cpu_seconds, PATIENCE, rss_mb, scene, tracker_arguments)
import numpy as np
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from result_files import write_json
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from vtrack_ros.dds import reserve_domain, with_profile

ROOT = Path(__file__).resolve().parents[1]
#: Width, height and rate of the streams.
STREAMS = ((640, 480, 30), (640, 480, 60), (640, 480, 120), (1920, 1080, 30))
#: Blocks per node and stream; null node and ours take turns.
BLOCKS = 3


@dataclass
class Measured:
    """What was measured of one node on one stream."""

    sent: int = 0
    answered: int = 0
    latency: list[float] = field(default_factory=list)
    compute: list[float] = field(default_factory=list)
    cpu_seconds: float = 0.0
    seconds: float = 0.0
    rss_mb: float = 0.0

    def summary(self) -> dict[str, float]:
        """Return the figures."""
        p50, p99 = np.percentile(self.latency, (50, 99)) if self.latency else (float('nan'),) * 2
        return {
            'frames_sent': self.sent, 'frames_answered': self.answered or len(self.latency),
            'latency_ms_p50': float(p50), 'latency_ms_p99': float(p99),
            'compute_ms_p50': float(np.median(self.compute)) if self.compute else 0.0,
            'cpu_share': self.cpu_seconds / max(1e-9, self.seconds), 'rss_mb': self.rss_mb}


def measure_stream(bench: Bench, width: int, height: int, rate: int, tracker: str,
                   seconds: float) -> dict[str, dict[str, float]]:
    """Measure null node and ours in turn on one stream."""
    messages, box = scene(width, height)
    names = ('null', 'ours')
    results = {name: Measured() for name in names}
    began: list[int] = []
    period = round(1e9 / rate)
    measured = results['null']
    first = 0

    def on_pose(message: Any) -> None:
        now = time.perf_counter_ns()
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        index = round(stamp / period) - first
        if 0 <= index < len(began):
            measured.latency.append((now - began[index]) / 1e6)

    def on_state(message: Any) -> None:
        values = {row.key: row.value for row in message.values}
        # A frame is answered whether the target is in sight or not.
        if 'ms_per_frame' in values:
            measured.answered += 1
            measured.compute.append(float(values['ms_per_frame']))

    node = bench.node
    publishers = {name: node.create_publisher(Image, f'/{name}/image', QoSProfile(depth=10))
                  for name in names}
    poses = [node.create_subscription(PoseStamped, f'/{name}/pose', on_pose, 100)
             for name in names]
    state = node.create_subscription(DiagnosticStatus, '/ours/tracker/state', on_state, 100)
    with child(str(Path(__file__).with_name('null_node.py'))) as null, child(
            *tracker_arguments('ours', tracker, box)) as ours:
        bench.until(lambda: all(p.get_subscription_count() for p in publishers.values())
                    and all(p.get_publisher_count() for p in poses)
                    and state.get_publisher_count(), 'the nodes were not found')
        pids = {'null': null.pid, 'ours': ours.pid}
        for block in range(-1, BLOCKS):
            for name in names:
                # The first block is a warm-up and isn't counted.
                measured = Measured() if block < 0 else results[name]
                began = []
                count = int(rate * (1.0 if block < 0 else seconds / BLOCKS))
                cpu, clock = cpu_seconds(pids[name]), time.perf_counter()
                bench.stream(publishers[name], messages, rate, count, began, first)
                measured.seconds += time.perf_counter() - clock
                measured.cpu_seconds += cpu_seconds(pids[name]) - cpu
                measured.sent += count
                measured.rss_mb = max(measured.rss_mb, rss_mb(pids[name]))
                first += count
    for subscription in (*poses, state):
        node.destroy_subscription(subscription)
    for publisher in publishers.values():
        node.destroy_publisher(publisher)
    return {name: result.summary() for name, result in results.items()}


def measure_delivery(bench: Bench, tracker: str, seconds: float) -> dict[str, dict[str, float]]:
    """Count the answers to VGA at 30 Hz from a best-effort and from a reliable publisher."""
    messages, box = scene(640, 480)
    figures = {}
    for policy in (ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE):
        answers: list[Any] = []
        namespace = policy.name.lower()
        publisher = bench.node.create_publisher(
            Image, f'/{namespace}/image', QoSProfile(depth=10, reliability=policy))
        hearing = bench.node.create_subscription(
            Detection2DArray, f'/{namespace}/detections', answers.append, 1000)
        with child(*tracker_arguments(namespace, tracker, box)):
            bench.until(lambda: publisher.get_subscription_count()
                        and hearing.get_publisher_count(), 'the node was not found')
            count = int(30 * seconds)
            bench.stream(publisher, messages, 30, count, [], 1)
        bench.node.destroy_subscription(hearing)
        bench.node.destroy_publisher(publisher)
        figures[namespace] = {'frames_sent': count, 'frames_answered': len(answers),
                              'delivered_share': len(answers) / count}
    return figures


def measure_parameters(bench: Bench, tracker: str, changes: int) -> dict[str, float]:
    """Time from the return of a parameter call to the first result that shows it."""
    messages, box = scene(640, 480)
    clouds: list[tuple[float, int]] = []
    publisher = bench.node.create_publisher(Image, '/tuned/image', 10)
    hearing = bench.node.create_subscription(
        PoseArray, '/tuned/tracker/particles',
        lambda message: clouds.append((time.perf_counter(), len(message.poses))), 100)
    client = AsyncParameterClient(bench.node, '/tuned/tracker')
    delays, frames = [], []
    with child(*tracker_arguments('tuned', tracker, box)):
        bench.until(lambda: publisher.get_subscription_count() and hearing.get_publisher_count(),
                    'the node was not found')
        client.wait_for_services(PATIENCE)
        sent = 0
        for number in range(changes):
            wanted = 100 + number % 50
            future = client.set_parameters(
                [Parameter(f'{tracker}.particles', value=wanted)])
            bench.until(future.done, 'no answer to a parameter call')
            returned = time.perf_counter()
            clouds.clear()
            due = returned
            before = sent
            while not any(size == wanted for _, size in clouds):
                if time.perf_counter() >= due:
                    sent += 1
                    message = messages[sent % len(messages)]
                    message.header.stamp.sec, message.header.stamp.nanosec = divmod(
                        sent * 33_333_333, 10**9)
                    publisher.publish(message)
                    due += 1 / 30
                bench.executor.spin_once(timeout_sec=max(0.0, due - time.perf_counter()))
            when = next(moment for moment, size in clouds if size == wanted)
            delays.append((when - returned) * 1e3)
            frames.append(sent - before)
    bench.node.destroy_subscription(hearing)
    bench.node.destroy_publisher(publisher)
    p50, p99 = np.percentile(delays, (50, 99))
    return {'changes': changes, 'ms_p50': float(p50), 'ms_p99': float(p99),
            'frames_max': max(frames)}


def measure_four(bench: Bench, seconds: float) -> dict[str, dict[str, float]]:
    """Run four trackers in four namespaces on one VGA stream at 30 Hz."""
    trackers = ('gmpf', 'pqkpf', 'abmspf', 'appf')
    messages, box = scene(640, 480)
    publisher = bench.node.create_publisher(Image, '/camera/image', 10)
    began: list[int] = []
    latency: dict[str, list[float]] = {name: [] for name in trackers}
    missing = dict.fromkeys(trackers, 0)
    hearing = []

    def pose_hearer(name: str) -> Any:
        def on_pose(message: Any) -> None:
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            index = round(stamp * 30 / 1e9) - 1
            if 0 <= index < len(began):
                latency[name].append((time.perf_counter_ns() - began[index]) / 1e6)
        return on_pose

    def state_hearer(name: str) -> Any:
        def on_state(message: Any) -> None:
            values = {row.key: row.value for row in message.values}
            missing[name] = int(values['frames_missing'])
        return on_state

    with ExitStack() as nodes:
        for name in trackers:
            nodes.enter_context(child(
                *tracker_arguments(name, name, box, '-r', 'image:=/camera/image')))
            hearing.append(bench.node.create_subscription(
                PoseStamped, f'/{name}/pose', pose_hearer(name), 100))
            hearing.append(bench.node.create_subscription(
                DiagnosticStatus, f'/{name}/tracker/state', state_hearer(name), 100))
        bench.until(lambda: publisher.get_subscription_count() == len(trackers)
                    and all(row.get_publisher_count() for row in hearing), 'nodes are missing')
        count = int(30 * seconds)
        bench.stream(publisher, messages, 30, count, began, 1)
    figures = {}
    for name in trackers:
        p50, p99 = np.percentile(latency[name], (50, 99)) if latency[name] else (np.nan, np.nan)
        figures[name] = {
            'frames_sent': count, 'poses': len(latency[name]), 'reported_missing': missing[name],
            'latency_ms_p50': float(p50), 'latency_ms_p99': float(p99)}
    return figures


def page(results: dict[str, Any]) -> str:
    """Return the results as Markdown."""
    lines = [
        '# Latency of the node', '',
        f'`benchmarks/latency.py`, tracker {results["tracker"]}, {results["date"]}, '
        f'{results["machine"]}; load average at the start {results["load"]:.1f}.', '',
        'Latency from image to pose in ms; publisher and listener in one process, the node in '
        'another, shared memory profile. The null node publishes a pose for every image and does '
        "nothing else. *above* is our p50 minus that of the null node and minus the tracker's "
        'compute time (goal: at most 0.5). *lost* images had no answer.', '',
        '| stream | null p50 | null p99 | ours p50 | ours p99 | compute p50 | above | null lost | '
        'ours lost | CPU above null | RSS |',
        '| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |']
    for name, pair in results['streams'].items():
        null, ours = pair['null'], pair['ours']
        above = ours['latency_ms_p50'] - null['latency_ms_p50'] - ours['compute_ms_p50']
        lines.append(
            f'| {name} | {null["latency_ms_p50"]:.2f} | {null["latency_ms_p99"]:.2f} | '
            f'{ours["latency_ms_p50"]:.2f} | {ours["latency_ms_p99"]:.2f} | '
            f'{ours["compute_ms_p50"]:.2f} | {above:.2f} | '
            f'{null["frames_sent"] - null["frames_answered"]} of {null["frames_sent"]} | '
            f'{ours["frames_sent"] - ours["frames_answered"]} of {ours["frames_sent"]} | '
            f'{100 * (ours["cpu_share"] - null["cpu_share"]):.0f} % | {ours["rss_mb"]:.0f} MB |')
    lines += ['', '## Delivery, VGA at 30 Hz', '', '| publisher | answered |', '| --- | --- |']
    for name, row in results['delivery'].items():
        lines.append(f'| {name} | {row["frames_answered"]} of {row["frames_sent"]} |')
    row = results['parameters']
    lines += ['', '## Parameters', '',
              f'{row["changes"]} changes of the number of particles. Time from the return of the '
              f'call to the first result with the new number: p50 {row["ms_p50"]:.1f} ms, p99 '
              f'{row["ms_p99"]:.1f} ms, after at most {row["frames_max"]} frame(s).', '',
              '## Four trackers on one VGA stream at 30 Hz', '',
              '| tracker | poses | reported missing | p50 | p99 |',
              '| --- | --- | --- | --- | --- |']
    for name, row in results['four'].items():
        lines.append(
            f'| {name} | {row["poses"]} of {row["frames_sent"]} | {row["reported_missing"]} | '
            f'{row["latency_ms_p50"]:.1f} | {row["latency_ms_p99"]:.1f} |')
    return '\n'.join(lines) + '\n'


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print and write the results."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--tracker', default='gmpf')
    parser.add_argument('--seconds', type=float, default=15.0, help='per node and stream')
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results')
    options = parser.parse_args(argv)
    domain_guard = reserve_domain()
    os.environ.update(with_profile(os.environ))
    results: dict[str, Any] = {
        'tracker': options.tracker, 'date': time.strftime('%Y-%m-%d'),
        'machine': f'{os.cpu_count()} cores, {platform.machine()}, Python '
                   f'{platform.python_version()}', 'load': os.getloadavg()[0], 'streams': {}}
    bench = Bench()
    for width, height, rate in STREAMS:
        name = f'{width} x {height} at {rate} Hz'
        print(name, file=sys.stderr, flush=True)
        results['streams'][name] = measure_stream(
            bench, width, height, rate, options.tracker, options.seconds)
    print('delivery, parameters, four trackers', file=sys.stderr, flush=True)
    results['delivery'] = measure_delivery(bench, options.tracker, options.seconds)
    results['parameters'] = measure_parameters(bench, options.tracker, 100)
    results['four'] = measure_four(bench, options.seconds)
    options.out.mkdir(parents=True, exist_ok=True)
    write_json(options.out / 'latency.json', results)
    (options.out / 'latency.md').write_text(page(results))
    print(page(results))
    bench.close()
    domain_guard.close()
    return 0


if __name__ == '__main__':
    sys.exit(main())
