"""The page of what was measured of faults, and in time."""

from __future__ import annotations

import json
from pathlib import Path
import textwrap
from typing import Any

import numpy as np

_KNOWN = ('sent', 'answered', 'right', 'wrong', 'foreign', 'recovered_s', 'seconds')
_FAULTS = """\
# Reliability

Written by `benchmarks/faults.py` and `benchmarks/soak.py` of what they measured: `gmpf`, VGA in
colour, over Fast DDS with the profile. One run on a shared machine of two cores: the times are
those of a busy one.

## Faults

At 30 Hz. *Sent* and *answered* are images, those of the recovery included; *right* boxes overlap
the target by more than a half, *wrong* ones less, and a pose beside the target is wrong too;
*foreign* is what had another header than that of an image that was sent. *Back after* is the time
from the first good image after the fault to the first right box: the median, and the longest.

| fault | sent | answered | right | wrong | foreign | back after | besides |
| --- | ---: | ---: | ---: | ---: | ---: | --- | --- |"""
_NOTES = """
- Nothing ended the node.
- What isn't answered was late, or was replaced by a newer image while another was worked on: a
  frame that comes twice at once, the flood, the parameter calls, which the same thread serves.
- The publisher's time is from its first image on, the node's from its death, the start of Python
  and ROS included. No target was pointed out again after either.
- A restarted node learns the target as it was selected. While it learned what was seen last, runs
  of 30 and 100 kills lost the target for good and said TRACKING, and another one of 100 did not.
  Once in 100 nothing came within 15 s, beside five busy processes on two cores; the next start
  found the target. In two other runs, of 70 and of 100, each did.
- Another size of the images gives the target up, as documented, and so does a clock that is set
  back: for those rows it was pointed out again, and the time counts from there. After an 8K image
  (99.5 MB) the process stays larger by about one."""


def page(folder: Path) -> str:
    """Return the page of the figures that are in the folder."""
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
    """Return the median and the longest time, and how often there was one, if not always."""
    times = [time for time in recovered if time is not None]
    if not times:
        return 'never' if recovered else ''
    text = f'{np.median(times):.2f} s' + (f', {max(times):.2f} s' if len(times) > 1 else '')
    return text if len(times) == len(recovered) else f'{len(times)} of {len(recovered)}: {text}'


def _soak(soak: dict[str, Any]) -> list[str]:
    rows = soak['minutes']
    # A minute is like the first one where the host took no more of it.
    like = max(index for index, row in enumerate(rows) if row['stolen'] <= rows[0]['stolen'])
    shown = sorted({0, like, len(rows) - 1})
    sent, answered = (sum(row[key] for row in rows) for key in ('sent', 'answered'))
    lines = ['', '## Soak', '',
             f'{len(rows)} minutes at {soak["rate_hz"]:g} Hz, {soak["date"]}: {answered} of '
             f'{sent} images answered, the others replaced by newer ones while',
             'the processor was taken. *Stolen* is the share of the machine that its host gave to',
             'others; the last minute of which it took no more than of the first is shown too.',
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
    # What whoever ran it has to say of that day.
    lines += ['', *textwrap.wrap(soak['note'], 99)] if 'note' in soak else []
    return lines


def _read(folder: Path, name: str) -> dict[str, Any]:
    path = folder / f'{name}.json'
    return json.loads(path.read_text(encoding='utf-8')) if path.is_file() else {}
