"""The message classes of rclpy, by their full names."""

from importlib import import_module
from typing import Any

from rclpy.node import Node


class MessageTypes(dict[str, Any]):
    """Full name, such as ``sensor_msgs/msg/Image`` -> class, imported on first use."""

    def __missing__(self, name: str) -> Any:
        """Import a class; ImportError where its package isn't installed."""
        package, _, kind = name.split('/')
        self[name] = getattr(import_module(f'{package}.msg'), kind)
        return self[name]


def installed(package: str, lost: str, node: Node) -> bool:
    """Return whether an optional message package is installed; if not, warn what is `lost`."""
    try:
        import_module(f'{package}.msg')
    except ImportError:
        dashed = package.replace('_', '-')
        built = ', or run scripts/setup' if package == 'vision_msgs' else ''
        node.get_logger().warning(
            f'{package} is not installed: {lost}. Install ros-jazzy-{dashed} (apt){built}')
        return False
    return True
