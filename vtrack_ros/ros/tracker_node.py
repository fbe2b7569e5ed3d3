"""The plain node."""

from __future__ import annotations

from typing import Any

from vtrack_ros.ros.parameter_node import ParameterNode
from vtrack_ros.ros.pipeline import Pipeline


class TrackerNode(ParameterNode):
    """
    Tracks a target in the images that it receives; docs/node.md describes its face.

    Parameters
    ----------
    **arguments
        Those of rclpy.node.Node.

    Raises
    ------
    TypeError, ValueError, rclpy.exceptions.ParameterException
        If a parameter is wrong from the start.

    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__('tracker', **arguments)
        self._pipeline = Pipeline(self)
        self._pipeline.activate()
