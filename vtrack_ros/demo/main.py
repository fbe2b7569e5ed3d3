"""Track a target in a recorded bag, with a real node, and show what came out."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
import os
from pathlib import Path
import sys
from typing import Any

from vtrack_ros.cli.arguments import box, negative_values, seed
from vtrack_ros.cli.main import in_words, Parser
from vtrack_ros.dds import reserve_domain
from vtrack_ros.demo.pictures import draw_run
from vtrack_ros.demo.processes import DemoError, run
from vtrack_ros.demo.summary import summarise
from vtrack_ros.evaluation.progress import ProgressBar
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import tracker_names

_ROOT = Path(__file__).resolve().parents[2]
_COMPRESSED = 'sensor_msgs/msg/CompressedImage'


def parser() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    result = Parser(
        prog='demo', description='Track a target in a recorded bag: a player, the node and a '
        'recorder run in three processes, and pictures of it go into a folder.')
    result.add_argument('--bag', type=Path, default=_ROOT / 'bags' / 'face_fast',
                        help='a rosbag2 folder, .mcap, .db3 or ROS 1 .bag (default: %(default)s)')
    result.add_argument('--topic', help='the image topic, where the bag has several')
    result.add_argument('--tracker', choices=tracker_names(), default='gmpf',
                        help='default: %(default)s')
    result.add_argument('--seed', type=seed, default=0,
                        help='of the random numbers (default: %(default)s)')
    result.add_argument('--init-box', type=box, metavar='X,Y,WIDTH,HEIGHT',
                        help="the target on the first frame, in pixels (default: the bag's truth)")
    result.add_argument('--json', type=Path, metavar='FILE', help='write the figures here as well')
    result.add_argument('--out', type=Path, default=Path('demo-output'), metavar='DIR',
                        help='where the pictures go (default: %(default)s)')
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo; return 0 if the target was tracked, 1 if not, 2 if it couldn't be tried."""
    words = sys.argv[1:] if arguments is None else arguments
    options = parser().parse_args(negative_values(words))
    from vtrack_ros.bags import BagError
    guard = None if 'ROS_DOMAIN_ID' in os.environ else reserve_domain()
    try:
        return _demonstrate(options)
    except (BagError, DemoError) as error:
        print(f'demo: {error}', file=sys.stderr)
        return 2
    except OSError as error:
        print(f'demo: {in_words(error)}', file=sys.stderr)
        return 2
    finally:
        if guard is not None:
            guard.close()


def _demonstrate(options: argparse.Namespace) -> int:
    from vtrack_ros.bags import BagReader
    with BagReader(options.bag) as bag:
        topic = bag.image_topic(options.topic)
        truth = bag.truth()
        first = next(iter(bag.frames(topic.name)))
    start = options.init_box or truth.get(first.stamp)
    if start is None:
        raise DemoError(f'{options.bag} does not say where the target is on the first frame: '
                        'give --init-box X,Y,WIDTH,HEIGHT')
    options.out.mkdir(parents=True, exist_ok=True)
    print(f'{options.bag.name}: {topic.count} images on {topic.name}, tracked by '
          f'{options.tracker}, seed {options.seed}')
    compressed = topic.message_type == _COMPRESSED
    node = _node_arguments(options.tracker, options.seed, start, topic.name, compressed)
    player = [str(options.bag), '--topic', topic.name]
    bars: list[ProgressBar] = []

    def answered(done: int) -> None:
        # The clock of the bar starts with the first frame.
        bars[:] = bars or [ProgressBar(sys.stderr, 'frames')]
        bars[0](done, topic.count)

    sent, frames, log = run(node, player, options.out / 'record.json', answered)
    (options.out / 'node.log').write_text(log + '\n')
    summary = summarise(frames, truth, sent)
    print(summary.table())
    for path in draw_run(options.bag, topic.name, frames, truth, options.out):
        print(f'see {path}')
    if options.json is not None:
        options.json.write_text(json.dumps(summary.as_json(), indent=2) + '\n')
    if not summary.tracked:
        print('demo: the target was not tracked', file=sys.stderr)
        return 1
    return 0


def _node_arguments(tracker: str, number: int, start: Box, topic: str,
                    compressed: bool) -> list[str]:
    values: dict[str, Any] = {
        'tracker': tracker, 'seed': number,
        'init_box': '[' + ', '.join(repr(value) for value in start.as_array().tolist()) + ']',
        'image_transport': 'compressed' if compressed else 'raw'}
    arguments = ['-r', f'{"image/compressed" if compressed else "image"}:={topic}']
    for name, value in values.items():
        arguments += ['-p', f'{name}:={value}']
    return arguments
