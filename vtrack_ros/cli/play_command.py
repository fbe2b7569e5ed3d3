"""`vtrack play`: publish a bag over ROS."""

import argparse
import json
from pathlib import Path
import sys

from vtrack_ros.bags import BagReader
from vtrack_ros.bags.player import Pace, Played, Player
from vtrack_ros.cli.arguments import duration, positive_number
from vtrack_ros.cli.command_line import warn
from vtrack_ros.cli.load_ros import load_rclpy
from vtrack_ros.dds import leave
from vtrack_ros.signals import handling_signals, StopRequest

EXAMPLES = """examples:
  vtrack play bags/face_fast
  vtrack play bags/face_fast --loop --rate 0.5 --clock
  vtrack play BAG --topic camera/left --remap camera/left:=image

Reads rosbag2 (mcap, sqlite3) and ROS 1 bags; ros2 bag isn't needed. The messages keep their
recorded stamps. Ctrl-C ends it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('bag', type=Path, metavar='BAG',
                        help='a rosbag2 folder, .mcap, .db3 or ROS 1 .bag')
    parser.add_argument('--rate', type=positive_number, default=1.0, metavar='R',
                        help='speed: 2 plays twice as fast (default: %(default)s)')
    parser.add_argument('--loop', action='store_true', help='repeat the bag until Ctrl-C')
    parser.add_argument('--clock', type=positive_number, nargs='?', const=40.0, default=0.0,
                        metavar='HZ', help="publish the bag's time on /clock, at 40 Hz or at HZ, "
                        'and before each image')
    parser.add_argument('--topic', '--topics', nargs='+', metavar='T', action='extend',
                        help='publish only these topics (default: all)')
    parser.add_argument('--remap', nargs='+', type=_remap, action='extend', default=[],
                        metavar='FROM:=TO', help='publish a topic under another name')
    parser.add_argument('--qos', choices=('auto', 'reliable', 'best_effort'), default='auto',
                        help='reliability of the publishers; auto: as recorded '
                        '(default: %(default)s)')
    parser.add_argument('--wait', type=duration, default=5.0, metavar='SECONDS',
                        help='longest time to wait for a subscriber to the images, and for it to '
                        'receive the first one (default: %(default)s; 0: do not wait)')
    parser.add_argument('--json', action='store_true', help='print the final count as JSON')


def run(arguments: argparse.Namespace) -> int:
    """Publish the bag; return 0, or 128 + the number of a signal that ended it without --loop."""
    caught: list[int] = []
    stop = StopRequest()

    def end(number: int, _: object) -> None:
        caught.append(number)
        stop.make()

    with BagReader(arguments.bag) as bag:
        warn('vtrack play', bag.notice)
        rclpy = load_rclpy('playing')
        # Until ROS is shut down, a signal only requests a stop: the player ends between two
        # messages and prints its count. A second signal mustn't leave shared memory behind.
        with handling_signals(end):
            context = rclpy.context.Context()
            # No arguments: ROS would parse ours as its own, and remap the topics a second time.
            rclpy.init(args=[], context=context,
                       signal_handler_options=rclpy.SignalHandlerOptions.NO)
            node = rclpy.create_node('vtrack_play', context=context)
            try:
                with Player(node, bag, arguments.topic, dict(arguments.remap), arguments.qos, stop,
                            Pace(arguments.rate, arguments.loop, arguments.clock)) as player:
                    _play(player, bag, arguments)
            finally:
                leave(node)
                rclpy.try_shutdown(context=context)
    return 128 + caught[0] if caught and not arguments.loop else 0


def _play(player: Player, bag: BagReader, arguments: argparse.Namespace) -> None:
    published = [player.published_name(topic.name) for topic in player.topics]
    # With --json, standard output has the JSON alone.
    stream = sys.stderr if arguments.json else sys.stdout
    for reason in player.skipped:
        print(f'vtrack play: skipped {reason}', file=sys.stderr)
    for topic, name in zip(player.topics, published):
        print(f'{name}: {topic.count} {topic.message_type}', file=stream)
    print(f'{arguments.bag}: {bag.duration / arguments.rate:.2f} s', file=stream, flush=True)
    if arguments.wait and not (player.wait_for_subscribers(arguments.wait) or player.stop.made()):
        print(f'no node has subscribed within {arguments.wait:g} s: playing anyway',
              file=stream, flush=True)
    played = player.play(arguments.wait)
    _report(played, arguments.json)


def _report(played: Played, as_json: bool) -> None:
    if as_json:
        print(json.dumps({'images': played.images, 'messages': played.counts,
                          'seconds': round(played.seconds, 3)}), flush=True)
        return
    listed = ', '.join(f'{count} on {topic}' for topic, count in played.counts.items())
    print(f'published {played.images} images in {played.seconds:.2f} s: {listed}', flush=True)


def _remap(text: str) -> tuple[str, str]:
    old, separator, new = text.partition(':=')
    if not (old and separator and new):
        raise argparse.ArgumentTypeError(f'must be FROM:=TO, not {text!r}')
    return old, new
