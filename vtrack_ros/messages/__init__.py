"""Arrays as messages and back, whoever defines the message types: ROS or rosbags."""
