"""A bag of what a page shows."""

from pathlib import Path
import shutil
import time
from typing import Any

from vtrack_ros.bags import BagWriter, messages
from vtrack_ros.messages.images import decoded, stamp_nanoseconds

#: Recording stops when the free disk space falls below this, in bytes.
_LEFT = 2**29
_IMAGES, _ANSWERS = '/image', '/detections'


class Recording:
    """
    Writes images and the node's detections, as they come, into a new bag in a folder.

    The bag appears when it's finished. BagError if it can't be written.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        name = time.strftime('recording_%Y%m%d_%H%M%S')
        self._path, number = folder / name, 1
        while self._path.exists():
            number += 1
            self._path = folder / f'{name}_{number}'
        self._images = 0
        self._writer = BagWriter(self._path)
        self._writer.__enter__()

    @property
    def full(self) -> bool:
        """Return whether the free disk space is below its lower bound."""
        return shutil.disk_usage(self._folder).free < _LEFT

    def add_image(self, message: Any) -> None:
        """Write an Image or CompressedImage as an Image; one that can't be decoded is left out."""
        try:
            frame = decoded(message)
        except ValueError:
            return
        header = message.header
        self._write(_IMAGES, messages.image(
            frame, stamp_nanoseconds(header.stamp), header.frame_id))
        self._images += 1

    def add_answer(self, message: Any) -> None:
        """Write the boxes of a Detection2DArray: one, or none."""
        header, box, score = message.header, messages.detected_box(message), 1.0
        if box is not None and message.detections[0].results:
            score = float(message.detections[0].results[0].hypothesis.score)
        self._write(_ANSWERS, messages.detections(
            box, stamp_nanoseconds(header.stamp), header.frame_id, score=score))

    def finish(self) -> str:
        """Complete the bag, and say where it is."""
        self._writer.__exit__(None)
        return f'{self._images} images are in {self._path}'

    def _write(self, topic: str, message: Any) -> None:
        # Stored by the time of reception, for the stamps may go back.
        self._writer.write(topic, message, time.time_ns())
