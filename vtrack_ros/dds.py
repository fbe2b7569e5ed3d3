"""DDS: its settings in the environment, its shared memory, and leaving it."""

from collections.abc import Mapping
from contextlib import suppress
import ctypes
import fcntl
import os
from pathlib import Path
import socket
import sys
import threading
from typing import Any
import warnings

#: Environment variables that Fast DDS reads the profile's path from: the old and the new name.
VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
#: The environment variable by which Fast DDS is told its transports; a profile's take precedence.
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
#: The profile, and its variant with less memory for a process that sends no images.
PROFILE, RECEIVING = 'fastdds.xml', 'fastdds_node.xml'
#: The folder of the shared memory of a machine's processes.
SHARED_MEMORY = Path('/dev/shm')

#: Port of domain 0, by domain_coordinator's convention.
_FIRST_PORT = 32768
_DOMAINS = range(1, 101)
#: Time-out for a node to leave DDS, in seconds; a tenth of a second is usual.
_PATIENCE = 3.0
#: Nodes that hang in DDS; they're kept here, for freeing them would hang as well.
_hanging: list[Any] = []


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

    Fast DDS takes the whole segment into memory at once, 64 MiB with our profile; a process that
    only receives images needs a quarter of that. Profiles other than ours are left as they are.
    """
    result = dict(environment)
    for name in VARIABLES:
        path = Path(result.get(name, ''))
        if path.name == PROFILE and path.with_name(RECEIVING).is_file():
            result[name] = str(path.with_name(RECEIVING))
    return result


def with_profile(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment with the profile, unless it has one already, or `TRANSPORTS`."""
    result = dict(environment)
    if not any(result.get(name) for name in (*VARIABLES, TRANSPORTS)):
        result.update(dict.fromkeys(VARIABLES, str(profile_path())))
    return result


def profile_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables alone that name the profile in an environment `with_profile`."""
    return {name: value for name, value in with_profile(environment).items() if name in VARIABLES}


def abandoned_memory(folder: Path) -> int:
    """
    Return how many bytes of a folder are segments of Fast DDS left behind by killed processes.

    Each segment has a file that its process holds a lock on; without the lock the segment isn't
    used any more, as Fast DDS's own command `fastdds shm clean` tells, too.
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
    Take a DDS domain that is free on this machine, for this process and its children.

    By the convention of ROS's own domain_coordinator, the process that holds the domain's port has
    the domain, until the returned socket is closed or the process ends. RuntimeError if all
    domains from 1 to 100 are taken.
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
    raise RuntimeError('all DDS domains from 1 to 100 are in use by other processes')


def give_memory_back(process: int | str = 'self') -> None:
    """
    Remove a process's segments of shared memory: those whose lock files it has open.

    They stay behind if a process is killed, so this goes before. The process is one of this user;
    one that has ended has nothing open, and nothing is removed.
    """
    with suppress(OSError):
        for descriptor in Path(f'/proc/{process}/fd').iterdir():
            try:
                guard = descriptor.readlink()
            except OSError:
                # closed since
                continue
            if guard.parent == SHARED_MEMORY and guard.name.endswith('_el'):
                guard.with_name(guard.name.removesuffix('_el')).unlink(missing_ok=True)
                guard.unlink(missing_ok=True)


def leave(node: Any) -> None:
    """
    Destroy a node of rclpy; if that hangs in DDS, `end_process` ends the process.

    Fast DDS as in the wheels of PyPI hangs if it's notified of another process's departure just as
    it takes down its participant: its `set_listener` waits for the end of that callback, which
    waits for the mutex that `set_listener` holds, for a libstdc++ without `pthread_cond_clockwait`
    can't wait until the largest point in time. rclpy destroys nodes with Python's global lock
    held, so that no other thread would run; so the last step is a call of rcl in another thread.
    """
    rcl = ctypes.CDLL('librcl.so', mode=os.RTLD_NOW | os.RTLD_NOLOAD)
    handle = node.handle
    # While the handle is in use, `destroy_node` destroys what belongs to it, but not the node.
    handle.__enter__()
    node.destroy_node()
    pointer = ctypes.c_void_p(handle.pointer)
    rcl.rcl_logging_rosout_fini_publisher_for_node(pointer)
    last = threading.Thread(target=rcl.rcl_node_fini, args=(pointer,), daemon=True)
    last.start()
    last.join(_PATIENCE)
    if last.is_alive():
        _hanging.append(node)
        give_memory_back()
    else:
        # The node is destroyed already, of which rclpy warns.
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', RuntimeWarning)
            handle.__exit__(None, None, None)


def end_process(code: int) -> int:
    """Return the exit code, or exit with it at once if a node hangs in DDS."""
    if _hanging:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code
