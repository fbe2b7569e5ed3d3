"""The ROS 2 node; of the rest only `bags.player`, `selecting`, `cli` and `demo` import rclpy."""
