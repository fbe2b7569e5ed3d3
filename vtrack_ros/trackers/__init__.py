"""
The trackers, behind one interface.

>>> from vtrack_ros.trackers import Box, create_tracker
>>> tracker = create_tracker('gmpf', seed=0, particles=150)
>>> tracker.start(frame, Box(x, y, width, height))
>>> estimate = tracker.update(next_frame)

"""

from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.tracker import Estimate, Tracker, TrackState
from vtrack_ros.trackers.registry import (
    available_peers, create_tracker, tracker_class, tracker_names)

__all__ = [
    'Box', 'Estimate', 'Frame', 'Tracker', 'TrackState',
    'available_peers', 'create_tracker', 'tracker_class', 'tracker_names',
]
