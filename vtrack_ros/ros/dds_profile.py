"""The Fast DDS profile: shared memory large enough for images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

#: What Fast DDS reads the profile's path from: the old and the new name.
VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
#: The profile, and its variant with less memory for a process that sends no images.
PROFILE, RECEIVING = 'fastdds.xml', 'fastdds_node.xml'


def profile_path() -> Path:
    """
    Return the profile's path: in the installed package's share, or in the source tree.

    Raises
    ------
    FileNotFoundError
        If it's in neither.

    """
    here = Path(__file__).resolve()
    places = [here.parents[2], *(folder / 'share' / 'vtrack_ros' for folder in here.parents)]
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
