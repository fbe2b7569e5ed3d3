"""`vtrack layout`: a layout of RViz or Foxglove for one node's topics."""

import argparse
import re

from vtrack_ros.cli.arguments import node_name
from vtrack_ros.dds import profile_path

EXAMPLES = """examples:
  vtrack layout rviz > tracker.rviz
  vtrack layout foxglove /left_hand/tracker > left_hand.json

Prints config/vtrack.rviz or config/vtrack.foxglove.json with the topics of that node."""
_FILES = {'rviz': 'vtrack.rviz', 'foxglove': 'vtrack.foxglove.json'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('program', choices=tuple(_FILES), help='program that the layout is for')
    parser.add_argument('node', nargs='?', type=node_name, default='/tracker', metavar='NODE',
                        help='name of the tracking node (default: %(default)s)')


def run(arguments: argparse.Namespace) -> int:
    """Print the layout; return 0."""
    text = profile_path().with_name(_FILES[arguments.program]).read_text(encoding='utf-8')
    names = {'/tracker/': f'{arguments.node}/', '/': f"{arguments.node.rpartition('/')[0]}/"}
    # /diagnostics is shared by all nodes, and keeps its name.
    print(re.sub(r'(?<=[ "])/(tracker/|(?=pose|detections))', lambda found: names[found[0]], text),
          end='')
    return 0
