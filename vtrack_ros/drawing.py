"""Drawing a tracker's output: box, truth, particles and trail, and contact sheets and videos."""

from collections import deque
from collections.abc import Collection, Sequence
import math
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.file_names import is_utf8
from vtrack_ros.frame import Array
from vtrack_ros.geometry import Box
from vtrack_ros.trackers import Estimate, Frame, TrackState

#: Names of the files of a run.
VIDEO_FILE, SHEET_FILE = 'video.mp4', 'contact_sheet.png'
#: Colours, in BGR.
TRUTH = (255, 255, 255)
PARTICLE = (255, 200, 0)
TRAIL = (0, 220, 255)
STATES = {
    TrackState.TRACKING: (60, 220, 60),
    TrackState.SEARCHING: (0, 160, 255),
    TrackState.LOST: (60, 60, 230),
}
#: Fractional bits of OpenCV's fixed-point coordinates, for subpixel accuracy.
_BITS = 4
#: Longer side, in pixels, that small pictures are enlarged to, about, by an integer factor.
_LEGIBLE = 480
#: Bounds of the sides of a film's pictures, in pixels: those of MPEG-4.
_SHORTEST, _LONGEST = 2, 8190
#: Bounds of a video's rate, [Hz]; MPEG-4 can't have much lower or much higher ones.
_LOWEST_RATE, _HIGHEST_RATE = 0.01, 1000.0
#: Largest number of pictures on a contact sheet, and of positions in a trail.
_SHEET, TRAIL_LENGTH = 16, 60
#: Radius of a two-dimensional Gaussian's 90 % ellipse, in standard deviations.
_RADIUS = math.sqrt(-2 * math.log(0.1))


class AnnotatedFrame:
    """
    A copy of a frame to draw on, in coordinates of the frame [px].

    With `enlarge` a small one is enlarged to be legible.
    """

    def __init__(self, frame: Frame, enlarge: bool = True) -> None:
        colour = cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR) if frame.ndim == 2 else frame.copy()
        self._scale = max(1, round(_LEGIBLE / max(frame.shape[:2]))) if enlarge else 1
        if self._scale > 1:
            colour = cv2.resize(colour, None, fx=self._scale, fy=self._scale,
                                interpolation=cv2.INTER_NEAREST)
        self.picture: Frame = np.asarray(colour, np.uint8)

    def box(self, box: Box, colour: tuple[int, int, int], thickness: int = 2) -> None:
        """Draw a box."""
        x, y, width, height = box.as_array()
        corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
        self._lines(corners, colour, thickness, closed=True)

    def affine(self, affine: Array, colour: tuple[int, int, int]) -> None:
        """Draw the image of the unit square about the origin."""
        square = np.array([[-.5, -.5, 1], [.5, -.5, 1], [.5, .5, 1], [-.5, .5, 1]])
        self._lines((square @ affine.T)[:, :2], colour, 2, closed=True)

    def ellipse(self, box: Box, covariance: Array, colour: tuple[int, int, int]) -> None:
        """Draw the 90 % confidence ellipse of the centre; covariance of shape (>= 2, >= 2)."""
        values, vectors = np.linalg.eigh(covariance[:2, :2])
        axes = vectors * (_RADIUS * np.sqrt(np.maximum(values, 0)))
        turns = np.linspace(0, 2 * np.pi, 32, endpoint=False)
        outline = np.array(box.center) + np.stack([np.cos(turns), np.sin(turns)], 1) @ axes.T
        self._lines(outline, colour, 1, closed=True)

    def particles(self, centers: Array) -> None:
        """Draw particles; the centres have shape (N, >= 2)."""
        for x, y in self._fixed(np.asarray(centers)[:, :2]):
            cv2.circle(self.picture, (int(x), int(y)), 1 << _BITS, PARTICLE, -1,
                       cv2.LINE_AA, _BITS)

    def trail(self, centers: Collection[tuple[float, float]]) -> None:
        """Draw the target's path."""
        if len(centers) > 1:
            self._lines(np.array(list(centers)), TRAIL, 1, closed=False)

    def text(self, text: str, colour: tuple[int, int, int] = TRUTH) -> None:
        """Write a line into the top left corner."""
        # In OpenCV 5 thicker text is also wider, so the outline is thin text at 8 offsets.
        around = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]
        for (x, y), shade in (*((place, (0, 0, 0)) for place in around), ((0, 0), colour)):
            cv2.putText(self.picture, text, (6 + x, 18 + y), cv2.FONT_HERSHEY_SIMPLEX, 0.5, shade,
                        1, cv2.LINE_AA)

    def estimate(self, estimate: Estimate) -> None:
        """Draw all that is known of a target."""
        colour = STATES[estimate.state]
        if estimate.particles is not None and len(estimate.particles):
            self.particles(estimate.particles)
        if estimate.affine is not None:
            self.affine(estimate.affine, colour)
        self.box(estimate.box, colour, 2 if estimate.measured else 1)
        if np.isfinite(estimate.covariance[:2, :2]).all():
            self.ellipse(estimate.box, estimate.covariance, colour)

    def _fixed(self, points: Array) -> NDArray[np.int32]:
        # A box may be anywhere: beyond this bound OpenCV's integers would overflow.
        limit = 1e6
        scaled = np.clip(np.nan_to_num(points), -limit, limit) * self._scale - 0.5
        return np.asarray(np.round(scaled * (1 << _BITS)), np.int32)

    def _lines(self, points: Array, colour: tuple[int, int, int], thickness: int,
               closed: bool) -> None:
        cv2.polylines(self.picture, [self._fixed(points)], closed, colour, thickness,
                      cv2.LINE_AA, _BITS)


def contact_sheet(pictures: Sequence[Frame], columns: int = 4, gap: int = 4) -> Frame:
    """Return pictures of one size side by side, row by row, with gaps between them."""
    framed = [np.pad(picture, ((gap, 0), (gap, 0), (0, 0)), constant_values=32)
              for picture in pictures]
    framed += [np.full_like(framed[0], 32)] * (-len(framed) % columns)
    sheet = np.vstack([np.hstack(framed[begin:begin + columns])
                       for begin in range(0, len(framed), columns)])
    return np.pad(sheet, ((0, gap), (0, gap), (0, 0)), constant_values=32)


class Film:
    """
    The pictures of a run, in a folder: a video of all and a sheet of some; a context manager.

    Pictures with a side of more than 8190 pixels are reduced to that, those of a single column or
    row are doubled, and those of another size than the first one's are resized to it. After an
    error the video is removed, for an incomplete one looks like a complete one.

    `rate` is in frames per second, `count` the largest number of frames; a file that can't be
    written is an OSError. A rate beyond the video format's bounds is the nearest one within.
    """

    def __init__(self, folder: Path, rate: float, count: int) -> None:
        self.paths = (folder / VIDEO_FILE, folder / SHEET_FILE)
        self._rate = min(max(rate, _LOWEST_RATE), _HIGHEST_RATE)
        self._chosen = set(np.linspace(0, count - 1, min(_SHEET, count)).round().astype(int))
        self._index = 0
        self._sheet: list[Frame] = []
        self._trail: deque[tuple[float, float]] = deque(maxlen=TRAIL_LENGTH)
        self._writer: Any = None

    def __enter__(self) -> Self:
        """Return the film."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the files, or remove them after an error."""
        video, sheet = self.paths
        if self._writer is not None:
            self._writer.release()
            if kind is not None:
                video.unlink(missing_ok=True)
            elif 0 <= cv2.VideoCapture(str(video)).get(cv2.CAP_PROP_FRAME_COUNT) < self._index:
                # The writer itself doesn't report failed writes, as on a full disk.
                raise OSError(f'the video {video.name} is incomplete')
        if self._sheet and kind is None and not cv2.imwrite(
                str(sheet), contact_sheet(self._sheet)):
            raise OSError(f'the picture {sheet.name} is incomplete')

    def add(self, frame: Frame, text: str, *, truth: Box | None = None,
            estimate: Estimate | None = None, particles: Array | None = None) -> None:
        """
        Append a frame, with its number, a text and all that is known of it drawn over it.

        If the estimate is measured, its centre is added to the trail; `particles`, shape
        (N, >= 2), are centres besides the estimate's own.
        """
        picture = AnnotatedFrame(frame)
        if particles is not None:
            picture.particles(particles)
        if truth is not None:
            picture.box(truth, TRUTH, 1)
        if estimate is not None:
            picture.estimate(estimate)
            if estimate.measured:
                self._trail.append(estimate.box.center)
        picture.trail(self._trail)
        picture.text(f'{self._index}  {text}')
        self._write(picture.picture)
        self._index += 1

    def _write(self, picture: Frame) -> None:
        if self._writer is None:
            if not is_utf8(self.paths[0]):
                raise OSError(f'the video {self.paths[0].name} cannot be created: OpenCV needs a '
                              'folder whose name is UTF-8')
            share = min(1.0, _LONGEST / max(picture.shape[:2]))
            height, width = (max(_SHORTEST, round(share * side)) for side in picture.shape[:2])
            self._size = width, height
            code = cv2.VideoWriter.fourcc(*'mp4v')
            self._writer = cv2.VideoWriter(str(self.paths[0]), code, self._rate, self._size)
            if not self._writer.isOpened():
                raise OSError(f'the video {self.paths[0].name} cannot be created')
        if picture.shape[1::-1] != self._size:
            picture = np.asarray(cv2.resize(picture, self._size), np.uint8)
        self._writer.write(picture)
        if self._index in self._chosen:
            self._sheet.append(picture)
