"""The page of reliability: results of the faults and of the soak."""

from __future__ import annotations

import json
from pathlib import Path
import textwrap
from typing import Any

import numpy as np

_KNOWN = ('sent', 'answered', 'right', 'wrong', 'foreign', 'recovered_s', 'seconds')
_FAULTS = """\
# Reliability

Written by `benchmarks/faults.py` and `benchmarks/soak.py`: `gmpf`, VGA in colour, over Fast DDS
with the profile. One run on a shared machine with two cores, so the times are those of a busy
machine.

## Faults

At 30 Hz. *Sent* and *answered* are numbers of images, those of the recovery included. *Right*
boxes have an overlap (IoU) with the target above 0.5; *wrong* are other boxes, and poses beside
the target. *Foreign* are answers whose header isn't that of an image that was sent. *Back after*
is the time from the first good image after the fault to the first right box: median and maximum.

| fault | sent | answered | right | wrong | foreign | back after | other figures |
| --- | ---: | ---: | ---: | ---: | ---: | --- | --- |"""
_NOTES = """
- No fault ended the node.
- Images without an answer were late, or were replaced by a newer one while the node was busy: when
  a frame comes twice, in the flood, and during parameter calls, which the same thread serves.
- A killed publisher's time counts from the first image of the next one; a killed node's from its
  end, and includes the start of Python and ROS. The target wasn't selected again in either case.
- A restarted node learns the target as it was selected. A former version learned it as last seen:
  runs of 30 and 100 kills lost the target for good and reported TRACKING; another one of 100 did
  not. Once in 100 there was no answer within 15 s, beside five busy processes on two cores; the
  next start found the target. In two other runs, of 70 and of 100 kills, every start found it.
- When the image size changes, the node drops the target, as documented, and also when a clock is
  set back: in those rows it was selected again, and the time counts from there. After an 8K image
  (99.5 MB) the process stays larger by about the size of one."""


def page(folder: Path) -> str:
    """Return the page with the figures of the result files in a folder."""
    lines = [_FAULTS]
    for name, one in _read(folder, 'faults').get('faults', {}).items():
        back = _back(one['recovered_s'])
        counts = ['' if one.get(key) is None else str(one[key]) for key in _KNOWN[:5]]
        more = ', '.join(f'{key.replace("_", " ")} {value:.4g}' for key, value in one.items()
                         if key not in _KNOWN)
        lines.append(f'| {name} | {" | ".join(counts)} | {back} | {more} |')
    lines.append(_NOTES)
    soak = _read(folder, 'soak')
    if soak:
        lines += _soak(soak)
    return '\n'.join(lines) + '\n'


def _back(recovered: list[float | None]) -> str:
    """Return median and maximum of the times, and how often it recovered, if not always."""
    times = [time for time in recovered if time is not None]
    if not times:
        return 'never' if recovered else ''
    text = f'{np.median(times):.2f} s' + (f', {max(times):.2f} s' if len(times) > 1 else '')
    return text if len(times) == len(recovered) else f'{len(times)} of {len(recovered)}: {text}'


def _soak(soak: dict[str, Any]) -> list[str]:
    rows = soak['minutes']
    # The last minute with at most the first one's steal time.
    like = max(index for index, row in enumerate(rows) if row['stolen'] <= rows[0]['stolen'])
    shown = sorted({0, like, len(rows) - 1})
    sent, answered = (sum(row[key] for row in rows) for key in ('sent', 'answered'))
    lines = ['', '## Soak', '',
             f'{len(rows)} minutes at {soak["rate_hz"]:g} Hz, {soak["date"]}: {answered} of '
             f'{sent} images answered, the others replaced by newer ones while the',
             'processor was busy. *Stolen* is the share of processor time that the host gave to',
             'others; the last minute with no more of it than in the first is shown too. At most '
             '16 MB of images are kept for selections (`history_megabytes`).',
             '', f'| | {" | ".join(f"minute {index + 1}" for index in shown)} | wanted |',
             f'| --- | {" | ".join(["---:"] * len(shown))} | --- |']
    for name, key, wanted in (
            ('images answered of 3600', 'answered', ''), ('with the target', 'found', 'all'),
            ('least overlap of a box (IoU)', 'least_iou', 'on the target'),
            ('latency p50, ms', 'latency_ms_p50', ''),
            ('latency p99, ms', 'latency_ms_p99', 'at most 1.2 times'),
            ("the tracker's own time, p50, ms", 'compute_ms_p50', ''),
            ('CPU per answered image, ms', 'cpu_ms_per_frame', ''),
            ('memory (RSS), MB', 'rss_mb', 'at most 2 more'),
            ('of that, not shared, MB', 'private_mb', 'at most 2 more'),
            ('file descriptors', 'descriptors', 'the same'), ('threads', 'threads', 'the same'),
            ('stolen', 'stolen', '')):
        figures = ' | '.join(f'{rows[index][key]:.4g}' for index in shown)
        lines.append(f'| {name} | {figures} | {wanted} |')
    # A note on the conditions, by the person who ran it.
    lines += ['', *textwrap.wrap(soak['note'], 99)] if 'note' in soak else []
    return lines


def _read(folder: Path, name: str) -> dict[str, Any]:
    path = folder / f'{name}.json'
    return json.loads(path.read_text(encoding='utf-8')) if path.is_file() else {}
