"""Results as JSON, with the machine, versions and date of the measurement."""

from collections.abc import Mapping
from dataclasses import asdict
from datetime import datetime, UTC
import json
import math
import os
from pathlib import Path
import platform
import re
from typing import Any

import cv2
import numpy as np

from vtrack_ros import __version__
from vtrack_ros.evaluation.results import Results
from vtrack_ros.evaluation.scoring import FIGURES


def environment() -> dict[str, str | int]:
    """Return machine, versions and date, for the header of a table of measurements."""
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


def as_json(results: Results) -> dict[str, Any]:
    """
    Return results as data that can be written as JSON.

    `sequences` is sequence -> tracker -> figures and `summary` tracker -> the means; each figure
    KEY has its standard deviation over seeds in KEY_std. An undefined figure is null. Only
    `environment`, `timings` and the figures marked `timed` differ when an evaluation is repeated.
    """
    return {
        'environment': environment(),
        'seeds': list(results.seeds),
        'timings': results.timings,
        'figures': {figure.key: {'description': figure.description, 'timed': figure.timed}
                    for figure in FIGURES},
        'trackers': {tracker.label: {'tracker': tracker.name, 'parameters': dict(
            tracker.parameters)} for tracker in results.trackers.values()},
        'sequences': {sequence: {tracker: plain(scores) for tracker, scores in row.items()}
                      for sequence, row in results.by_sequence.items()},
        'summary': {tracker: plain(scores) for tracker, scores in results.summary.items()},
        'problems': [asdict(problem) for problem in results.problems],
    }


def write_json(results: Results, path: Path, more: Mapping[str, Any] | None = None) -> None:
    """Write `as_json` and the items of `more` to a file."""
    content = {**as_json(results), **(more or {})}
    text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
    path.write_text(text + '\n', encoding='utf-8')


def plain(scores: Mapping[str, float]) -> dict[str, float | None]:
    """Return figures by name, None in place of those that JSON has no number for."""
    return {key: value if math.isfinite(value) else None for key, value in scores.items()}
