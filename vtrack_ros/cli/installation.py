"""Checks of the installed packages and of the middleware's settings, without ROS."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
import os
from pathlib import Path
import platform
import shutil
import subprocess
import sys

import vtrack_ros
from vtrack_ros.dds import (
    abandoned_memory, PROFILE, profile_path, RECEIVING, SHARED_MEMORY, TRANSPORTS, VARIABLES)

#: Optional module -> (what needs it, the extra of this package that installs it).
_OPTIONAL = {
    'rosbags': ('vtrack synth, import, play, replay and evaluate', 'tools'),
    'joblib': ('vtrack evaluate', 'tools'),
    'jinja2': ('reports', 'tools'), 'matplotlib': ('reports', 'tools'),
    'tqdm': ('vtrack synth, import, replay and evaluate', 'tools'),
    'threadpoolctl': ('limit of the threads with --jobs 1', 'tools'),
    'aiohttp': ('vtrack select', 'select')}
#: Shared memory in bytes: the minimum that must be free for two processes; and the amount left by
#: killed processes from which freeing it is advised.
_NEEDED, _ABANDONED = 2 * 64 * 2**20, 64 * 2**20


@dataclass(frozen=True)
class Finding:
    """The result of one check, advice if something should be done, and whether it's wrong."""

    text: str
    advice: str = ''
    wrong: bool = False


def versions() -> Finding:
    """Return the versions of the software, and the machine."""
    import cv2
    import numpy as np
    return Finding(
        f'vtrack_ros {vtrack_ros.__version__}, Python {platform.python_version()}, NumPy '
        f'{np.__version__}, OpenCV {cv2.__version__}, {os.cpu_count()} processors, '
        f'{platform.system()} {platform.machine()}')


def libraries() -> Iterator[Finding]:
    """Return which optional libraries are missing, and what needs them."""
    missing = [name for name in _OPTIONAL if find_spec(name) is None]
    for name in missing:
        use, extra = _OPTIONAL[name]
        # Neither Debian nor Ubuntu has a package of rosbags.
        apt = '' if name == 'rosbags' else f', or apt install python3-{name}'
        yield Finding(f'{name} is not installed: no {use}',
                      f"pip install 'vtrack_ros[{extra}]'{apt}")
    if not missing:
        yield Finding('all optional libraries are installed')


def trackers() -> Finding:
    """Return which trackers are available."""
    from vtrack_ros.trackers import tracker_names
    own = tracker_names(replicas=False, installed=False)
    added = [name for name in tracker_names(replicas=False) if name not in own]
    return Finding(f'trackers {", ".join(own)}' + (
        f'; from other packages {", ".join(added)}' if added else ''))


def unusable_middleware(environment: Mapping[str, str]) -> Finding | None:
    """Return a finding if the middleware that an environment sets can't be loaded, else None."""
    name = environment.get('RMW_IMPLEMENTATION')
    if not name or find_spec('rclpy') is None:
        return None
    # In another process: ROS ends a process whose middleware is missing.
    tried = subprocess.run([sys.executable, '-c', 'import rclpy; rclpy.init()'],
                           env=dict(environment), capture_output=True)
    if tried.returncode == 0:
        return None
    return Finding(f"RMW_IMPLEMENTATION is set to {name}, which can't be loaded",
                   f'apt install ros-jazzy-{name.replace("_", "-")}, or unset RMW_IMPLEMENTATION',
                   wrong=True)


def profile_setting() -> str:
    """Return the environment variable, NAME=VALUE, for processes that exchange images."""
    return f'{VARIABLES[0]}={profile_path()}'


def profile(environment: Mapping[str, str]) -> Finding:
    """Return which Fast DDS profile an environment names."""
    advice = f'start the camera driver and the node with {profile_setting()} (docs/camera.md)'
    named = [environment[name] for name in VARIABLES if environment.get(name)]
    if not named and environment.get(TRANSPORTS):
        return Finding(f'no Fast DDS profile is set, but {TRANSPORTS}={environment[TRANSPORTS]}')
    if not named:
        return Finding('no Fast DDS profile is set in this shell', advice)
    path = Path(named[0])
    if not path.is_file():
        return Finding(f'the Fast DDS profile {path} does not exist', advice, wrong=True)
    if path.name not in (PROFILE, RECEIVING):
        return Finding(f'the Fast DDS profile is {path}, not the one of this package',
                       'make sure that its shared memory can hold several images')
    return Finding(f'the Fast DDS profile is {path}')


def shared_memory() -> Finding:
    """Return whether there is enough free shared memory for images."""
    if not SHARED_MEMORY.is_dir():
        return Finding(f'{sys.platform} has no {SHARED_MEMORY}: images go over the network')
    free, abandoned = shutil.disk_usage(SHARED_MEMORY).free, abandoned_memory(SHARED_MEMORY)
    text = f'{free / 2**20:.0f} MiB of shared memory are free'
    if abandoned >= _ABANDONED:
        text += f'; {abandoned / 2**20:.0f} MiB are still held for processes that were killed'
        advice = 'free it with: fastdds shm clean'
    else:
        advice = 'in a container: docker run --ipc=host, or --shm-size=1g'
    if free < _NEEDED:
        return Finding(text + ', too little for images', advice, wrong=True)
    return Finding(text, advice if abandoned >= _ABANDONED else '')
