"""What all tests share: an own DDS domain, the real sequences, the repository's files."""

from __future__ import annotations

import os
from pathlib import Path
import socket

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


def _reserve_domain() -> socket.socket:
    """Take a DDS domain that no other test process on this machine has, and return its guard."""
    for domain in range(1, 101):
        guard = socket.socket()
        try:
            # The convention of ROS's own domain_coordinator: whoever holds the port, has the
            # domain until the process ends.
            guard.bind(('', 32768 + domain))
        except OSError:
            guard.close()
            continue
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        return guard
    raise RuntimeError('all DDS domains from 1 to 100 are taken by other test processes')


# Before any test module imports rclpy.
_domain_guard = _reserve_domain()
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'


@pytest.fixture(scope='session')
def repository() -> Path:
    """Return the root of the source tree."""
    return REPOSITORY


@pytest.fixture(scope='session')
def sequences() -> Path:
    """Return the folder of the real sequences; skip where they aren't."""
    named = os.environ.get('VTRACK_SEQUENCES')
    folder = Path(named) if named else REPOSITORY.parent / 'shared' / 'sequences'
    if not folder.is_dir():
        where = f'VTRACK_SEQUENCES={named}' if named else '../shared/sequences'
        pytest.skip(f'needs the real sequences: {where} is absent (VTRACK_SEQUENCES names them)')
    return folder
