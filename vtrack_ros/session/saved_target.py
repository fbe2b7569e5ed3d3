"""A target as data, from which another process can continue tracking it."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from dataclasses import asdict, dataclass
import json
import math
from typing import Any

import cv2
import numpy as np

from vtrack_ros.appearance.sampling import shrunk
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.session.exemplar import Exemplar, LONGEST_SIDE, surroundings
from vtrack_ros.session.last_measurement import LastMeasurement
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.tracker import GREATEST_SIDE, SHORTEST_SIDE

#: How the text of a saved target begins; any other text is rejected.
MARK = '{"format": "vtrack_ros target 1"'
#: Shortest side of the target's box in its first picture, which may be scaled down, in pixels.
_SHORTEST_SIDE = 1e-3


@dataclass(frozen=True)
class SavedTarget:
    """
    A target where it was last measured, with a picture of it.

    `stamp` [ns] and `frame_id` are those of that frame, `shape` is its shape; `interval` [ns] is
    the usual one between frames (0: unknown), `time` [ns] the wall clock when it was saved. `node`
    and `tracker` are names, `identity` is the target's class and id. `picture` is a JPEG of the
    frame's region (left, top, width, height) [px] about the target; `first_picture` is one of the
    target when it was selected, and `first_box` its box in that. `angle`, [rad], is its rotation
    since then; `box` is upright, without that rotation.
    """

    node: str
    tracker: str
    identity: tuple[str, str]
    time: int
    stamp: int
    interval: int
    frame_id: str
    shape: tuple[int, ...]
    box: Box
    region: tuple[int, int, int, int]
    picture: bytes
    first_box: Box
    first_picture: bytes
    angle: float = 0.0

    @classmethod
    def of(cls, session: TrackingSession, identity: tuple[str, str], node: str, frame_id: str,
           time: int) -> Callable[[], SavedTarget] | None:
        """
        Return a function that makes the data of a session's target; None without a target.

        Calling it takes milliseconds, and may be done in another thread.
        """
        seen, first = session.last_measurement, session.exemplar
        if seen is None or first is None:
            return None
        tracker, interval = session.tracker, round(session.interval or 0)

        def make() -> SavedTarget:
            left, top, width, height = region = surroundings(seen.frame, seen.bound)
            picture = shrunk(seen.frame[top:top + height, left:left + width], LONGEST_SIDE)
            return cls(node, tracker, identity, time, seen.stamp, interval, frame_id,
                       seen.frame.shape, seen.box, region, _encoded(picture), first.box,
                       _encoded(first.picture), seen.angle)
        return make

    @classmethod
    def parsed(cls, text: str) -> SavedTarget:
        """Return the target that `text` holds; a ValueError says what is wrong with it."""
        if not text.startswith(MARK):
            raise ValueError(f'it does not begin with {MARK}')
        try:
            rows = json.loads(text)
            node, tracker, frame_id = (str(rows[name]) for name in ('node', 'tracker', 'frame_id'))
            class_id, target_id = map(str, rows['identity'])
            time, stamp, interval = (
                _integer(rows[name]) for name in ('time', 'stamp', 'interval'))
            shape = tuple(map(_integer, rows['shape']))
            left, top, width, height = map(_integer, rows['region'])
            box, first_box = (Box(**rows[name]) for name in ('box', 'first_box'))
            # not in the files of earlier versions
            angle = float(rows.get('angle', 0.0))
            picture, first_picture = (base64.b64decode(rows[name], validate=True)
                                      for name in ('picture', 'first_picture'))
        except (AttributeError, binascii.Error, KeyError, OverflowError, RecursionError, TypeError,
                ValueError) as error:
            raise ValueError(f'{type(error).__name__}: {error}') from None
        if len(shape) not in (2, 3) or shape[2:] not in ((), (3,)) or min(shape) < 1:
            raise ValueError(f'{shape} is not the shape of an image')
        if not (0 <= left < left + width <= shape[1] and 0 <= top < top + height <= shape[0]):
            raise ValueError('its picture is not inside the image')
        if box.clipped(shape[1], shape[0]) is None:
            raise ValueError('its box is not inside the image')
        sides = box.width, box.height, first_box.width, first_box.height
        if min(sides) < SHORTEST_SIDE or max(sides) > GREATEST_SIDE:
            raise ValueError(f'a box with a side that is not from {SHORTEST_SIDE:g} to '
                             f'{GREATEST_SIDE:.0f} px is impossible')
        if not abs(angle) <= math.tau:
            raise ValueError(f'a rotation of {angle} rad is impossible')
        return cls(node, tracker, (class_id, target_id), time, stamp, interval, frame_id, shape,
                   box, (left, top, width, height), picture, first_box, first_picture, angle)

    def text(self) -> str:
        """Return it as JSON."""
        rows: dict[str, Any] = asdict(self)
        for name in ('picture', 'first_picture'):
            rows[name] = base64.b64encode(rows[name]).decode('ascii')
        text = json.dumps(rows)
        return f'{MARK}, {text[1:]}\n'

    def check(self, frame: Frame, stamp: int, frame_id: str, now: int, longest: float) -> None:
        """
        Raise a ValueError, with the reason, if the target isn't that of a stream that begins.

        The stream's first frame is stamped `stamp` [ns] in `frame_id`, and came at `now` [ns] on
        the wall clock, at most `longest` seconds after the target was saved.
        """
        age = (now - self.time) / 1e9
        if age > longest:
            raise ValueError(f'it was saved {age:.0f} s ago, but may be at most {longest:g} s old')
        if age < -1:
            raise ValueError(f'it was saved {-age:.0f} s in the future')
        if frame.shape != self.shape:
            was, now_is = (' x '.join(map(str, (*shape[1::-1], *shape[2:])))
                           for shape in (self.shape, frame.shape))
            raise ValueError(f'its image is {was}, but the received image is {now_is}')
        if frame_id != self.frame_id:
            raise ValueError(f'its image has the frame_id {self.frame_id!r}, but the received '
                             f'image has {frame_id!r}')
        if stamp < self.stamp:
            raise ValueError('its image is newer than the received one: another stream')

    def measurement(self) -> LastMeasurement:
        """
        Return its last measurement, on an image that has the picture and its repeated border.

        ValueError if the picture can't be decoded.
        """
        left, top, width, height = self.region
        pixels = cv2.resize(
            self._decoded(self.picture), (width, height), interpolation=cv2.INTER_LINEAR)
        rest = (top, self.shape[0] - top - height, left, self.shape[1] - left - width)
        frame = np.asarray(cv2.copyMakeBorder(pixels, *rest, cv2.BORDER_REPLICATE), np.uint8)
        return LastMeasurement(frame, self.stamp, self.box, self.angle)

    def exemplar(self) -> Exemplar:
        """Return its first picture; ValueError if that can't be decoded, or lacks its box."""
        picture, box = self._decoded(self.first_picture), self.first_box
        if box.clipped(picture.shape[1], picture.shape[0]) is None or min(
                box.width, box.height) < _SHORTEST_SIDE:
            raise ValueError(f'its first picture of {picture.shape[1]} x {picture.shape[0]} '
                             'pixels does not contain its first box')
        return Exemplar(picture, box)

    def _decoded(self, picture: bytes) -> Frame:
        colour = len(self.shape) == 3
        try:
            pixels = cv2.imdecode(np.frombuffer(picture, np.uint8),
                                  cv2.IMREAD_COLOR if colour else cv2.IMREAD_GRAYSCALE)
        except cv2.error:
            pixels = None
        if pixels is None:
            raise ValueError('its picture cannot be decoded')
        return np.asarray(pixels, np.uint8)


def _encoded(picture: Frame) -> bytes:
    return cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()


def _integer(value: Any) -> int:
    if type(value) is not int:
        raise TypeError(f'{value!r} is not an integer')
    if not -2 ** 63 <= value < 2 ** 63:
        raise ValueError('an integer is longer than 64 bits')
    return value
