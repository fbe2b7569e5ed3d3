"""
Camera on one machine, tracker on another: two network namespaces, joined by a virtual cable.

`.venv/bin/python benchmarks/two_machines.py` (as root, with iproute2 and nftables) writes
two_machines.json into docs/results: how many VGA images in colour at 30 Hz arrive, raw and
compressed, and how many bytes they take, over a good cable, one of low bandwidth, one that loses
packets, and ones with a delay.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from node_bench import Answers, Bench, compressed, scene, tracker_arguments
from rclpy.qos import QoSProfile, ReliabilityPolicy
from result_files import write_json
from vision_msgs.msg import Detection2DArray

ROOT = Path(__file__).resolve().parents[1]
RATE = 30
CAMERA, TRACKER = 'vtrack_camera', 'vtrack_tracker'


@dataclass(frozen=True)
class Cable:
    """
    The impairment of a cable: commands run in both namespaces, where DEVICE is its end.

    One with a `delay`, [s], is the process `slow_cable.py`, which also loses a share of packets.
    """

    commands: tuple[str, ...] = ()
    delay: float = 0.0
    loss: float = 0.0


CABLES = {
    'good': Cable(),
    '100 Mbit/s': Cable((
        'tc qdisc add dev DEVICE root tbf rate 100mbit burst 64kb latency 50ms',)),
    '1 % of the packets lost': Cable((
        'nft add table netdev loss',
        'nft add chain netdev loss in { type filter hook ingress device DEVICE priority 0 ; }',
        'nft add rule netdev loss in numgen random mod 100 < 1 drop')),
    '20 ms each way': Cable(delay=0.02),
    '20 ms, 0.1 % of the packets lost': Cable(delay=0.02, loss=0.001)}
STREAMS = (('raw', 'best_effort'), ('raw', 'reliable'), ('compressed', 'best_effort'),
           ('compressed', 'reliable'))


def run(command: str) -> str:
    """Run a command; return what it prints."""
    return subprocess.run(command.split(), check=True, capture_output=True, text=True).stdout


@contextmanager
def joined(cable: Cable) -> Iterator[None]:
    """Join two namespaces by a cable until the block ends."""
    carrier = None
    try:
        for name in (CAMERA, TRACKER):
            run(f'ip netns add {name}')
        if cable.delay:
            carrier = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name('slow_cable.py')), CAMERA, 'camera',
                 TRACKER, 'tracker', '--delay', str(cable.delay), '--loss', str(cable.loss)],
                stdout=subprocess.PIPE)
            assert carrier.stdout is not None
            carrier.stdout.readline()
        else:
            run(f'ip link add camera netns {CAMERA} type veth peer name tracker netns {TRACKER}')
        for name, device, address in ((CAMERA, 'camera', 1), (TRACKER, 'tracker', 2)):
            run(f'ip -n {name} addr add 10.77.0.{address}/24 dev {device}')
            for one in ('lo', device):
                run(f'ip -n {name} link set {one} up')
            for command in cable.commands:
                run(f'ip netns exec {name} ' + command.replace('DEVICE', device))
        yield
    finally:
        if carrier is not None:
            carrier.terminate()
            carrier.wait()
        for name in (CAMERA, TRACKER):
            subprocess.run(['ip', 'netns', 'del', name], capture_output=True)


def received_bytes() -> int:
    """Return the number of bytes that the tracker's machine has received."""
    return int(json.loads(run(f'ip -n {TRACKER} -s -j link show tracker'))[0]['stats64']['rx'][
        'bytes'])


def measure(cable: Cable, transport: str, reliability: str, seconds: float) -> dict[str, Any]:
    """Measure one stream over one cable."""
    environment = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
                   # Both namespaces have the same /dev/shm: exclude shared memory.
                   'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}
    _, box = scene(640, 480)
    with joined(cable):
        node = subprocess.Popen(
            ['ip', 'netns', 'exec', TRACKER, sys.executable, *tracker_arguments(
                'ours', 'gmpf', box, '-p', f'image_transport:={transport}')],
            env=environment, stderr=subprocess.DEVNULL)
        try:
            before = received_bytes()
            answer = subprocess.run(
                ['ip', 'netns', 'exec', CAMERA, sys.executable, __file__, '--camera', transport,
                 reliability, '--seconds', str(seconds)],
                env=environment, capture_output=True, text=True, timeout=60 + 3 * seconds)
            if answer.returncode:
                raise RuntimeError(answer.stderr)
            return {**json.loads(answer.stdout),
                    'mbit_s': 8e-6 * (received_bytes() - before) / seconds}
        finally:
            node.terminate()
            node.wait()


def send(transport: str, reliability: str, seconds: float) -> None:
    """Send images from within a namespace; print what came back as JSON."""
    bench = Bench()
    images: list[Any] = scene(640, 480)[0]
    if transport == 'compressed':
        images = [compressed(one) for one in images]
    answers, missing = Answers(), list[int]()
    publisher = bench.node.create_publisher(
        type(images[0]), '/ours/image' + '/compressed' * (transport == 'compressed'),
        QoSProfile(depth=5, reliability=getattr(ReliabilityPolicy, reliability.upper())))
    hearing = [bench.node.create_subscription(Detection2DArray, '/ours/detections',
                                              answers.hear, 100),
               bench.node.create_subscription(
                   DiagnosticStatus, '/ours/tracker/state', lambda message: missing.extend(
                       int(row.value) for row in message.values if row.key == 'frames_missing'),
                   100)]
    bench.until(lambda: publisher.get_subscription_count()
                and all(one.get_publisher_count() for one in hearing), 'no node was found')
    count, began = round(RATE * seconds), time.perf_counter()
    for number in range(1, count + 1):
        # `init_box` is for the first image, which may be lost: repeat it until there is a box.
        image = images[number % len(images) if answers.found else 0]
        answers.send(publisher, image, number * 10**9 // RATE)
        bench.rest(began + number / RATE - time.perf_counter())
    bench.rest(1.5)
    p50, p99 = answers.percentiles()
    print(json.dumps({'sent': count, 'answered': len(answers.latency_ms), 'found': answers.found,
                      'reported_missing': missing[-1] if missing else None,
                      'ms_p50': p50, 'ms_p99': p99}))
    bench.close()


def main() -> int:
    """Measure all streams over all cables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--seconds', type=float, default=10.0, help='of each stream')
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results', metavar='DIR')
    parser.add_argument('--camera', nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.camera:
        send(*arguments.camera, arguments.seconds)
        return 0
    missing = [tool for tool in ('ip', 'tc', 'nft') if shutil.which(tool) is None]
    if missing or os.geteuid():
        print(f'two machines need root, and ip, tc and nft of iproute2 and nftables; missing: '
              f'{", ".join(missing) or "root"}', file=sys.stderr)
        return 2
    results: dict[str, Any] = {'seconds': arguments.seconds, 'cables': {}}
    for name, cable in CABLES.items():
        results['cables'][name] = {}
        for transport, reliability in STREAMS:
            row = measure(cable, transport, reliability, arguments.seconds)
            print(name, transport, reliability, row, flush=True)
            results['cables'][name][f'{transport}, {reliability}'] = row
    write_json(arguments.out / 'two_machines.json', results)
    return 0


if __name__ == '__main__':
    sys.exit(main())
