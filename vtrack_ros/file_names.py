"""Names of files that OpenCV can open."""

from pathlib import Path


def is_utf8(path: Path | str) -> bool:
    """Return whether the bytes of a path are UTF-8: OpenCV ends the process at any others."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True
