"""Disturbances of a frame: shift, rotation, occlusion, distractor, darkening, blur, noise."""

from collections.abc import Iterable
import math
from typing import Any

import cv2
import numpy as np

from vtrack_ros.frame import Array, Array32, Frame
from vtrack_ros.geometry.affine import rotation

#: Outer share of an ellipse's radius over which the opacity of a cut-out falls to 0.
_FEATHER = 0.3
#: Minimum width and height [px] of a strip beside the box that an occluder is cut from.
_NARROWEST = 4


def shifted(frame: Frame, offset: Iterable[int]) -> Frame:
    """Return a frame whose content is moved by (x, y) whole pixels, its border repeated."""
    x, y = offset
    matrix = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
    height, width = frame.shape[:2]
    return _pixels(cv2.warpAffine(frame, matrix, (width, height), flags=cv2.INTER_NEAREST,
                                  borderMode=cv2.BORDER_REPLICATE))


def rolled(frame: Frame, center: Array, angle: float) -> Frame:
    """Return a frame rotated about a centre (x, y), its border repeated; the angle is in rad."""
    linear, middle = rotation(np.asarray(angle)), center - 0.5
    matrix = np.column_stack([linear, middle - linear @ middle])
    height, width = frame.shape[:2]
    return _pixels(cv2.warpAffine(frame, matrix, (width, height), flags=cv2.INTER_LINEAR,
                                  borderMode=cv2.BORDER_REPLICATE))


def surroundings(frame: Frame, box: Array, size: tuple[int, int],
                 rng: np.random.Generator) -> Frame:
    """
    Return a piece of a frame, `size` = (width, height) pixels, from beside a box, shape (4,).

    If there is too little room beside the box, a smaller piece is enlarged; if there is none, the
    piece has the frame's mean colour.
    """
    height, width = frame.shape[:2]
    left, top = (math.floor(value) for value in box[:2])
    right, bottom = (math.ceil(value) for value in box[:2] + box[2:])
    strips = [(0, 0, min(left, width), height), (max(right, 0), 0, width, height),
              (0, 0, width, min(top, height)), (0, max(bottom, 0), width, height)]
    rooms = [(min(x1 - x0, size[0]), min(y1 - y0, size[1]), x0, y0, x1, y1)
             for x0, y0, x1, y1 in strips if min(x1 - x0, y1 - y0) >= _NARROWEST]
    place = rng.random(3)
    if not rooms:
        mean = np.rint(frame.mean(axis=(0, 1))).astype(np.uint8)
        return np.broadcast_to(mean, (size[1], size[0], *frame.shape[2:])).copy()
    largest = max(wide * high for wide, high, *_ in rooms)
    fitting = [room for room in rooms if room[0] * room[1] == largest]
    wide, high, x0, y0, x1, y1 = fitting[int(place[0] * len(fitting))]
    x = x0 + int(place[1] * (x1 - x0 - wide + 1))
    y = y0 + int(place[2] * (y1 - y0 - high + 1))
    piece = frame[y:y + high, x:x + wide]
    return piece.copy() if (wide, high) == size else _pixels(cv2.resize(piece, size))


def covered(frame: Frame, piece: Frame, center: Array) -> Frame:
    """Return a frame with a piece pasted over it, centred at (x, y) and clipped to the frame."""
    high, wide = piece.shape[:2]
    x, y = (round(float(value)) for value in center - np.array([wide, high]) / 2)
    area = _inside(frame, x, y, wide, high)
    if area is None:
        return frame
    x0, y0, x1, y1 = area
    result = frame.copy()
    result[y0:y1, x0:x1] = piece[y0 - y:y1 - y, x0 - x:x1 - x]
    return result


def doubled(frame: Frame, box: Array, offset: Array) -> Frame:
    """
    Return a frame with a copy of a box's content, shape (4,), `offset` pixels (x, y) away.

    The copy (twin) is an ellipse that fades at its rim; it is in front of the original.
    """
    x0, y0 = (math.floor(value) for value in box[:2])
    x1, y1 = (math.ceil(value) for value in box[:2] + box[2:])
    source = _inside(frame, x0, y0, x1 - x0, y1 - y0)
    dx, dy = (round(float(value)) for value in offset)
    if source is None:
        return frame
    x0, y0, x1, y1 = source
    target = _inside(frame, x0 + dx, y0 + dy, x1 - x0, y1 - y0)
    if target is None:
        return frame
    left, top, right, bottom = target
    alpha = _ellipse(box, left - dx, top - dy, right - dx, bottom - dy)
    if frame.ndim == 3:
        alpha = alpha[..., None]
    twin = frame[top - dy:bottom - dy, left - dx:right - dx]
    behind = frame[top:bottom, left:right]
    result = frame.copy()
    result[top:bottom, left:right] = np.rint(alpha * twin + (1 - alpha) * behind)
    return result


def darkened(frame: Frame, factor: float, angle: float) -> Frame:
    """
    Return a frame darkened by a factor, unevenly.

    The gain is 1 / factor in the middle and rises in the direction of the angle [rad], at most
    from factor ** -1.5 in one corner to factor ** -0.5 in the opposite one.
    """
    height, width = frame.shape[:2]
    along = (np.linspace(-1, 1, width) * math.cos(angle)
             + np.linspace(-1, 1, height)[:, None] * math.sin(angle)) / math.sqrt(2)
    gain = (factor ** (0.5 * along - 1)).astype(np.float32)
    return _clipped(frame * (gain if frame.ndim == 2 else gain[..., None]))


def defocused(frame: Frame, sigma: float) -> Frame:
    """Return a frame blurred by a Gaussian with the standard deviation `sigma` [px]."""
    return _pixels(cv2.GaussianBlur(frame, (0, 0), max(sigma, 0.1)))


def smeared(frame: Frame, length: float, angle: float) -> Frame:
    """Return a frame with motion blur: a line of a length in pixels at an angle in rad."""
    points = np.linspace(-0.5, 0.5, 4 * math.ceil(length) + 1)[:, None] * length
    places = points * [math.cos(angle), math.sin(angle)]
    radius = math.ceil(length / 2)
    grid = np.arange(-radius, radius + 1)
    weights = [np.clip(1 - abs(grid - places[:, axis, None]), 0, 1) for axis in (0, 1)]
    kernel = weights[1].T @ weights[0]
    return _pixels(cv2.filter2D(frame, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE))


def noisy(frame: Frame, deviation: float, rng: np.random.Generator) -> Frame:
    """Return a frame with Gaussian noise in each channel; `deviation` is in levels of 0 to 255."""
    return _clipped(frame + np.float32(deviation) * rng.standard_normal(
        frame.shape, dtype=np.float32))


def compressed(frame: Frame, quality: int) -> Frame:
    """Return a frame after JPEG compression with a quality of 0 to 100."""
    data = cv2.imencode('.jpg', frame, (cv2.IMWRITE_JPEG_QUALITY, quality))[1]
    return _pixels(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))


def reduced(frame: Frame, size: tuple[int, int]) -> Frame:
    """Return a frame reduced to (width, height) pixels."""
    return _pixels(cv2.resize(frame, size, interpolation=cv2.INTER_AREA))


def _inside(frame: Frame, x: int, y: int, wide: int, high: int) -> (
        tuple[int, int, int, int] | None):
    """Return the part of a rectangle that is inside a frame: left, top, right, bottom."""
    height, width = frame.shape[:2]
    left, top, right, bottom = max(x, 0), max(y, 0), min(x + wide, width), min(y + high, height)
    return (left, top, right, bottom) if left < right and top < bottom else None


def _ellipse(box: Array, left: int, top: int, right: int, bottom: int) -> Array32:
    """Return the opacity, 0 to 1, of the ellipse inscribed in a box, for each pixel of an area."""
    center, radii = box[:2] + box[2:] / 2, box[2:] / 2
    x = (np.arange(left, right) + 0.5 - center[0]) / radii[0]
    y = (np.arange(top, bottom) + 0.5 - center[1]) / radii[1]
    share: Array32 = np.clip((1 - np.hypot(x, y[:, None])) / _FEATHER, 0, 1).astype(np.float32)
    return share


def _clipped(values: Array32) -> Frame:
    return np.rint(np.clip(values, 0, 255)).astype(np.uint8)


def _pixels(image: Any) -> Frame:
    return np.asarray(image, dtype=np.uint8)
