"""Names of files that OpenCV can open, and that can be printed."""

import os
from pathlib import Path


def is_utf8(path: Path | str) -> bool:
    """Return whether the bytes of a path are UTF-8: OpenCV ends the process at any others."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def printable(text: str) -> str:
    r"""Return a text with names of files, whose bytes that aren't UTF-8 become such as `\xfc`."""
    return os.fsencode(text).decode(errors='backslashreplace')
