"""Frames from image folders and video files, with their truth where there is one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math
from pathlib import Path

import cv2
import numpy as np

from vtrack_ros.bags.errors import BagError
from vtrack_ros.bags.recording import Truth
from vtrack_ros.evaluation.sequences import (
    image_files, read_image, read_truth, SequenceError)
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box

#: What a sequence's folder calls its truth.
TRUTH_NAME = 'groundtruth_rect.txt'


@dataclass(frozen=True)
class Source:
    """
    Where frames come from.

    Parameters
    ----------
    path : Path
        An image folder or a video file.
    images : tuple of Path
        The image files; empty for a video.
    truth : tuple of Box or None, optional
        The box of each frame, None where the target is absent; None where nothing is known.
    rate : float, optional, [Hz]
        The frame rate that the file tells.

    """

    path: Path
    images: tuple[Path, ...]
    truth: tuple[Truth, ...] | None
    rate: float | None = None

    @property
    def count(self) -> int | None:
        """Return the number of frames, where it's known before they are read."""
        return len(self.images) or (None if self.truth is None else len(self.truth))

    def frames(self) -> Iterator[tuple[Frame, Truth]]:
        """
        Decode the frames.

        Raises
        ------
        BagError
            If one can't be decoded or has another size, or there are more or fewer than the truth
            has rows.

        """
        decoded = _decoded(self.images) if self.images else _video_frames(self.path)
        count = 0
        for frame in decoded:
            count += 1
            if self.truth is not None and count > len(self.truth):
                raise BagError(f'{self.path} has more frames than the {len(self.truth)} rows of '
                               'its truth')
            yield frame, None if self.truth is None else self.truth[count - 1]
        if self.truth is not None and count < len(self.truth):
            raise BagError(f'{self.path} has {count} frames, but its truth {len(self.truth)} rows')


def open_source(path: Path, truth: Path | None = None, without_truth: bool = False) -> Source:
    """
    Look at an image folder or a video file.

    Parameters
    ----------
    path : Path
        A folder with images, or with ``img/`` and ``groundtruth_rect.txt``; or a video file.
    truth : Path, optional
        A file of boxes, one ``x,y,width,height`` a row; by default the folder's own.
    without_truth : bool
        Whether to leave the truth out.

    Raises
    ------
    BagError, ValueError
        If there is nothing that can be read, or the truth doesn't fit.

    """
    if not path.exists():
        raise BagError(f'{path} does not exist')
    if truth is not None and not truth.is_file():
        raise BagError(f'{truth} is not a file')
    images: tuple[Path, ...] = ()
    rate = None
    if path.is_dir():
        images = image_files(path)
        truth = truth or next((place for place in (path / TRUTH_NAME, path.parent / TRUTH_NAME)
                               if place.is_file()), None)
    else:
        rate = _video_rate(path)
    boxes = None
    if truth is not None and not without_truth:
        rows = read_truth(truth)
        boxes = tuple(None if np.isnan(row).any() else Box(*row) for row in rows)
        if images and len(boxes) != len(images):
            raise BagError(f'{truth} has {len(boxes)} rows, but {path} {len(images)} images; give '
                           'another --truth FILE, or --no-truth')
    return Source(path, images, boxes, rate)


def _decoded(images: tuple[Path, ...]) -> Iterator[Frame]:
    size = None
    for path in images:
        try:
            frame = read_image(path)
        except SequenceError as error:
            raise BagError(str(error)) from None
        size = size or frame.shape
        if frame.shape != size:
            height, width = frame.shape[:2]
            raise BagError(f'{path} is {width} x {height} pixels, but the images before it '
                           f'{size[1]} x {size[0]}: a target is followed in images of one size')
        yield frame


def _video_rate(path: Path) -> float | None:
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise BagError(f'{path} is neither a folder of images nor a video that can be read')
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        return rate if math.isfinite(rate) and 0 < rate <= 1000 else None
    finally:
        capture.release()


def _video_frames(path: Path) -> Iterator[Frame]:
    capture = cv2.VideoCapture(str(path))
    try:
        while True:
            found, frame = capture.read()
            if not found:
                return
            yield np.asarray(frame, np.uint8)
    finally:
        capture.release()
