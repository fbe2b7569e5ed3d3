"""
What arrives where neither the camera nor the node has the Fast DDS profile.

`.venv/bin/python benchmarks/default_transport.py [--seconds S]` writes
docs/results/default_transport.md: how many images of a camera were answered, raw and compressed,
large and small, from a driver that sends best effort and from one that sends reliable.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import sys

from node_bench import Answers, Bench, child, compressed, scene, tracker_arguments
from rclpy.qos import QoSProfile, ReliabilityPolicy
from result_files import facts_text
from sensor_msgs.msg import CompressedImage, Image
from vision_msgs.msg import Detection2DArray

from vtrack_ros.dds import reserve_domain, VARIABLES, with_profile
from vtrack_ros.evaluation.results_json import environment
from vtrack_ros.evaluation.table import markdown

ROOT = Path(__file__).resolve().parents[1]
RATE = 30


def jpeg(width: int, height: int) -> int:
    """Return the size of a compressed image of the scene, [KiB]."""
    return len(compressed(scene(width, height)[0][0]).data) // 1024


def answered(bench: Bench, size: tuple[int, int], transport: str, reliability: ReliabilityPolicy,
             seconds: float, node_alone: bool = False) -> str:
    """Return how many images are answered; with `node_alone`, the node has the profile."""
    images, box = scene(*size)
    kind, topic = Image, '/ours/image'
    if transport == 'compressed':
        images = [compressed(one) for one in images]
        kind, topic = CompressedImage, f'{topic}/compressed'
    answers = Answers()
    publisher = bench.node.create_publisher(
        kind, topic, QoSProfile(depth=5, reliability=reliability))
    hearing = bench.node.create_subscription(
        Detection2DArray, '/ours/detections', answers.hear, 1000)
    arguments = tracker_arguments('ours', 'gmpf', box, '-p', f'image_transport:={transport}')
    surroundings = with_profile(os.environ) if node_alone else os.environ
    with child(*arguments, environment=surroundings):
        bench.until(lambda: publisher.get_subscription_count() and hearing.get_publisher_count(),
                    'no node was found')
        # the subscription has adapted to the publisher's reliability by then
        bench.rest(2.0)
        count = round(seconds * RATE)
        for number in range(1, count + 1):
            answers.send(publisher, images[number % len(images)], number * round(1e9 / RATE))
            bench.rest(1 / RATE)
        bench.rest(1.0)
    bench.node.destroy_publisher(publisher)
    bench.node.destroy_subscription(hearing)
    return f'{len(answers.latency_ms)} of {count}'


def main() -> int:
    """Measure all combinations, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--seconds', type=float, default=10.0)
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results')
    arguments = parser.parse_args()
    guard = reserve_domain()
    for name in VARIABLES:
        os.environ.pop(name, None)
    bench = Bench()
    weak, strong = ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE
    rows = [['images', 'best effort', 'reliable']]
    for size, transport, alone in (
            ((640, 480), 'raw', False), ((640, 480), 'raw', True), ((320, 240), 'raw', False),
            ((640, 480), 'compressed', False), ((1280, 720), 'compressed', False)):
        name = f'{size[0]} x {size[1]}, {transport}' + (', the node has the profile' * alone)
        rows.append([name, *(answered(bench, size, transport, policy, arguments.seconds, alone)
                             for policy in (weak, strong))])
        print(rows[-1], flush=True)
    bench.close()
    guard.close()
    (arguments.out / 'default_transport.md').write_text(f"""\
# Without the Fast DDS profile

`benchmarks/default_transport.py`: how many images of a camera at {RATE} Hz the node answered. The
driver doesn't have the profile, so it has 512 KiB of shared memory. {facts_text(environment())}.

{markdown(rows)}

A raw image in colour has 900 KiB at 640 x 480 and 225 KiB at 320 x 240. A compressed image of this
drawn scene has {jpeg(640, 480)} KiB at 640 x 480 and {jpeg(1280, 720)} KiB at 1280 x 720.
""", encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
