"""Single-object visual tracking for ROS 2: trackers, filters, bags and a node."""

__version__ = '0.1.0'
