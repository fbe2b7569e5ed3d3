"""Tracking one target through stamped frames, independent of ROS."""
