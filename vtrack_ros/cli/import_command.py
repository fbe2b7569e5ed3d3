"""`vtrack import`: bags of images and videos."""

import argparse
from pathlib import Path

from vtrack_ros.bags.importing import open_source, record
from vtrack_ros.cli.arguments import positive_number
from vtrack_ros.cli.command_line import warn
from vtrack_ros.cli.progress import with_progress
from vtrack_ros.cli.synth_command import add_storage_arguments

EXAMPLES = """examples:
  vtrack import pictures/ --out bag --rate 30
  vtrack import sequences/Crossing --out crossing        # img/ and groundtruth_rect.txt
  vtrack import holiday.mp4 --out holiday --compress jpeg

Images are read in the order of the numbers in their names, 2.png before 10.png. The ground truth
is read from groundtruth_rect.txt in the folder or its parent: one box x,y,width,height per line,
NaN where the target is absent."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('path', type=Path, metavar='PATH', help='an image folder or a video file')
    parser.add_argument('--out', type=Path, required=True, metavar='BAG',
                        help='bag to write, a new folder')
    parser.add_argument('--rate', type=positive_number, metavar='HZ',
                        help="frames per second, 1e-6 to 1e6 (default: the video's rate, or else "
                        '25)')
    truth = parser.add_mutually_exclusive_group()
    truth.add_argument('--truth', type=Path, metavar='FILE',
                       help='file with the ground truth (default: groundtruth_rect.txt, if there '
                       'is one)')
    truth.add_argument('--no-truth', action='store_true', help='write no ground truth')
    add_storage_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the bag."""
    source = open_source(arguments.path, arguments.truth, arguments.no_truth)
    rate = arguments.rate or source.rate or 25.0
    frames = with_progress(source.frames(), source.count or source.announced)
    count = record(frames, arguments.out, rate=rate, storage=arguments.format,
                   compression=arguments.compress, topic=arguments.topic,
                   with_truth=source.truth is not None)
    if source.announced is not None and count < source.announced:
        warn('vtrack import', f'{source.path} has {source.announced} frames by its header, but '
             f'only {count} could be read: it may be truncated or damaged')
    about = 'without ground truth' if source.truth is None else 'with ground truth'
    print(f'{arguments.out}: {count} frames at {rate:g} Hz, {about}')
    return 0
