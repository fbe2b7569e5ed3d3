"""The ways in which people and programs tell the node what to follow, and when."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import RegionOfInterest
from std_srvs.srv import SetBool, Trigger

from vtrack_ros.ros.target import Target


class Controls:
    """
    Subscribes to the selections, and offers the services.

    Parameters
    ----------
    node : rclpy.node.Node
    vision : module or None
        vision_msgs.msg, where it's installed.
    target : Target
    changed : callable
        Called after the target or the pause changed.

    Attributes
    ----------
    paused : bool
        Whether no image is to be looked at.

    """

    def __init__(self, node: Node, vision: Any, target: Target,
                 changed: Callable[[], None]) -> None:
        self._node = node
        self._vision = vision
        self._target = target
        self._changed = changed
        self.paused = False
        self._detector: Any = None
        self._subscriptions = [
            node.create_subscription(RegionOfInterest, '~/init_roi', target.on_roi, 1)]
        if vision is not None:
            self._subscriptions.append(node.create_subscription(
                vision.Detection2D, '~/init', target.on_detection, 1))
        self._services = [
            node.create_service(Trigger, '~/reset', self._on_reset),
            node.create_service(SetBool, '~/enable', self._on_enable),
            node.create_service(Trigger, '~/reinit', self._on_reinit)]

    def invitation(self, has_box: bool) -> str:
        """Say how the target is pointed out, or that `init_box` does."""
        if has_box:
            return 'the target is init_box, on the first of them'
        topics = [one.topic_name for one in self._subscriptions]
        return (f'point out the target on {" or ".join(topics)} while they come, or with the '
                'parameter init_box')

    def listen_to_detector(self, on: bool) -> None:
        """Subscribe to ~/init_detections, or unsubscribe."""
        if on and self._detector is None and self._vision is not None:
            self._detector = self._node.create_subscription(
                self._vision.Detection2DArray, '~/init_detections',
                self._target.on_detections, 1)
        elif not on and self._detector is not None:
            self._node.destroy_subscription(self._detector)
            self._detector = None

    def destroy(self) -> None:
        """Take everything down."""
        self.listen_to_detector(False)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        for service in self._services:
            self._node.destroy_service(service)

    def _on_reset(self, _: Any, response: Any) -> Any:
        self._target.forget()
        self._changed()
        response.success, response.message = True, 'the target is forgotten; select a new one'
        return response

    def _on_enable(self, request: Any, response: Any) -> Any:
        self.paused = not request.data
        self._changed()
        response.success = True
        response.message = 'paused; the target is kept' if self.paused else 'tracking is on'
        return response

    def _on_reinit(self, _: Any, response: Any) -> Any:
        response.success = self._target.restart() is not None
        self._changed()
        response.message = ('started again on the last good box' if response.success else
                            'there is no target to start again on; select one')
        return response
