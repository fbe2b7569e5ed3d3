"""On what machine, with which versions and when something was measured."""

from __future__ import annotations

from datetime import datetime, UTC
import os
from pathlib import Path
import platform

import cv2
import numpy as np

from vtrack_ros import __version__


def environment() -> dict[str, str | int]:
    """Return machine, versions and date, for the head of a table of measurements."""
    return {
        'date': datetime.now(UTC).isoformat(timespec='seconds'),
        'processor': _processor(),
        'cores': os.cpu_count() or 1,
        'system': f'{platform.system()} {platform.machine()}',
        'python': platform.python_version(),
        'numpy': np.__version__,
        'opencv': cv2.__version__,
        'vtrack_ros': __version__,
    }


def _processor() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        lines = []
    for line in lines:
        key, _, value = line.partition(':')
        if key.strip() == 'model name':
            return value.strip()
    return platform.processor() or 'unknown'
