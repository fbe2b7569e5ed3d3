"""Following one target through stamped frames; no ROS."""
