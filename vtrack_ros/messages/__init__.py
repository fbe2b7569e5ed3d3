"""Conversion between arrays and messages, for message types of rclpy and of rosbags."""
