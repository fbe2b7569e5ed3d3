"""
The baseline of latency: a node that publishes a pose for each image, and does nothing else.

`benchmarks/latency.py` runs it beside the tracker's node.
"""

from __future__ import annotations

from geometry_msgs.msg import PoseStamped
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image


def main() -> None:
    """Run the node until Ctrl-C or a shutdown."""
    rclpy.init(args=[])
    node = Node('null')
    publisher = node.create_publisher(PoseStamped, '/null/pose', QoSProfile(depth=10))
    subscription = node.create_subscription(
        Image, '/null/image', lambda message: publisher.publish(
            PoseStamped(header=message.header)), QoSProfile(depth=1))
    # Without a timer, `spin` may not notice a shutdown.
    node.create_timer(1.0, lambda: None)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        node.destroy_subscription(subscription)
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
