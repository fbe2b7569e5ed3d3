"""Loading of ROS, only in the commands that need it."""

import os
from typing import Any

from vtrack_ros.dds import with_profile


def load_rclpy(doing: str) -> Any:
    """
    Return the module rclpy, after setting the middleware profile that large images need.

    ModuleNotFoundError if it isn't installed; its message names `doing` as what needs rclpy.
    """
    try:
        # Without the profile's shared memory a best-effort subscriber misses large images.
        os.environ.update(with_profile(os.environ))
    except FileNotFoundError:
        pass
    try:
        import rclpy
        import rclpy.context
    except ImportError as error:
        raise ModuleNotFoundError(
            f'{doing} needs rclpy: source a ROS 2 installation, or run scripts/setup '
            f'({error})') from None
    return rclpy
