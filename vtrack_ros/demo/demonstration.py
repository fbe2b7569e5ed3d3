"""Track a target in a recorded bag, with a real node, and show the results."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
import json
import os
from pathlib import Path
import sys
from typing import TYPE_CHECKING

import numpy as np

from vtrack_ros.bags import BagError, BagReader
from vtrack_ros.bags.errors import check_output
from vtrack_ros.bags.messages import COMPRESSED_IMAGE
from vtrack_ros.bags.topics import Topic
from vtrack_ros.cli.arguments import box, positive_number, seed
from vtrack_ros.cli.command_line import (
    complain, is_of_ros, negative_values, os_error_text, Parser, warn)
from vtrack_ros.cli.progress import ProgressBar
from vtrack_ros.dds import reserve_domain, with_profile
from vtrack_ros.drawing import Film
from vtrack_ros.evaluation.stream_score import Figures, figures_table, StreamScore
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import tracker_names

if TYPE_CHECKING:
    from vtrack_ros.ros.recorder import Answer

_ROOT = Path(__file__).resolve().parents[2]
#: Options that say nothing of a camera.
_OF_BAGS = ('bag', 'topic', 'init_box', 'rate', 'json')
#: The demo fails below this share of tracked frames, or below this mean overlap (IoU).
LEAST_TRACKED, LEAST_IOU = 0.5, 0.3


def parser() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    result = Parser(
        prog='demo', description='Track a target in a recorded bag with the real node: player, '
        'node and recorder run in three processes. Pictures are written into a folder.')
    result.add_argument('--bag', type=Path, default=_ROOT / 'bags' / 'face_fast',
                        help='a rosbag2 folder, .mcap, .db3 or ROS 1 .bag (default: %(default)s)')
    result.add_argument('--topic', help='image topic; needed if the bag has several')
    result.add_argument('--tracker', choices=tracker_names(), default='gmpf',
                        help='default: %(default)s')
    result.add_argument('--seed', type=seed, default=0,
                        help='seed of the random number generator (default: %(default)s)')
    result.add_argument('--init-box', type=box, metavar='X,Y,WIDTH,HEIGHT',
                        help='box of the target in the first frame, in pixels (default: the '
                        'ground truth of the bag)')
    result.add_argument('--rate', type=positive_number, default=1.0, metavar='R',
                        help='speed: 2 plays twice as fast (default: %(default)s)')
    result.add_argument('--camera', nargs='?', const='0', metavar='N|VIDEO',
                        help='track in the images of a webcam (its number) or a video file '
                        'instead, and select the target in the browser; without a camera, a '
                        'recorded scene is played')
    result.add_argument('--no-browser', action='store_true',
                        help='with --camera: print the address, but open no browser')
    result.add_argument('--json', type=Path, metavar='FILE', help='also write the figures to FILE')
    result.add_argument('--out', type=Path, default=Path('demo-output'), metavar='DIR',
                        help='folder for the pictures (default: %(default)s)')
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demo; return 0 if the target was tracked, 1 if not, 2 if it couldn't be run."""
    words = sys.argv[1:] if arguments is None else arguments
    of_demo = parser()
    options = of_demo.parse_args(negative_values(words))
    wrong = [f"--{name.replace('_', '-')}" for name in _OF_BAGS
             if getattr(options, name) != of_demo.get_default(name)]
    if options.camera is not None and wrong:
        of_demo.error(f'--camera can\'t be combined with {", ".join(wrong)}')
    with nullcontext() if 'ROS_DOMAIN_ID' in os.environ else reserve_domain():
        # Before the imports of ROS, when Fast DDS reads the profile.
        os.environ.update(with_profile(os.environ))
        from vtrack_ros.demo.camera_source import NoImagesError
        from vtrack_ros.demo.processes import DemoError
        try:
            return _demonstrate(options) if options.camera is None else _show_camera(options)
        except (BagError, DemoError, NoImagesError) as error:
            print(f'demo: {error}', file=sys.stderr)
            return 2
        except RuntimeError as error:
            if not is_of_ros(error):
                raise
            return complain('demo', str(error))
        except OSError as error:
            return complain('demo', os_error_text(error))


def _show_camera(options: argparse.Namespace) -> int:
    from vtrack_ros.demo.live_demonstration import run_live
    options.out.mkdir(parents=True, exist_ok=True)
    run_live(options.camera, ['-p', f'tracker:={options.tracker}', '-p', f'seed:={options.seed}'],
             options.out, show=not options.no_browser)
    return 0


def _demonstrate(options: argparse.Namespace) -> int:
    from vtrack_ros.demo.processes import DemoError, run
    from vtrack_ros.ros.recorder import Answer
    with BagReader(options.bag) as bag:
        warn('demo', bag.notice)
        topic, truth = bag.image_topic(options.topic), bag.truth()
        start = options.init_box or truth.get(next(bag.frames(topic.name)).stamp)
        if start is None:
            raise DemoError(f'{options.bag} has no ground-truth box for the first frame: '
                            'give the target with --init-box X,Y,WIDTH,HEIGHT')
        options.out.mkdir(parents=True, exist_ok=True)
        if options.json is not None:
            check_output(options.json)
        print(f'{options.bag.name}: {topic.count} images on {topic.name}, tracked by '
              f'{options.tracker}, seed {options.seed}')
        show = ProgressBar('frames')
        player = [str(options.bag), '--topic', topic.name, '--rate', str(options.rate)]
        sent, answers = run(_node_arguments(options, start, topic), player, options.out,
                            lambda done: show(done, topic.count))
        figures = summarise(answers, truth, sent)
        print(figures_table(figures))
        with Film(options.out, bag.rate(topic.name), topic.count) as film:
            for image in bag.frames(topic.name):
                answer = answers.get(image.stamp, Answer())
                film.add(image.frame, answer.state or 'no answer', truth=truth.get(image.stamp),
                         estimate=answer.estimate, particles=answer.particles)
    for path in film.paths:
        print(f'see {path}')
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=2) + '\n')
    iou, tracked = figures['mean_iou'], figures['frames_tracked'] or 0
    if tracked < LEAST_TRACKED * max(1, sent) or (iou is not None and iou < LEAST_IOU):
        print('demo: the target was not tracked', file=sys.stderr)
        return 1
    return 0


def summarise(answers: Mapping[int, Answer], truth: Mapping[int, Box | None],
              sent: int) -> Figures:
    """
    Return the figures of a run: frames sent and dropped, those of `StreamScore`, and latency.

    Takes answers and truth by stamp, as the recorder and the bag give them, and the number of
    frames that the player published.
    """
    score = StreamScore(truth)
    received = {stamp: answers[stamp] for stamp in sorted(answers) if answers[stamp].received}
    for index, (stamp, answer) in enumerate(received.items()):
        found = None if answer.estimate is None else answer.estimate.box
        score.add(stamp, found, given=index == 0, milliseconds=answer.milliseconds)
    figures = score.figures()
    count = figures.pop('frames') or 0
    latency = [one.latency for one in received.values() if one.latency is not None]
    p50, p99 = np.percentile(latency, (50, 99)).tolist() if latency else (None, None)
    return {'frames_sent': sent, 'frames_received': count, 'frames_dropped': sent - count,
            **figures, 'latency_ms_p50': p50, 'latency_ms_p99': p99}


def _node_arguments(options: argparse.Namespace, start: Box, topic: Topic) -> list[str]:
    compressed = topic.message_type == COMPRESSED_IMAGE
    values = {
        'tracker': options.tracker, 'seed': options.seed,
        'init_box': '[' + ', '.join(repr(value) for value in start.as_array().tolist()) + ']',
        'image_transport': 'compressed' if compressed else 'raw'}
    arguments = ['-r', f'{"image/compressed" if compressed else "image"}:={topic.name}']
    for name, value in values.items():
        arguments += ['-p', f'{name}:={value}']
    return arguments
