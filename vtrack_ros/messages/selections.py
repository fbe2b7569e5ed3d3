"""Selections of a target, made from messages."""

import math
from typing import Any

from vtrack_ros.geometry import Box
from vtrack_ros.messages.images import stamp_nanoseconds
from vtrack_ros.session.selection import Click, Selection


def from_detection(message: Any, source: str) -> Selection:
    """
    Return a Detection2D as a selection; a rotated box is replaced by its upright bounding box.

    ValueError if the box isn't finite, or its size isn't positive.
    """
    bounds = message.bbox
    center, theta = bounds.center.position, float(bounds.center.theta)
    width, height = float(bounds.size_x), float(bounds.size_y)
    given = {'center x': float(center.x), 'center y': float(center.y), 'theta': theta,
             'size_x': width, 'size_y': height}
    for name, value in given.items():
        if not math.isfinite(value):
            raise ValueError(f'box {name} must be finite, not {value}')
    if theta and width > 0 and height > 0:
        cosine, sine = abs(math.cos(theta)), abs(math.sin(theta))
        width, height = width * cosine + height * sine, width * sine + height * cosine
    box = Box.from_center(float(center.x), float(center.y), width, height)
    stamp = stamp_nanoseconds(message.header.stamp)
    scored = [(float(result.hypothesis.score), str(result.hypothesis.class_id))
              for result in message.results]
    class_id = max(scored)[1] if scored else ''
    return Selection(box, source, stamp or None, class_id=class_id, target_id=str(message.id))


def from_roi(message: Any, source: str) -> Selection:
    """Return a RegionOfInterest as a selection; ValueError if its size is zero."""
    box = Box(message.x_offset, message.y_offset, message.width, message.height)
    return Selection(box, source, clamp=True)


def from_point(message: Any, size: float, source: str) -> Selection:
    """
    Return a PointStamped, x and y in pixels, as a selection; ValueError if it isn't finite.

    `size` is the side of the square about the point, in pixels; with 0, the target's extent is
    determined from the image.
    """
    x, y = float(message.point.x), float(message.point.y)
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f'the point ({x:g}, {y:g}) must be finite')
    stamp = stamp_nanoseconds(message.header.stamp)
    return Selection(Click(x, y, size), source, stamp or None, clamp=True)


def best_detection(message: Any, class_id: str, score: float, source: str) -> Selection | None:
    """
    Return the best detection of a Detection2DArray as a selection; None if none is suitable.

    Suitable ones are of the class `class_id` (empty: any), with a score of at least `score`.
    """
    found: list[tuple[float, Selection]] = []
    for detection in message.detections:
        scores = [float(result.hypothesis.score) for result in detection.results
                  if class_id in ('', result.hypothesis.class_id)]
        if not scores or not max(scores) >= score:
            continue
        try:
            selection = from_detection(detection, source)
        except ValueError:
            continue
        stamp = selection.stamp or stamp_nanoseconds(message.header.stamp) or None
        name = class_id or selection.class_id
        found.append((max(scores), Selection(
            selection.box, source, stamp, True, name, selection.target_id, True)))
    return max(found, key=lambda pair: pair[0])[1] if found else None
