"""Faults of processes: they are killed, and started again."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any

from fault_scenarios.sender import PATIENCE, PERIOD, Sender, show_target
from node_bench import Bench, child, tracker_arguments, WAY

from vtrack_ros.dds import with_profile

#: The script that sends images when it's called with `--camera`.
SCRIPT = Path(__file__).resolve().parents[1] / 'faults.py'


def publisher_killed(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Let another process send the images, and kill it."""
    sender.elsewhere = True
    with child(*tracker_arguments('ours', 'gmpf', sender.box)):
        sender.clear()
        times = []
        for kill in range(kills + 1):
            process = subprocess.Popen([sys.executable, str(SCRIPT), '--camera'],
                                       env=with_profile(os.environ), stdout=subprocess.PIPE)
            assert process.stdout is not None
            # When its first image is sent, on the wall clock.
            began, sender.last_right = int(process.stdout.readline()) * PERIOD / 1e9, 0.0
            while not sender.last_right and time.time() - began < PATIENCE:
                sender.bench.executor.spin_once(timeout_sec=0.1)
            if kill:
                times.append(time.time() - began if sender.last_right else float('inf'))
            sender.bench.rest(0.5)
            process.kill()
            process.wait()
            # Late answers to its images mustn't count as answers to the next one's.
            sender.bench.rest(0.3)
    return sender.row(times, kills=kills)


def send_as_camera() -> None:
    """Send images with the wall clock's stamps until the process is killed."""
    bench = Bench()
    sender = Sender(bench)
    bench.until(sender.publisher.get_subscription_count, 'the node was not found')
    sender.index = time.time_ns() // PERIOD // WAY * WAY + WAY
    print(sender.index, flush=True)
    sender.bench.rest(max(0.0, sender.index * PERIOD / 1e9 - time.time()))
    sender.index -= 1
    sender.stream(3600)


def node_killed(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Kill the node, and start it again as a supervisor would, while images keep coming."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        arguments = tracker_arguments('ours', 'gmpf', sender.box, '-p',
                                      f'state_file:={folder}/target.json')
        for kill in range(kills + 1):
            process = subprocess.Popen([sys.executable, *arguments], stderr=subprocess.DEVNULL,
                                       env=with_profile(os.environ))
            if kill:
                times.append(sender.recovery())
            else:
                sender.bench.until(sender.publisher.get_subscription_count, 'no node was found')
                show_target(sender)
            sender.stream(2.0)
            process.kill()
            process.wait()
    return sender.row(times, kills=kills)


FAULTS = {
    'publisher killed and restarted': publisher_killed,
    'node killed and restarted, with state_file': node_killed,
}
