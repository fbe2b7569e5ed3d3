"""Axis-aligned boxes in image coordinates."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from vtrack_ros.frame import Array


@dataclass(frozen=True)
class Box:
    """
    An axis-aligned box, in pixels.

    The origin is the outer corner of the image's top-left pixel, x points right and y down: the
    pixel in column `i` covers `i <= x < i + 1`. A box may reach beyond the image.

    TypeError where a value isn't a real number, ValueError where one isn't finite or a size isn't
    positive.
    """

    x: float
    y: float
    width: float
    height: float

    def __post_init__(self) -> None:
        """Convert the values to float and check them."""
        for name, value in tuple(self.__dict__.items()):
            if type(value) is float and math.isfinite(value):
                continue
            try:
                if not hasattr(value, '__float__'):
                    raise TypeError
                number = float(value)
            except OverflowError:
                raise ValueError(
                    f'box {name} must be finite, but is larger than any float') from None
            except (TypeError, ValueError):
                raise TypeError(f'box {name} must be a number of pixels, not {value!r}') from None
            if not math.isfinite(number):
                raise ValueError(f'box {name} must be finite, not {number}')
            if number is not value:
                object.__setattr__(self, name, number)
        if self.width <= 0 or self.height <= 0:
            raise ValueError(
                f'box width and height must be positive, not {self.width:g} x {self.height:g}')

    @classmethod
    def from_center(cls, cx: float, cy: float, width: float, height: float) -> Box:
        """Make the box of a given centre and size, all in pixels."""
        return cls(cx - width / 2, cy - height / 2, width, height)

    @classmethod
    def around_ellipse(cls, center: tuple[float, float], size: tuple[float, float],
                       angle: float) -> Box:
        """
        Make the box around an ellipse inscribed in a rectangle of that centre and size, in pixels.

        The rectangle is turned by an angle, [rad]. Few targets have corners: the box around a
        round one doesn't grow when it turns.
        """
        (width, height), (cosine, sine) = size, (math.cos(angle), math.sin(angle))
        return cls.from_center(*center, math.hypot(cosine * width, sine * height),
                               math.hypot(sine * width, cosine * height))

    @property
    def center(self) -> tuple[float, float]:
        """Return the centre (x, y), in pixels."""
        return self.x + self.width / 2, self.y + self.height / 2

    @property
    def area(self) -> float:
        """Return the area, in square pixels."""
        return self.width * self.height

    def as_array(self) -> Array:
        """Return (x, y, width, height) as an array of shape (4,), in pixels."""
        return np.array([self.x, self.y, self.width, self.height])

    def clipped(self, image_width: int, image_height: int) -> Box | None:
        """Return the part inside an image of that size, or None where nothing is inside."""
        left, top = max(self.x, 0.0), max(self.y, 0.0)
        right = min(self.x + self.width, float(image_width))
        bottom = min(self.y + self.height, float(image_height))
        if right <= left or bottom <= top:
            return None
        return Box(left, top, right - left, bottom - top)

    def iou(self, other: Box) -> float:
        """Return the intersection over union with another box, in [0, 1]."""
        overlap_x = min(self.x + self.width, other.x + other.width) - max(self.x, other.x)
        overlap_y = min(self.y + self.height, other.y + other.height) - max(self.y, other.y)
        if overlap_x <= 0 or overlap_y <= 0:
            return 0.0
        # areas in units of the larger sides, for those of extreme boxes are no floats
        wide, high = max(self.width, other.width), max(self.height, other.height)
        overlap = (overlap_x / wide) * (overlap_y / high)
        areas = ((box.width / wide) * (box.height / high) for box in (self, other))
        return overlap / (sum(areas) - overlap)

    def center_distance(self, other: Box) -> float:
        """Return the distance between the two centres, in pixels."""
        (ax, ay), (bx, by) = self.center, other.center
        return math.hypot(ax - bx, ay - by)
