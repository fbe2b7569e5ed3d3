"""
A cable between two network namespaces that takes time, and loses packets.

Kernels without netem have no delay. Two TAP devices do as well, one in each namespace, between
which this process carries the packets, later: `python slow_cable.py NAMESPACE DEVICE NAMESPACE
DEVICE --delay SECONDS --loss SHARE`, as root. It says so when the devices are there, and ends with
them when it's told to.
"""

from __future__ import annotations

import argparse
from collections import deque
import fcntl
import os
from pathlib import Path
import random
import select
import struct
import time

#: The request of an ioctl, and flags, of linux/if_tun.h.
_SET_INTERFACE, _TAP, _NO_HEADER = 0x400454ca, 0x0002, 0x1000
_LONGEST = 65536
#: No more than that is on its way, as in a switch.
_WAITING = 1000


def tap(namespace: str, device: str) -> int:
    """Make a TAP device in a namespace, which this process enters; return its file descriptor."""
    with open(Path('/run/netns', namespace)) as file:
        os.setns(file.fileno(), os.CLONE_NEWNET)
    descriptor = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
    request = struct.pack('16sH', device.encode(), _TAP | _NO_HEADER)
    fcntl.ioctl(descriptor, _SET_INTERFACE, request)
    return descriptor


def carry(ends: tuple[int, int], delay: float, loss: float, rng: random.Random) -> None:
    """Carry packets both ways until the process ends; each takes as long as all others."""
    others = dict(zip(ends, reversed(ends)))
    waiting: deque[tuple[float, int, bytes]] = deque()
    while True:
        left = max(0.0, waiting[0][0] - time.monotonic()) if waiting else None
        for end in select.select(ends, [], [], left)[0]:
            packet = os.read(end, _LONGEST)
            if rng.random() >= loss and len(waiting) < _WAITING:
                waiting.append((time.monotonic() + delay, others[end], packet))
        while waiting and waiting[0][0] <= time.monotonic():
            _, end, packet = waiting.popleft()
            try:
                os.write(end, packet)
            except OSError:
                # the other side isn't up yet
                pass


def main() -> None:
    """Be a cable."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('ends', nargs=4, metavar='NAMESPACE DEVICE')
    parser.add_argument('--delay', type=float, required=True)
    parser.add_argument('--loss', type=float, required=True)
    arguments = parser.parse_args()
    first, device, second, other = arguments.ends
    ends = tap(first, device), tap(second, other)
    print('ready', flush=True)
    carry(ends, arguments.delay, arguments.loss, random.Random(0))


if __name__ == '__main__':
    main()
