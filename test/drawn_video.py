"""A drawn target, textured like its background but with colours of its own, on any path."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box

SIZE = (320, 240)
TARGET = (48, 40)
START = (140.0, 110.0)
#: The target's colours, BGR.
COLOURS = [(20, 20, 200), (0, 220, 255), (10, 10, 40), (250, 240, 250)]
#: Noise of standard deviation 1, shape (rows, columns, 3), 64 px larger than an image each way: an
#: image gets a random crop of it, since drawing noise anew would take longer than all else here.
NOISE = np.random.default_rng(1).standard_normal((SIZE[1] + 64, SIZE[0] + 64, 3), np.float32)


def texture(shape: tuple[int, int], colours: list[tuple[int, int, int]], blob: int,
            rng: np.random.Generator) -> Frame:
    """Return an image of smooth blobs between the given colours (BGR)."""
    rows, columns = (-(-side // blob) + 2 for side in shape)
    coarse = np.array(colours, np.float32)[rng.integers(len(colours), size=(rows, columns))]
    fine = cv2.resize(coarse, (columns * blob, rows * blob), interpolation=cv2.INTER_CUBIC)
    fine = fine[:shape[0], :shape[1]] + rng.normal(0, 3, (*shape, 1))
    return np.clip(fine, 0, 255).astype(np.uint8)


def noise_part(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return a random crop of `NOISE` of the size of an image."""
    top, left = rng.integers(64, size=2)
    return NOISE[top:top + SIZE[1], left:left + SIZE[0]]


class DrawnVideo:
    """Frames of a target on a background; places are its centres in pixels, with subpixels."""

    def __init__(self, colour: bool = True, seed: int = 0, blob: int = 12) -> None:
        rng = np.random.default_rng(seed)
        self.colour = colour
        self._background = texture(
            SIZE[::-1], [(90, 110, 90), (130, 130, 120), (110, 90, 80), (140, 150, 150)], blob,
            rng)
        self._target = texture(TARGET[::-1], COLOURS, 8, rng)
        self._rng = rng

    def frame(self, center: tuple[float, float] | None, noise: float = 2.0) -> Frame:
        """Draw the target at a centre, or the background alone."""
        image = self._background.astype(np.float32)
        if center is not None:
            matrix = np.array([[1.0, 0.0, center[0] - TARGET[0] / 2],
                               [0.0, 1.0, center[1] - TARGET[1] / 2]])
            cv2.warpAffine(self._target.astype(np.float32), matrix, SIZE, dst=image,
                           flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT)
        image += cv2.cvtColor(noise * noise_part(self._rng)[..., 0], cv2.COLOR_GRAY2BGR)
        result = np.clip(image, 0, 255, out=image).astype(np.uint8)
        return result if self.colour else cv2.cvtColor(result, cv2.COLOR_BGR2GRAY)

    def frames(self, centers: Iterable[tuple[float, float] | None]) -> Iterator[Frame]:
        """Draw one frame for each centre."""
        return (self.frame(center) for center in centers)


def box_at(center: tuple[float, float]) -> Box:
    """Return the target's true box."""
    return Box.from_center(*center, *TARGET)


def region_at(center: tuple[float, float]) -> tuple[slice, slice]:
    """Return the slices of the rows and columns that the target covers."""
    left, top = (int(place - side / 2) for place, side in zip(center, TARGET))
    return slice(top, top + TARGET[1]), slice(left, left + TARGET[0])


def look_alike(video: DrawnVideo, center: tuple[float, float],
               share: float) -> NDArray[np.float64]:
    """Return the target's region, blended by `share` with another texture of its colours."""
    other = texture(TARGET[::-1], COLOURS, 8, np.random.default_rng(7))
    target = video.frame(center, noise=0.0)[region_at(center)]
    return share * target + (1 - share) * other


def straight(steps: int, velocity: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the `steps` + 1 centres, from `START` on, of a constant velocity, [px/frame]."""
    return [(START[0] + i * velocity[0], START[1] + i * velocity[1]) for i in range(steps + 1)]
