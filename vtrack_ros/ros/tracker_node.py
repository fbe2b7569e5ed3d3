"""The plain node."""

from typing import Any

from vtrack_ros.ros.parameter_node import ParameterNode
from vtrack_ros.ros.pipeline import Pipeline


class TrackerNode(ParameterNode):
    """
    Tracks a target in the images that it receives; docs/node.md describes its interface.

    The arguments are those of rclpy's node, the errors those of ParameterNode.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__('tracker', **arguments)
        self._pipeline = Pipeline(self)
        self._pipeline.activate()

    def destroy_node(self) -> None:
        """Save the target, and take the node down."""
        self._pipeline.save()
        super().destroy_node()  # type: ignore[no-untyped-call]
