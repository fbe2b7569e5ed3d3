"""
Functions of arbitrary bytes, as from a peer or a file, which must read or refuse them.

A refusal is a ValueError. Any other exception is a finding, and so is an invalid frame. Messages
are given as CDR, as in a bag; a node gets them from ROS itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import json
from pathlib import Path
import tempfile
from typing import Any

import numpy as np

from vtrack_ros.bags import BagError, BagReader, messages
from vtrack_ros.bags.truth import read_truth
from vtrack_ros.evaluation.tracker_specification import parse_trackers
from vtrack_ros.geometry import Box
from vtrack_ros.geometry.camera import locate
from vtrack_ros.messages.camera_info import camera_from_info
from vtrack_ros.messages.images import compressed_to_frame, to_frame
from vtrack_ros.messages.selections import (
    best_detection, from_detection, from_point, from_roi)
from vtrack_ros.ros.parameter_node import checked_init_box, parameter_table
from vtrack_ros.session.saved_target import MARK, SavedTarget
from vtrack_ros.session.session import TrackingSession

#: What rosbags raises for a truncated message or an invalid text, as in the bag reader.
_NO_MESSAGE = (ValueError, IndexError, AssertionError, OverflowError, MemoryError, TypeError)

#: Folder of the temporary files, in memory if possible: thousands are written a second.
_MEMORY = '/dev/shm' if Path('/dev/shm').is_dir() else None
_GROUND = np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8)


@contextmanager
def _folder() -> Iterator[Path]:
    """Make a temporary folder until the block ends."""
    with tempfile.TemporaryDirectory(prefix='fuzzing-', dir=_MEMORY) as folder:
        yield Path(folder)


def _message(data: bytes, kind: str) -> Any:
    """Return the message that the CDR data contain; ValueError if they contain none."""
    try:
        return messages.typestore().deserialize_cdr(data, kind)
    except _NO_MESSAGE as error:
        raise ValueError('no message') from error
    except Exception as error:
        if type(error).__module__.startswith(('rosbags', 'struct')):
            raise ValueError('no message') from error
        raise


def _sound(frame: Any) -> None:
    assert frame.dtype == np.uint8 and frame.flags.c_contiguous
    assert frame.ndim == 2 or frame.shape[2:] == (3,), frame.shape
    assert 0 < frame.size


def image(data: bytes) -> None:
    """Read an Image."""
    message = _message(data, messages.IMAGE)
    frame = to_frame(message)
    _sound(frame)
    assert frame.shape[:2] == (message.height, message.width)


def compressed_image(data: bytes) -> None:
    """Read a CompressedImage, or its data alone."""
    _sound(compressed_to_frame(_message(data, messages.COMPRESSED_IMAGE)))


def camera_info(data: bytes) -> None:
    """Read a CameraInfo, and locate boxes with it."""
    camera = camera_from_info(_message(data, 'sensor_msgs/msg/CameraInfo'))
    for units, width in (('ray', 0.0), ('metres', 0.2)):
        for x in (-10.0, 300.0):
            place = locate(Box(x, 20, 20, 30), np.eye(4), camera, units, width)
            assert place is None or np.isfinite(place.point).all()
            assert place is None or np.isfinite(place.covariance).all()


def selection(data: bytes) -> None:
    """Read a selection, whose kind is the first byte, and apply it to a frame."""
    kind, data = data[:1], data[1:]
    found: Any
    if kind < b'\x40':
        found = from_detection(_message(data, 'vision_msgs/msg/Detection2D'), 'fuzz')
    elif kind < b'\x80':
        found = from_roi(_message(data, 'sensor_msgs/msg/RegionOfInterest'), 'fuzz')
    elif kind < b'\xc0':
        found = from_point(_message(data, 'geometry_msgs/msg/PointStamped'), 9.0, 'fuzz')
    else:
        array = _message(data, messages.DETECTIONS)
        if len(array.detections) > 99:
            return
        found = best_detection(array, '', 0.5, 'fuzz')
    if found is not None:
        box = found.box_on(_GROUND)
        assert 0 <= box.center[0] <= 80 and 0 <= box.center[1] <= 60, box
        assert min(box.width, box.height) >= 2


def saved_target(data: bytes) -> None:
    """Read a state file."""
    for text in (data.decode('utf-8'), f'{MARK}, {data.decode("utf-8")[1:]}'):
        try:
            target = SavedTarget.parsed(text)
        except ValueError:
            continue
        target.check(np.zeros((7, 9, 3), np.uint8), 10**9, 'camera', 10**9, 1e9)
        _sound(target.measurement().frame)
        _sound(target.exemplar().placed(target.box, target.shape))


_TABLE = parameter_table()
_NAMES = sorted(_TABLE)
_SESSION = TrackingSession('dcf', 0)


def parameters(data: bytes) -> None:
    """Set parameters to any JSON value, as ROS and a command line do."""
    try:
        value = json.loads(data[1:])
    except (RecursionError, ValueError):
        value = data[1:].decode('latin-1')
    row = _TABLE[_NAMES[(data[0] if data else 0) % len(_NAMES)]]
    for check in (row.checked, checked_init_box, lambda one: row.parsed(str(one)),
                  lambda one: parse_trackers(f'gmpf:{one}')):
        try:
            result = check(value)
        except (TypeError, ValueError):
            continue
        if check == row.checked:
            assert type(result) is row.kind
            owner, dot, name = row.name.partition('.')
            if dot:
                try:
                    _SESSION.change(parameters={owner: {name: value}})
                except ValueError:
                    # Valid alone, but not with the others.
                    pass


def truth(data: bytes) -> None:
    """Read a table of true boxes."""
    with _folder() as folder, suppress(BagError):
        path = folder / 'truth.csv'
        path.write_bytes(data)
        read_truth(path)


def _bag(data: bytes, ending: str) -> None:
    with _folder() as folder, suppress(BagError):
        path = folder / f'bag{ending}'
        path.write_bytes(data)
        with BagReader(path) as bag:
            for number, image in enumerate(bag.frames(malformed=[])):
                _sound(image.frame)
                if number > 9:
                    break


def bag_mcap(data: bytes) -> None:
    """Read a bag of MCAP."""
    _bag(data, '.mcap')


def bag_sqlite(data: bytes) -> None:
    """Read a bag of SQLite."""
    _bag(data, '.db3')


def bag_ros1(data: bytes) -> None:
    """Read a bag of ROS 1."""
    _bag(data, '.bag')


def bag_metadata(data: bytes) -> None:
    """Read the YAML beside a bag."""
    with _folder() as folder, suppress(BagError):
        (folder / 'metadata.yaml').write_bytes(data)
        (folder / 'bag.mcap').touch()
        with BagReader(folder) as bag:
            for _ in bag.frames():
                break


TARGETS: dict[str, Callable[[bytes], None]] = {one.__name__: one for one in (
    image, compressed_image, camera_info, selection, saved_target, parameters, truth, bag_mcap,
    bag_sqlite, bag_ros1, bag_metadata)}


def refused_or_right(name: str, data: bytes) -> None:
    """Give data to a target; any exception but a ValueError is a finding."""
    try:
        TARGETS[name](data)
    except ValueError:
        pass
