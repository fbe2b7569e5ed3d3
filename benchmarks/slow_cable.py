"""
A cable between two network namespaces that takes time, and loses packets.

A replacement for netem, which some kernels lack: this process makes two TAP devices, one in each
namespace, and carries packets between them with a delay. `python slow_cable.py NAMESPACE DEVICE
NAMESPACE DEVICE --delay SECONDS --loss SHARE`, as root. It prints `ready` when there are devices,
which last until the process is ended.
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

#: Of linux/if_tun.h: the ioctl request TUNSETIFF, and the flags IFF_TAP and IFF_NO_PI.
_SET_INTERFACE, _TAP, _NO_HEADER = 0x400454ca, 0x0002, 0x1000
#: Upper bound of the size of a packet, [bytes].
_LONGEST = 65536
#: Upper bound of the packets on their way; further ones are dropped, as in a switch.
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
    """Carry packets both ways, all with the same delay, until the process ends."""
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
    """Make the devices, and carry packets between them."""
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
