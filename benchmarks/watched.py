"""
Latency of the node while its page is watched, and while it isn't.

`python benchmarks/watched.py [--seconds S]` writes docs/results/watched.md: VGA in colour at 30
Hz. The page's server always runs; in turns there is no viewer, or one that takes every picture at
once. A real browser also draws it, wherever that runs. Run this on an otherwise idle machine.
"""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import date
import json
import os
from pathlib import Path
import platform
import signal
import subprocess
import sys
import time

import aiohttp
from geometry_msgs.msg import PoseStamped
from node_bench import Bench, child, cpu_seconds, scene, tracker_arguments
import numpy as np
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image

from vtrack_ros.dds import reserve_domain, with_profile

ROOT = Path(__file__).resolve().parents[1]
RATE = 30
#: Cases that are measured in turns, and number of blocks of each.
CASES, BLOCKS = ('not watched', 'watched', 'watched with particles'), 4


async def view(address: str, particles: bool) -> None:
    """Take pictures from a page until SIGTERM; print their number."""
    count, stop = 0, asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)

    async def take() -> None:
        nonlocal count
        async with aiohttp.ClientSession() as session, session.ws_connect(
                f'{address}ws', max_msg_size=0) as socket:
            await socket.send_json({'do': 'particles', 'on': particles})
            async for message in socket:
                if message.type is aiohttp.WSMsgType.BINARY:
                    count += 1
                    await socket.send_json({'do': 'shown'})
    task = asyncio.create_task(take())
    await stop.wait()
    task.cancel()
    print(count)


@contextmanager
def viewer(address: str, case: str) -> Iterator[list[int]]:
    """Watch a page, or not; at the end the list gets the number of pictures."""
    taken: list[int] = []
    if case == CASES[0]:
        yield taken
        return
    process = subprocess.Popen(
        [sys.executable, __file__, '--view', address, *(['--particles'] * (case == CASES[2]))],
        stdout=subprocess.PIPE, text=True)
    yield taken
    process.send_signal(signal.SIGTERM)
    taken.append(int(process.communicate()[0]))


def measure(seconds: float) -> dict[str, dict[str, float]]:
    """Return latency, CPU of the node and the pictures a second of each case."""
    messages, box = scene(640, 480)
    bench = Bench()
    began: list[int] = []
    latency: list[float] = []
    first, period = 1, round(1e9 / RATE)

    def on_pose(message: PoseStamped) -> None:
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        index = round(stamp / period) - first
        if 0 <= index < len(began):
            latency.append((time.perf_counter_ns() - began[index]) / 1e6)
    publisher = bench.node.create_publisher(Image, '/ours/image', QoSProfile(depth=10))
    hearing = bench.node.create_subscription(PoseStamped, '/ours/pose', on_pose, 100)
    results = {case: {'latency': [], 'cpu': [], 'pictures': 0.0, 'answered': 0} for case in CASES}
    page = subprocess.Popen(
        [sys.executable, '-m', 'vtrack_ros.cli.command_line', 'select', '/ours/tracker', '--port',
         '0'], stdout=subprocess.PIPE, text=True, env=with_profile(os.environ))
    with child(*tracker_arguments('ours', 'gmpf', box)) as node:
        assert page.stdout is not None
        address = page.stdout.readline().strip()
        bench.until(lambda: publisher.get_subscription_count() and hearing.get_publisher_count(),
                    'the node was not found')
        for block in range(-1, BLOCKS):
            for case in CASES:
                with viewer(address, case) as taken:
                    # The first stretch is the viewer's warm-up; its latency isn't counted.
                    for count in (3 * RATE, int(seconds * RATE / BLOCKS)):
                        began.clear()
                        latency.clear()
                        cpu, clock = cpu_seconds(node.pid), time.perf_counter()
                        bench.stream(publisher, messages, RATE, count, began, first)
                        cpu = (cpu_seconds(node.pid) - cpu) / (time.perf_counter() - clock)
                        first += count
                if block >= 0:
                    result = results[case]
                    result['latency'] += latency
                    result['cpu'].append(cpu)
                    result['pictures'] += sum(taken)
    page.send_signal(signal.SIGINT)
    page.wait()
    bench.close()
    sent = BLOCKS * int(seconds * RATE / BLOCKS)
    return {case: {
        'p50': float(np.percentile(result['latency'], 50)),
        'p99': float(np.percentile(result['latency'], 99)),
        'answered': len(result['latency']), 'sent': sent, 'cpu': float(np.mean(result['cpu'])),
        'pictures': result['pictures'] / (sent / RATE + 3 * BLOCKS)}
        for case, result in results.items()}


def write(figures: dict[str, dict[str, float]], load: float) -> None:
    """Write the page."""
    lines = [
        '# Latency while the page is watched', '',
        f'`benchmarks/watched.py`, `gmpf`, VGA in colour at {RATE} Hz, {date.today()}, '
        f'{os.cpu_count()} cores, {platform.machine()}; load average at the start {load:.1f}. '
        "Node, publisher, the page's server and a viewer that takes every picture at once all run "
        'on this machine; cases in turns. A picture is sent again with each newer state.', '',
        '| | image to pose p50, ms | p99 | answered | CPU of the node | pictures a second |',
        '| --- | ---: | ---: | ---: | ---: | ---: |']
    lines += [
        f'| {case} | {row["p50"]:.2f} | {row["p99"]:.2f} | {row["answered"]} of {row["sent"]} | '
        f'{100 * row["cpu"]:.0f} % | {row["pictures"]:.0f} |' for case, row in figures.items()]
    (ROOT / 'docs' / 'results' / 'watched.md').write_text('\n'.join(lines) + '\n')


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=40.0)
    parser.add_argument('--view')
    parser.add_argument('--particles', action='store_true')
    options = parser.parse_args()
    if options.view:
        asyncio.run(view(options.view, options.particles))
    else:
        busy = os.getloadavg()[0]
        with reserve_domain():
            os.environ.update(with_profile(os.environ))
            found = measure(options.seconds)
        write(found, busy)
        print(json.dumps(found, indent=1))
