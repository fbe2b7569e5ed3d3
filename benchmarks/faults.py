"""
What a running node makes of faults, over real DDS: what was sent, what came out, how soon again.

`.venv/bin/python benchmarks/faults.py [--only WORDS] [--seconds S] [--kills N]` writes faults.json
and reliability.md into docs/results. The target is a square that moves to and fro, at VGA and
30 Hz; a box is right if its overlap (IoU) with the square of its image is above 0.5.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
import sys
from typing import Any

from fault_scenarios import disks, loads, restarts, stamps
from fault_scenarios.page import page
from fault_scenarios.sender import Sender
from node_bench import Bench
from result_files import write_json

from vtrack_ros.dds import reserve_domain, with_profile

ROOT = Path(__file__).resolve().parents[1]
FAULTS = {**restarts.FAULTS, **stamps.FAULTS, **loads.FAULTS, **disks.FAULTS}


def main() -> int:
    """Run the faults, and write the results; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--seconds', type=float, default=10.0, help='of each fault')
    parser.add_argument('--kills', type=int, default=100, help='of the publisher, and of the node')
    parser.add_argument('--only', default='', help='faults whose names contain this')
    parser.add_argument('--out', type=Path, default=ROOT / 'docs' / 'results', metavar='DIR')
    parser.add_argument('--camera', action='store_true', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.camera:
        restarts.send_as_camera()
        return 0
    guard = reserve_domain()
    os.environ.update(with_profile(os.environ))
    path = arguments.out / 'faults.json'
    known: dict[str, Any] = (
        json.loads(path.read_text(encoding='utf-8'))['faults'] if path.is_file() else {})
    for name, fault in FAULTS.items():
        if arguments.only in name:
            bench = Bench()
            figures = fault(Sender(bench), arguments.seconds, arguments.kills)
            bench.node.destroy_node()
            bench.close()
            print(name, figures, flush=True)
            known[name] = figures
            write_json(path, {'faults': {one: known[one] for one in FAULTS if one in known}})
            (arguments.out / 'reliability.md').write_text(page(arguments.out), encoding='utf-8')
    guard.close()
    return 0


if __name__ == '__main__':
    sys.exit(main())
