"""Bags: reading, writing, playing and replaying recorded image streams."""

from importlib.util import find_spec

if find_spec('rosbags') is None:
    raise ModuleNotFoundError(
        'reading and writing bags needs rosbags: pip install rosbags', name='rosbags')

from vtrack_ros.bags.errors import BagError, SequenceError  # noqa: E402
from vtrack_ros.bags.reader import BagReader, StampedFrame  # noqa: E402
from vtrack_ros.bags.writer import BagWriter  # noqa: E402

__all__ = ['BagError', 'BagReader', 'BagWriter', 'SequenceError', 'StampedFrame']
