"""A picture of a target as it was selected, from which a tracker can learn it again."""

from __future__ import annotations

from dataclasses import dataclass
import math

import cv2
import numpy as np

from vtrack_ros.appearance.sampling import shrunk
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.geometry.affine import rotation

#: Side of the region that a picture shows, relative to the target's longer side: as far as a
#: search window may reach.
_REGION_FACTOR = 4.0
#: The longest side of a picture, in pixels: larger ones are scaled down.
LONGEST_SIDE = 256


@dataclass(frozen=True)
class Exemplar:
    """A picture of a target with its surroundings, and the target's box in it, in its pixels."""

    picture: Frame
    box: Box

    @classmethod
    def of(cls, frame: Frame, box: Box) -> Exemplar:
        """Keep a frame's picture of the target in a box and of its surroundings."""
        left, top, width, height = surroundings(frame, box)
        picture = shrunk(frame[top:top + height, left:left + width], LONGEST_SIDE)
        across, down = picture.shape[1] / width, picture.shape[0] / height
        return cls(picture.copy(), Box((box.x - left) * across, (box.y - top) * down,
                                       box.width * across, box.height * down))

    def placed(self, box: Box, shape: tuple[int, ...], angle: float = 0.0) -> Frame:
        """
        Return an image of a shape with the target in a box; the picture's border is repeated.

        The whole picture is rotated by an angle, [rad], about the box's centre.
        """
        scale = np.array([box.width / self.box.width, box.height / self.box.height])
        turn = rotation(np.asarray(angle)) * scale
        # OpenCV's origin is the centre of the first pixel, that of boxes its outer corner
        moved = np.array(box.center) - 0.5 + turn @ (0.5 - np.array(self.box.center))
        return np.asarray(cv2.warpAffine(
            self.picture, np.column_stack([turn, moved]), (shape[1], shape[0]),
            flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def surroundings(frame: Frame, box: Box) -> tuple[int, int, int, int]:
    """Return the region (left, top, width, height) of a frame about a box, in pixels."""
    side = _REGION_FACTOR * max(box.width, box.height)
    around = Box.from_center(*box.center, side, side).clipped(frame.shape[1], frame.shape[0])
    if around is None:
        around = Box(0, 0, frame.shape[1], frame.shape[0])
    left, top = math.floor(around.x), math.floor(around.y)
    right = min(math.ceil(around.x + around.width), frame.shape[1])
    bottom = min(math.ceil(around.y + around.height), frame.shape[0])
    return left, top, right - left, bottom - top
