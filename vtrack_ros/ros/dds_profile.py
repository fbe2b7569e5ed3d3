"""The Fast DDS profile: shared memory large enough for images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

#: What Fast DDS reads the profile's path from: the old and the new name.
VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')


def profile_path() -> Path:
    """
    Return the profile's path: in the installed package's share, or in the source tree.

    Raises
    ------
    FileNotFoundError
        If it's in neither.

    """
    places = [Path(__file__).resolve().parents[2]]
    try:
        from ament_index_python.packages import get_package_share_directory
        places.append(Path(get_package_share_directory('vtrack_ros')))
    except (ImportError, LookupError, OSError):
        pass
    for place in places:
        path = place / 'config' / 'fastdds.xml'
        if path.is_file():
            return path
    raise FileNotFoundError(
        'config/fastdds.xml is neither in the source tree nor in share/vtrack_ros; looked in '
        + ', '.join(str(place) for place in places))


def with_profile(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment for a child process, with the profile unless one is set already."""
    result = dict(environment)
    if not any(result.get(name) for name in VARIABLES):
        result.update(dict.fromkeys(VARIABLES, str(profile_path())))
    return result
