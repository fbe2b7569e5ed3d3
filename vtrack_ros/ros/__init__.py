"""What knows ROS messages: images, parameters, diagnostics."""
