"""Single-object visual tracking for ROS 2: trackers, filters, bags and a node."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version('vtrack_ros')
except PackageNotFoundError:
    # The sources are used as they are, without being installed.
    __version__ = 'unknown'
