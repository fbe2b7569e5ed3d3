"""Faults of full disks."""

from __future__ import annotations

import os
from pathlib import Path
import resource
import signal
import subprocess
import sys
import tempfile
from typing import Any

from fault_scenarios.sender import Sender, show_target
from node_bench import tracker_arguments

from vtrack_ros.dds import with_profile

ROOT = Path(__file__).resolve().parents[2]


def _without_disk() -> None:
    """Limit this process to files of 100 bytes: writing fails as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)


def state_file(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Let a node save its target where nothing can be written."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'target.json'
        process = subprocess.Popen(
            [sys.executable, *tracker_arguments(
                'ours', 'gmpf', sender.box, '-p', f'state_file:={path}')],
            # The limit doesn't apply to its log, which goes to a terminal or a pipe.
            stderr=subprocess.PIPE, env=with_profile(os.environ), preexec_fn=_without_disk)
        sender.bench.until(sender.publisher.get_subscription_count, 'no node was found')
        show_target(sender)
        sender.clear()
        sender.stream(seconds)
        recovered = sender.recovery()
        process.terminate()
        _, said = process.communicate(timeout=10)
        told = sum(b'could not be written' in line for line in said.splitlines())
        return sender.row([recovered], told=told, exit_code=process.returncode,
                          files_left=len(list(Path(folder).iterdir())))


def results(sender: Sender, seconds: float, kills: int) -> dict[str, Any]:
    """Replay a bag into a folder of earlier results where nothing more can be written."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / 'out'
        command = [sys.executable, '-m', 'vtrack_ros.cli.command_line', 'replay',
                   str(ROOT / 'bags' / 'face_fast'), '--out', str(out), '--no-video']
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        before = {path: path.read_bytes() for path in out.rglob('*') if path.is_file()}
        run = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                             preexec_fn=_without_disk)
        after = {path: path.read_bytes() for path in out.rglob('*') if path.is_file()}
        return {'recovered_s': [], 'exit_code': run.returncode,
                'earlier_results_kept': int(before == after),
                'traceback': int(b'Traceback' in run.stderr)}


FAULTS = {
    'no room for state_file': state_file,
    'no room for the results of vtrack replay': results,
}
