"""On what machine, with which versions and when something was measured."""

from __future__ import annotations

from datetime import datetime, UTC
import os
from pathlib import Path
import platform
import re

import cv2
import numpy as np

from vtrack_ros import __version__


def environment() -> dict[str, str | int]:
    """Return machine, versions and date, for the head of a table of measurements."""
    try:
        named = re.search(r'^model name\s*:\s*(.*)$', Path('/proc/cpuinfo').read_text(), re.M)
    except OSError:
        named = None
    return {
        'date': datetime.now(UTC).isoformat(timespec='seconds'),
        'processor': named[1].strip() if named else platform.processor() or 'unknown',
        'cores': os.cpu_count() or 1,
        'system': f'{platform.system()} {platform.machine()}',
        'python': platform.python_version(),
        'numpy': np.__version__,
        'opencv': cv2.__version__,
        'vtrack_ros': __version__,
    }
