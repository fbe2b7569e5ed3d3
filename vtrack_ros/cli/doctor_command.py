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

Run it while the node and the camera driver are running, in the shell that they were started from.
Lines with an arrow are advice. The exit code is 1 if a line begins with "wrong"."""
#: Share of lost images above which a topic is reported as wrong.
_NOTABLE = 0.01


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('--seconds', type=duration, default=3.0, metavar='S',
                        help='how long to listen on the image topics, in seconds; 0: do '
                        'not listen (default: %(default)s)')


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
        from vtrack_ros.ros.topic_survey import awaited, survey
    except ModuleNotFoundError as error:
        yield Finding(f'no ROS: trackers, bags and evaluation work, but not the node: {error}',
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
            yield from _of_topic(topic, seconds)
        if not topics:
            yield Finding('no node publishes images',
                          'start the camera driver, or vtrack play bags/face_fast --loop; if it '
                          'is running, check that its ROS_DOMAIN_ID is the same')
        yield from map(_of_awaited, awaited(node))
    finally:
        executor.shutdown()
        leave(node)
        rclpy.try_shutdown(context=context)


def _of_awaited(topic: Any) -> Finding:
    who = ', '.join(topic.subscribers)
    waits = 'waits' if len(topic.subscribers) == 1 else 'wait'
    others = (f', or remap the topic to one that is published: {", ".join(topic.published)}'
              if topic.published else '; no topic of its type is published')
    return Finding(f'{topic.name}: no node publishes it, but {who} {waits} for images on it',
                   f'start the camera driver{others}', wrong=True)


def _middleware(rclpy: Any, profile: Finding) -> Iterator[Finding]:
    name = rclpy.get_rmw_implementation_identifier()
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    reach = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE') or 'SUBNET'
    yield Finding(f'middleware {name}, domain {domain}, discovery {reach.lower()}')
    if 'fastrtps' in name:
        yield profile
        yield installation.shared_memory()
    else:
        yield Finding(f'the profile of this package is not used: it is for Fast DDS, not {name}')
    try:
        import vision_msgs.msg  # noqa: F401
    except ImportError:
        yield Finding('vision_msgs is not installed: no detections, no vtrack select',
                      'apt install ros-jazzy-vision-msgs, or run scripts/setup')


def _of_topic(topic: Any, seconds: float) -> Iterator[Finding]:
    kind = 'reliable' if topic.reliable else 'best effort'
    text = (f'{topic.name}: {kind}, from {", ".join(topic.publishers)} to '
            f'{", ".join(topic.subscribers) or "no node"}')
    if not seconds:
        yield Finding(f'{text}; not listened to')
    elif not topic.received:
        # The middleware counts a lost message only when a later one arrives.
        yield Finding(f'{text}: no image was received in {seconds:g} s',
                      'check that the driver is running and publishing. Without the DDS profile '
                      'large images may all be lost: start the driver with '
                      f'{installation.profile_setting()}', wrong=True)
        return
    else:
        yield _of_images(topic, text)
    if len(topic.publishers) > 1:
        yield Finding(f'{topic.name} has several publishers, which the node treats as one stream',
                      'remap all but one')
    for mismatch in topic.mismatches:
        yield Finding(f'{topic.name}: {mismatch}', "set the node's reliability to auto, or "
                      'start both with the same type and QoS', wrong=True)


def _of_images(topic: Any, text: str) -> Finding:
    """Return a finding on the images that were received."""
    text += f'; {topic.form}, ' + (f'{topic.rate:.1f} Hz' if topic.received > 1 else 'one image')
    total = topic.received + topic.lost
    if topic.lost <= _NOTABLE * total:
        return Finding(f'{text}, {topic.lost or "none"} of {total} lost')
    advice = (f'start its driver with {installation.profile_setting()}: such images do not '
              'fit into the shared memory of Fast DDS'
              if topic.exceeds_shared_memory else
              'check the load of processor and network; smaller or compressed images help')
    return Finding(f'{text}, {topic.lost} of {total} lost in transit', advice, wrong=True)
