"""`vtrack replay`: a tracker over a bag, without a node."""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Mapping
from contextlib import ExitStack
import json
from pathlib import Path
import shutil
from statistics import median
import sys
from typing import Any

import cv2
import numpy as np

from vtrack_ros.bags import BagReader, BagWriter
from vtrack_ros.bags.replay import replay, ResultTable, Scoring, Step, WAITING, write_step
from vtrack_ros.cli.arguments import box, seed
from vtrack_ros.drawing import Canvas, contact_sheet, TRUTH, Video
from vtrack_ros.evaluation.progress import ProgressBar
from vtrack_ros.follower import Follower
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import tracker_class, tracker_names

EXAMPLES = """examples:
  vtrack replay bags/face_fast --tracker gmpf --out result
  vtrack replay BAG --tracker pf --set particles=400 --init 120,80,40,60 --out result
  vtrack replay BAG --tracker pf --list-parameters

DIR gets results.csv (one row per frame, in full precision), bag/ (detections and poses, with the
images' own headers), video.mp4 and contact_sheet.png. The same bag, tracker, parameters and seed
give the same boxes, bit for bit, as the node does where it drops no frame."""

#: How many pictures the sheet has, and how many places the trail.
_SHEET, _TRAIL = 16, 60


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('bag', type=Path, metavar='BAG',
                        help='a rosbag2 folder, .mcap, .db3 or ROS 1 .bag')
    parser.add_argument('--tracker', default='gmpf', metavar='T',
                        help='one of ' + ', '.join(tracker_names()) + ' (default: %(default)s)')
    parser.add_argument('--out', type=Path, metavar='DIR', help='the folder for the results')
    parser.add_argument('--seed', type=seed, default=0, metavar='S',
                        help='of the random numbers (default: %(default)s)')
    parser.add_argument('--set', nargs='+', action='extend', default=[], metavar='NAME=VALUE',
                        help="the tracker's parameters")
    parser.add_argument('--list-parameters', action='store_true',
                        help="list the tracker's parameters and end")
    parser.add_argument('--init', type=box, metavar='X,Y,W,H',
                        help='the target in the first image, in pixels (default: the first box '
                        "of the bag's truth)")
    parser.add_argument('--topic', metavar='T', help='the image topic, where there are several')
    parser.add_argument('--no-video', action='store_true', help='write no pictures')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(arguments: argparse.Namespace) -> int:
    """Follow the target, write the results, print the figures."""
    table = tracker_class(arguments.tracker).PARAMETERS
    if arguments.list_parameters:
        for name, row in table.items():
            print(f'{name} = {row.default}  ({row.valid})  {row.description}')
        return 0
    if arguments.out is None:
        raise ValueError('--out DIR is missing: where should the results go?')
    values = dict(_assignment(text) for text in arguments.set)
    unknown = [name for name in values if name not in table]
    if unknown:
        raise ValueError(f'{arguments.tracker} has no parameter {unknown[0]!r}; valid are ' +
                         ', '.join(table))
    parameters = {name: table[name].parsed(text) for name, text in values.items()}
    follower = Follower(arguments.tracker, arguments.seed, {arguments.tracker: parameters})
    return _follow(arguments, follower)


def _follow(arguments: argparse.Namespace, follower: Follower) -> int:
    malformed: list[str] = []
    with ExitStack() as stack:
        bag = stack.enter_context(BagReader(arguments.bag))
        topic, truth = bag.image_topic(arguments.topic), bag.truth()
        if arguments.init is None and not any(truth.values()):
            raise ValueError(f'{arguments.bag} does not say where the target is: '
                             'give --init X,Y,WIDTH,HEIGHT')
        rate = None if arguments.no_video else _frame_rate(bag, topic.name)
        steps = replay(bag.frames(topic.name, malformed), follower, truth, arguments.init)
        results = stack.enter_context(BagWriter(_result_bag(arguments.out)))
        rows = stack.enter_context(ResultTable(arguments.out / 'results.csv'))
        pictures = None
        if rate is not None:
            pictures = stack.enter_context(_Pictures(arguments.out, rate, topic.count, truth))
        scoring, show = Scoring(truth), ProgressBar(sys.stderr, 'frames')
        for done, step in enumerate(steps, start=1):
            scoring.add(step)
            rows.write(step)
            write_step(results, step)
            if pictures is not None:
                pictures.add(step)
            show(done, topic.count)
    for text in malformed[:5]:
        print(f'vtrack replay: left out {text}', file=sys.stderr)
    figures = scoring.figures(len(malformed))
    print(json.dumps(figures.as_json()) if arguments.json else figures.table())
    return 0


def _result_bag(folder: Path) -> Path:
    """Return where the result bag goes, and make room if an earlier one is there."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / 'bag'
    if (path / 'metadata.yaml').is_file():
        shutil.rmtree(path)
    return path


def _frame_rate(bag: BagReader, topic: str) -> float:
    """Return how many images the bag has per second."""
    times = [raw.received for raw in bag.raw({topic})]
    intervals = [late - early for early, late in zip(times, times[1:]) if late > early]
    return 1e9 / median(intervals) if intervals else 25.0


class _Pictures:
    """The annotated video and the contact sheet; a context manager."""

    def __init__(self, folder: Path, rate: float, count: int,
                 truth: Mapping[int, Box | None]) -> None:
        self._sheet_path = folder / 'contact_sheet.png'
        self._video = Video(folder / 'video.mp4', rate)
        self._truth = truth
        self._chosen = set(np.linspace(0, count - 1, min(_SHEET, count)).round().astype(int))
        self._index = 0
        self._shape: tuple[int, ...] = ()
        self._sheet: list[Frame] = []
        self._trail: deque[tuple[float, float]] = deque(maxlen=_TRAIL)

    def __enter__(self) -> _Pictures:
        return self

    def __exit__(self, *error: Any) -> None:
        self._video.__exit__(*error)
        if self._sheet:
            cv2.imwrite(str(self._sheet_path), contact_sheet(self._sheet))

    def add(self, step: Step) -> None:
        picture = self._drawn(step)
        self._shape = self._shape or picture.shape
        if picture.shape != self._shape:
            # A video has one size: later pictures of another are fitted in.
            fitted = cv2.resize(picture, (self._shape[1], self._shape[0]))
            picture = np.asarray(fitted, np.uint8)
        self._video.write(picture)
        if self._index in self._chosen:
            self._sheet.append(picture)
        self._index += 1

    def _drawn(self, step: Step) -> Frame:
        canvas = Canvas(step.image.frame)
        true_box, estimate = self._truth.get(step.image.stamp), step.estimate
        if true_box is not None:
            canvas.box(true_box, TRUTH, 1)
        text = WAITING
        if estimate is not None:
            canvas.estimate(estimate)
            if estimate.measured:
                self._trail.append(estimate.box.center)
            text = f'{estimate.state.value} {estimate.confidence:.2f}'
        canvas.trail(list(self._trail))
        canvas.text(f'{self._index}  {text}')
        return canvas.picture


def _assignment(text: str) -> tuple[str, str]:
    name, separator, value = text.partition('=')
    if not (name and separator):
        raise ValueError(f'--set must be NAME=VALUE, not {text!r}')
    return name, value
