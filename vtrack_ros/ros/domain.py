"""A DDS domain of one's own, so that other nodes on the machine and network don't mix in."""

from __future__ import annotations

import os
import socket

_FIRST_PORT = 32768
_DOMAINS = range(1, 101)


def reserve_domain() -> socket.socket:
    """
    Take a DDS domain that nobody else on this machine has, for this process and its children.

    By the convention of ROS's own domain_coordinator: whoever holds the domain's port has the
    domain, until the returned socket is closed or the process ends.

    Returns
    -------
    socket.socket
        To be kept as long as the domain is needed.

    Raises
    ------
    RuntimeError
        If all domains from 1 to 100 are taken.

    """
    for domain in _DOMAINS:
        guard = socket.socket()
        try:
            guard.bind(('', _FIRST_PORT + domain))
        except OSError:
            guard.close()
            continue
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        return guard
    raise RuntimeError('all DDS domains from 1 to 100 are taken by other processes')
