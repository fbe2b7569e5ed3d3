"""The demo's pictures: a video of the run, and a sheet of its frames."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vtrack_ros.bags import BagReader
from vtrack_ros.drawing import Canvas, Film, STATES, TRUTH
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import Frame, TrackState


def draw_run(bag: Path, topic: str, frames: Mapping[int, Mapping[str, Any]],
             truth: Mapping[int, Box | None], out: Path) -> tuple[Path, Path]:
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
    tuple of Path
        The video and the sheet.

    """
    with BagReader(bag) as reader, Film(
            out, reader.rate(topic), reader.image_topic(topic).count) as film:
        for frame in reader.frames(topic):
            _film(film, frame.frame, frames.get(frame.stamp, {}), truth.get(frame.stamp))
    return film.paths


def _film(film: Film, frame: Frame, row: Mapping[str, Any], truth: Box | None) -> None:
    canvas = Canvas(frame)
    if row.get('particles'):
        canvas.particles(np.array(row['particles']))
    if truth is not None:
        canvas.box(truth, TRUTH, 1)
    text = row.get('state', 'no answer')
    if 'box' not in row:
        film.add(canvas, text)
        return
    box, colour = Box(*row['box']), STATES[TrackState.TRACKING]
    canvas.box(box, colour)
    film.add(canvas, text, box.center, colour)
