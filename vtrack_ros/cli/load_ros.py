"""ROS where a command needs it, loaded when it does."""

import os
from typing import Any

from vtrack_ros.dds import with_profile


def load_rclpy(doing: str) -> Any:
    """
    Return the module rclpy, with the profile that lets images through.

    ModuleNotFoundError where there's none; `doing` is what needs it.
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
