"""`vtrack synth`: scenes with exact truth."""

import argparse
from pathlib import Path

from vtrack_ros.bags.importing import record
from vtrack_ros.bags.writer import COMPRESSIONS, STORAGES
from vtrack_ros.cli.arguments import image_size, positive_integer, positive_number, seed
from vtrack_ros.cli.progress import with_progress
from vtrack_ros.scenes import render, scene_info, scene_names

EXAMPLES = """examples:
  vtrack synth --list
  vtrack synth face_fast --out face_fast
  vtrack synth football --out football --size 1280x768 --rate 30 --seed 3

The bag is a folder; it contains the ground truth as topic /truth and as file truth.csv. The same
scene, size, number of frames and seed give the same bag."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('scene', nargs='?', metavar='SCENE', help='name of a scene, see --list')
    parser.add_argument('--out', type=Path, metavar='BAG', help='bag to write, a new folder')
    parser.add_argument('--list', action='store_true', help='list the scenes and exit')
    parser.add_argument('--size', type=image_size, metavar='WxH',
                        help="size of the frames, up to 1920x1080 (default: the scene's own)")
    parser.add_argument('--frames', type=positive_integer, metavar='N',
                        help='number of frames; after its end the scene continues backwards '
                        '(default: the whole scene)')
    parser.add_argument('--rate', type=positive_number, default=25.0, metavar='HZ',
                        help='frames per second, 1e-6 to 1e6 (default: %(default)s)')
    parser.add_argument('--seed', type=seed, default=0, metavar='S',
                        help='seed of textures, clutter and noise (default: %(default)s)')
    add_storage_arguments(parser)


def add_storage_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare how a bag is stored."""
    parser.add_argument('--format', choices=STORAGES, default='mcap',
                        help='storage of the rosbag2 (default: %(default)s)')
    parser.add_argument('--compress', choices=COMPRESSIONS, default='none',
                        help='compression of the images: store CompressedImage instead of Image '
                        '(default: %(default)s)')
    parser.add_argument('--topic', default='image', metavar='T',
                        help='name of the image topic (default: %(default)s)')


def run(arguments: argparse.Namespace) -> int:
    """Render the scene into a bag."""
    if arguments.list:
        for name in scene_names():
            info = scene_info(name)
            size = f'{info.width}x{info.height}'
            print(f'{name:<18}{size:<9}{info.frames:>4} frames  {info.summary}')
        return 0
    if arguments.scene is None:
        raise ValueError('SCENE is missing; valid are ' + ', '.join(scene_names()))
    if arguments.out is None:
        raise ValueError('--out BAG is missing: the bag to write')
    frames = render(arguments.scene, arguments.size, arguments.frames, arguments.seed)
    total = arguments.frames or scene_info(arguments.scene).frames
    shown = ((shot.frame, shot.truth) for shot in with_progress(frames, total))
    count = record(shown, arguments.out, rate=arguments.rate, storage=arguments.format,
                   compression=arguments.compress, topic=arguments.topic)
    print(f'{arguments.out}: {count} frames of {arguments.scene}, with ground truth')
    return 0
