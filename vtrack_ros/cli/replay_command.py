"""`vtrack replay`: a tracker over a bag, without a node."""

import argparse
from contextlib import ExitStack
import json
from pathlib import Path
import sys

from vtrack_ros.bags import BagReader
from vtrack_ros.bags.replay import replay, WAITING
from vtrack_ros.bags.result_folder import ResultFolder
from vtrack_ros.cli.arguments import box, seed
from vtrack_ros.cli.command_line import warn
from vtrack_ros.cli.progress import with_progress
from vtrack_ros.drawing import Film
from vtrack_ros.evaluation.runner import one_thread
from vtrack_ros.evaluation.stream_score import figures_table, StreamScore
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import Estimate, tracker_class, tracker_names

EXAMPLES = """examples:
  vtrack replay bags/face_fast --tracker gmpf --out result
  vtrack replay BAG --tracker pf --set particles=400 --init 120,80,40,60 --out result
  vtrack replay BAG --tracker pf --list-parameters

Writes into DIR: results.csv (one row per frame, in full precision), bag/ (detections, poses and
twists, with the headers of the images), video.mp4 and contact_sheet.png. The same bag, tracker,
parameters and seed give exactly the same boxes, and so does the node if it drops no frame."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('bag', type=Path, metavar='BAG',
                        help='a rosbag2 folder, .mcap, .db3 or ROS 1 .bag')
    parser.add_argument('--tracker', default='gmpf', metavar='T',
                        help='one of ' + ', '.join(tracker_names()) + ' (default: %(default)s)')
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='folder for the results; replaces those of an earlier replay '
                        '(default: only print the figures)')
    parser.add_argument('--seed', type=seed, default=0, metavar='S',
                        help='seed of the random number generator (default: %(default)s)')
    parser.add_argument('--set', nargs='+', action='extend', default=[], metavar='NAME=VALUE',
                        help="values of the tracker's parameters")
    parser.add_argument('--list-parameters', action='store_true',
                        help="list the tracker's parameters and exit")
    parser.add_argument('--init', type=box, metavar='X,Y,W,H',
                        help='box of the target in the first image, in pixels (default: the first '
                        'ground-truth box of the bag)')
    parser.add_argument('--topic', metavar='T', help='image topic; needed if there are several')
    parser.add_argument('--no-video', action='store_true',
                        help='write neither video nor contact sheet')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(arguments: argparse.Namespace) -> int:
    """Follow the target, write the results, print the figures."""
    table = tracker_class(arguments.tracker).PARAMETERS
    if arguments.list_parameters:
        for name, row in table.items():
            print(f'{name} = {row.default}  ({row.valid})  {row.description}')
        return 0
    values = dict(_assignment(text, arguments.tracker) for text in arguments.set)
    unknown = [name for name in values if name not in table]
    if unknown:
        raise ValueError(f'{arguments.tracker} has no parameter {unknown[0]!r}; valid are ' +
                         ', '.join(table))
    parameters = {name: table[name].parsed(text) for name, text in values.items()}
    session = TrackingSession(arguments.tracker, arguments.seed, {arguments.tracker: parameters})
    return _follow(arguments, session)


def _follow(arguments: argparse.Namespace, session: TrackingSession) -> int:
    malformed: list[str] = []
    late: list[int] = []
    gone: int | None = None
    with ExitStack() as stack:
        stack.enter_context(one_thread())
        bag = stack.enter_context(BagReader(arguments.bag))
        warn('vtrack replay', bag.notice)
        topic, truth = bag.image_topic(arguments.topic), bag.truth()
        if arguments.init is None and not any(truth.values()):
            raise ValueError(f'{arguments.bag} has no ground-truth box: '
                             'give the target with --init X,Y,WIDTH,HEIGHT')
        steps = replay(bag.frames(topic.name, malformed), session, truth, arguments.init, late)
        results = film = None
        if arguments.out is not None:
            results = stack.enter_context(ResultFolder(arguments.out, arguments.bag))
            if not arguments.no_video:
                film = stack.enter_context(Film(results.place, bag.rate(topic.name), topic.count))
        score, tracked = StreamScore(truth), False
        for step in with_progress(steps, topic.count):
            score.add_step(step)
            if step.estimate is not None:
                gone = None
                tracked = True
            elif tracked and gone is None:
                gone = step.image.stamp
            if results is not None:
                results.write(step)
            if film is not None:
                film.add(step.image.frame, _state(step.estimate), estimate=step.estimate,
                         truth=truth.get(step.image.stamp))
        if len(malformed) == topic.count:
            raise ValueError(f'none of the images can be read: {malformed[0]}')
    for text in malformed[:5]:
        print(f'vtrack replay: skipped {text}', file=sys.stderr)
    if late:
        print(f'vtrack replay: late images skipped: {len(late)} (stamped before, or far after, '
              f'the previous one); the first is stamped {late[0]} ns', file=sys.stderr)
    if gone is not None:
        print(f'vtrack replay: no target from stamp {gone} ns on: the stamps go back there, as of '
              'a clock that was set back, or the images change in size or between colour and '
              'grey, and the target would have to be selected anew', file=sys.stderr)
    figures = score.figures()
    figures['frames_malformed'] = len(malformed)
    figures['frames_late'] = len(late)
    figures['fps'] = 1e3 / figures['ms_per_frame'] if figures['ms_per_frame'] else None
    print(json.dumps(figures) if arguments.json else figures_table(figures))
    return 0


def _state(estimate: Estimate | None) -> str:
    return WAITING if estimate is None else f'{estimate.state.value} {estimate.confidence:.2f}'


def _assignment(text: str, tracker: str) -> tuple[str, str]:
    """Return name and value; the name may begin with `TRACKER.`, as the node's parameters do."""
    name, separator, value = text.partition('=')
    if not (name and separator):
        raise ValueError(f'--set must be NAME=VALUE, not {text!r}')
    return name.removeprefix(f'{tracker}.'), value
