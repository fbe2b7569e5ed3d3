"""What DDS reads from the environment: the profile of its shared memory, and the domain."""

from collections.abc import Mapping
import fcntl
import os
from pathlib import Path
import socket

#: What Fast DDS reads the profile's path from: the old and the new name.
VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
#: The profile, and its variant with less memory for a process that sends no images.
PROFILE, RECEIVING = 'fastdds.xml', 'fastdds_node.xml'
#: Where processes of one machine share memory.
SHARED_MEMORY = Path('/dev/shm')

_FIRST_PORT = 32768
_DOMAINS = range(1, 101)


def profile_path() -> Path:
    """Return the profile's path, in the source tree or a share; FileNotFoundError for neither."""
    here = Path(__file__).resolve()
    places = [here.parents[1], *(folder / 'share' / 'vtrack_ros' for folder in here.parents)]
    for place in places:
        path = place / 'config' / PROFILE
        if path.is_file():
            return path
    raise FileNotFoundError(
        f'config/{PROFILE} is neither in the source tree nor in share/vtrack_ros of a prefix '
        f'that {here} is installed in')


def receiving_profile(environment: Mapping[str, str]) -> dict[str, str]:
    """
    Return the environment for a process that sends no images.

    Fast DDS takes the whole segment into memory at once, 64 MiB with our profile; who only
    receives images needs a quarter of that. Profiles other than ours are left as they are.
    """
    result = dict(environment)
    for name in VARIABLES:
        path = Path(result.get(name, ''))
        if path.name == PROFILE and path.with_name(RECEIVING).is_file():
            result[name] = str(path.with_name(RECEIVING))
    return result


def with_profile(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment for a child process, with the profile unless one is set already."""
    result = dict(environment)
    if not any(result.get(name) for name in VARIABLES):
        result.update(dict.fromkeys(VARIABLES, str(profile_path())))
    return result


def abandoned_memory(folder: Path) -> int:
    """
    Return how much of a folder, in bytes, is left of Fast DDS's processes that were killed.

    Each of its segments has a file that its process holds a lock on, by which its own command
    `fastdds shm clean` tells too which of them nobody uses any more.
    """
    total = 0
    for guard in folder.glob('fastrtps_*_el'):
        try:
            segment = guard.with_name(guard.name.removesuffix('_el')).stat()
            with guard.open('rb') as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            # in use, another user's, or gone since it was listed
            continue
        total += 512 * segment.st_blocks
    return total


def reserve_domain() -> socket.socket:
    """
    Take a DDS domain that nobody else on this machine has, for this process and its children.

    By the convention of ROS's own domain_coordinator: whoever holds the domain's port has the
    domain, until the returned socket is closed or the process ends. RuntimeError if all domains
    from 1 to 100 are taken.
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
