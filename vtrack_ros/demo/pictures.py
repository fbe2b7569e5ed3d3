"""The demo's pictures: a video of the run, and a sheet of its frames."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np

from vtrack_ros.bags import BagReader
from vtrack_ros.drawing import Canvas, contact_sheet, STATES, TRUTH, Video
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import Frame, TrackState

#: How many frames the sheet shows.
SHEET = 16
#: How many centres the trail has.
TRAIL = 60


def draw_run(bag: Path, topic: str, frames: Mapping[int, Mapping[str, Any]],
             truth: Mapping[int, Box | None], out: Path) -> list[Path]:
    """
    Write the video and the contact sheet of a run.

    Parameters
    ----------
    bag : Path
        Where the images come from.
    topic : str
        Their topic.
    frames : mapping
        The record: stamp -> what was heard, as `Record.frames`.
    truth : mapping
        Stamp -> true box.
    out : Path
        The folder.

    Returns
    -------
    list of Path
        What was written.

    """
    with BagReader(bag) as reader:
        stamps = [frame.stamp for frame in reader.frames(topic)]
    chosen = set(np.linspace(0, len(stamps) - 1, min(SHEET, len(stamps))).round().astype(int))
    intervals = [late - early for early, late in zip(stamps, stamps[1:]) if late > early]
    rate = 1e9 / median(intervals) if intervals else 30.0
    video_path, sheet_path = out / 'video.mp4', out / 'contact_sheet.png'
    trail: list[tuple[float, float]] = []
    sheet: list[Frame] = []
    with BagReader(bag) as reader, Video(video_path, rate) as video:
        for index, frame in enumerate(reader.frames(topic)):
            row = frames.get(frame.stamp, {})
            picture = _draw(frame.frame, index, row, truth.get(frame.stamp), trail)
            video.write(picture)
            if index in chosen:
                sheet.append(picture)
    cv2.imwrite(str(sheet_path), contact_sheet(sheet))
    return [video_path, sheet_path]


def _draw(frame: Frame, index: int, row: Mapping[str, Any], truth: Box | None,
          trail: list[tuple[float, float]]) -> Frame:
    canvas = Canvas(frame)
    if row.get('particles'):
        canvas.particles(np.array(row['particles']))
    if truth is not None:
        canvas.box(truth, TRUTH, 1)
    text, colour = 'no answer', TRUTH
    if 'box' in row:
        box = Box(*row['box'])
        trail.append(box.center)
        del trail[:-TRAIL]
        colour = STATES[TrackState.TRACKING]
        canvas.box(box, colour)
    canvas.trail(trail)
    if 'state' in row:
        text = row['state']
    canvas.text(f'{index}  {text}', colour)
    return canvas.picture
