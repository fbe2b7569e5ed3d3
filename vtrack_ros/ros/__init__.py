"""The ROS 2 node; nothing outside this package imports rclpy, but the bag player."""
