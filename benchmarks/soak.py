"""
The node for a long time at VGA and 60 Hz: does it grow, slow down, or keep what it opened.

`.venv/bin/python benchmarks/soak.py [--minutes M]` writes soak.json and reliability.md into
docs/results. The figures of each minute are from /proc and from the boxes that were received.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass
import os
from pathlib import Path
import signal
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from fault_scenarios.page import page
from node_bench import (
    Answers, Bench, child, cpu_seconds, rss_mb, scene, target_box, tracker_arguments)
import numpy as np
from result_files import write_json
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from vtrack_ros.dds import reserve_domain, with_profile

ROOT = Path(__file__).resolve().parents[1]
WIDTH, HEIGHT = 640, 480
#: Number of times that the node is halted for a second before the first window.
_HALTS = 3


@dataclass(frozen=True)
class Window:
    """Figures of one window of a soak, by default a minute; memory is that at its end."""

    sent: int
    answered: int
    found: int
    #: The least overlap of a box with the target.
    least_iou: float
    latency_ms_p50: float
    latency_ms_p99: float
    compute_ms_p50: float
    cpu_ms_per_frame: float
    rss_mb: float
    private_mb: float
    descriptors: int
    threads: int
    #: Steal time: share of the machine's processor time that its host gave to others.
    stolen: float


def machine_ticks() -> tuple[int, int]:
    """Return the machine's steal time and its whole processor time, in ticks."""
    ticks = [int(one) for one in Path('/proc/stat').read_text().split('\n', 1)[0].split()[1:9]]
    return ticks[7], sum(ticks)


def least_iou(answers: Answers, period: int) -> float:
    """Return the least overlap of the boxes with the target; 0 where none was found."""
    return min((box.iou(target_box(stamp // period, WIDTH, HEIGHT))
                for stamp, box in answers.boxes.items()), default=0.0)


def soak(bench: Bench, windows: int, seconds: float, rate: float,
         tell: Any = lambda window: None) -> list[Window]:
    """Send images to a node for `windows` windows of `seconds` each; return their figures."""
    images, box = scene(WIDTH, HEIGHT)
    period = round(1e9 / rate)
    answers, compute = Answers(), list[float]()

    def on_state(message: Any) -> None:
        compute.extend(float(row.value) for row in message.values if row.key == 'ms_per_frame')

    publisher = bench.node.create_publisher(Image, '/ours/image', 10)
    hearing = [bench.node.create_subscription(kind, topic, hear, 1000) for kind, topic, hear in (
        (Detection2DArray, '/ours/detections', answers.hear),
        (DiagnosticStatus, '/ours/tracker/state', on_state))]
    results = []
    # few images are kept for selections: all that are kept by default take the heap ten seconds
    few = ('-p', 'history_megabytes:=16.0')
    with child(*tracker_arguments('ours', 'gmpf', box, *few)) as process:
        bench.until(lambda: publisher.get_subscription_count()
                    and all(one.get_publisher_count() for one in hearing), 'no node was found')
        count, number = round(seconds * rate), 0

        def send() -> None:
            nonlocal number
            number += 1
            answers.send(publisher, images[number % len(images)], number * period)
        while not answers.found:
            # `init_box` is for the first image, whichever copy of it arrives first.
            number += len(images)
            answers.send(publisher, images[0], number * period)
            bench.executor.spin_once(timeout_sec=0.1)
        # While the node is halted, its queues fill: the camera's shared memory in them counts as
        # the node's from its first use on, and so isn't taken for growth later.
        for _ in range(_HALTS):
            process.send_signal(signal.SIGSTOP)
            for _ in range(round(rate)):
                send()
                time.sleep(1 / rate)
            process.send_signal(signal.SIGCONT)
            bench.rest(1.0)
        due = time.perf_counter()
        for _ in range(windows):
            answers.clear()
            compute.clear()
            cpu, before = cpu_seconds(process.pid), machine_ticks()
            for _ in range(count):
                send()
                due += 1 / rate
                bench.rest(due - time.perf_counter())
            # Time for the answers to the last images.
            bench.rest(0.2)
            due = time.perf_counter()
            stolen, all_ticks = np.subtract(machine_ticks(), before)
            answered = len(answers.latency_ms)
            window = Window(
                count, answered, answers.found, least_iou(answers, period),
                *answers.percentiles(),
                float(np.median(compute)) if compute else float('nan'),
                1e3 * (cpu_seconds(process.pid) - cpu) / max(1, answered), rss_mb(process.pid),
                rss_mb(process.pid, 'RssAnon'),
                len(os.listdir(f'/proc/{process.pid}/fd')),
                len(os.listdir(f'/proc/{process.pid}/task')), float(stolen / max(1, all_ticks)))
            tell(window)
            results.append(window)
    for one in hearing:
        bench.node.destroy_subscription(one)
    bench.node.destroy_publisher(publisher)
    return results


def main() -> int:
    """Run the soak, and write the results after each minute, so that it can be interrupted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--minutes', type=int, default=60)
    parser.add_argument('--rate', type=float, default=60.0, metavar='HZ')
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results')
    arguments = parser.parse_args()
    guard = reserve_domain()
    os.environ.update(with_profile(os.environ))
    bench = Bench()
    rows: list[dict[str, Any]] = []

    def keep(window: Window) -> None:
        rows.append(asdict(window))
        print(window, flush=True)
        write_json(arguments.out / 'soak.json', {
            'date': time.strftime('%Y-%m-%d'), 'rate_hz': arguments.rate, 'minutes': rows})
        (arguments.out / 'reliability.md').write_text(page(arguments.out), encoding='utf-8')
    soak(bench, arguments.minutes, 60.0, arguments.rate, keep)
    bench.close()
    guard.close()
    return 0


if __name__ == '__main__':
    sys.exit(main())
