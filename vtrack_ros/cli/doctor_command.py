"""`vtrack doctor`: checks of what is installed and what arrives, with advice on each fault."""

import argparse
from collections.abc import Iterator
import os
from typing import Any

from vtrack_ros.cli import installation
from vtrack_ros.cli.arguments import duration
from vtrack_ros.cli.installation import Finding
from vtrack_ros.cli.load_ros import load_rclpy
from vtrack_ros.dds import leave

EXAMPLES = """examples:
  vtrack doctor
  vtrack doctor --seconds 10

Run it in the shell that the node or the camera driver is started from, while they run. The exit
code is 1 where something is wrong; a line with an arrow says what to do."""
#: Share of lost images above which a topic is reported as wrong.
_NOTABLE = 0.01


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('--seconds', type=duration, default=3.0, metavar='S',
                        help='how long to listen on the image topics (default: %(default)s)')


def run(arguments: argparse.Namespace) -> int:
    """Check, and print each finding at once; return 1 if something is wrong, else 0."""
    wrong = 0
    for finding in _findings(arguments.seconds):
        wrong += finding.wrong
        mark = 'wrong' if finding.wrong else 'note ' if finding.advice else 'ok   '
        print(f'{mark} {finding.text}', flush=True)
        if finding.advice:
            print(f'      -> {finding.advice}', flush=True)
    return int(wrong > 0)


def _findings(seconds: float) -> Iterator[Finding]:
    yield installation.versions()
    yield installation.trackers()
    yield from installation.libraries()
    # Before `load_rclpy`, which sets a profile for this process.
    profile = installation.profile(os.environ)
    unusable = installation.unusable_middleware(os.environ)
    if unusable is not None:
        yield unusable
        return
    try:
        rclpy = load_rclpy('the node')
        from vtrack_ros.ros.topic_survey import survey
    except ModuleNotFoundError as error:
        yield Finding(f'without ROS there are trackers, bags and evaluation, but no node: {error}',
                      'source /opt/ros/jazzy/setup.bash, or run scripts/setup')
        return
    context = rclpy.context.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node('vtrack_doctor', context=context, enable_rosout=False,
                             start_parameter_services=False)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield from _middleware(rclpy, profile)
        topics = survey(node, executor, seconds)
        for topic in topics:
            yield from _of_topic(topic)
        if not topics:
            yield Finding('nobody publishes images',
                          'start the camera driver, or vtrack play bags/face_fast --loop; where '
                          'one runs: is its ROS_DOMAIN_ID the same?')
    finally:
        executor.shutdown()
        leave(node)
        rclpy.try_shutdown(context=context)


def _middleware(rclpy: Any, profile: Finding) -> Iterator[Finding]:
    name = rclpy.get_rmw_implementation_identifier()
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    reach = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE') or 'SUBNET'
    yield Finding(f'middleware {name}, domain {domain}, discovery {reach.lower()}')
    if 'fastrtps' in name:
        yield profile
        yield installation.shared_memory()
    else:
        yield Finding(f'the profile of this package is for Fast DDS, not for {name}')
    try:
        import vision_msgs.msg  # noqa: F401
    except ImportError:
        yield Finding('vision_msgs is not installed: no boxes, no detections, no page',
                      'apt install ros-jazzy-vision-msgs, or run scripts/setup')


def _of_topic(topic: Any) -> Iterator[Finding]:
    kind = 'reliable' if topic.reliable else 'best effort'
    text = (f'{topic.name}: {kind}, from {", ".join(topic.publishers)} to '
            f'{", ".join(topic.subscribers) or "nobody"}')
    if not topic.received:
        # The middleware counts a lost message only when a later one arrives.
        yield Finding(f'{text}: no image came',
                      'does the driver run, and send? Large images may all be lost without '
                      f'the profile: start it with {installation.profile_setting()}', wrong=True)
        return
    text += f'; {topic.form}, {topic.rate:.1f} Hz'
    total = topic.received + topic.lost
    if topic.lost <= _NOTABLE * total:
        yield Finding(f'{text}, none of {total} lost' if not topic.lost else
                      f'{text}, {topic.lost} of {total} lost')
    else:
        advice = (f'start its driver with {installation.profile_setting()}: such images do not '
                  'fit into the shared memory of Fast DDS'
                  if topic.exceeds_shared_memory else
                  'is the processor busy, or the network? Smaller or compressed images help')
        yield Finding(f'{text}, {topic.lost} of {total} lost on the way', advice, wrong=True)
    if len(topic.publishers) > 1:
        yield Finding(f'{topic.name} has several publishers, which the node takes for one stream',
                      'remap all but one')
    for mismatch in topic.mismatches:
        yield Finding(f'{topic.name}: {mismatch}', "leave the node's reliability at auto, or "
                      'start both with the same type and QoS', wrong=True)
