"""The ways in which people and programs tell the node what to follow, and when."""

from __future__ import annotations

from typing import Any, Protocol

from rclpy.node import Node
from sensor_msgs.msg import RegionOfInterest
from std_srvs.srv import SetBool, Trigger

from vtrack_ros.ros.selection import from_detection, from_roi, Selection


class Controlled(Protocol):
    """What is controlled."""

    def select(self, selection: Selection) -> None:
        """Take a target."""

    def refuse(self, source: str, error: Exception) -> None:
        """Say that a selection was wrong."""

    def detected(self, message: Any) -> None:
        """Take what a detector found."""

    def reset(self) -> str:
        """Forget the target; return what was done."""

    def enable(self, on: bool) -> str:
        """Go on, or pause; return what was done."""

    def reinit(self) -> str | None:
        """Start again on the last good box; return what was done, None if there's no target."""


class Controls:
    """
    Subscribes to the selections, and offers the services.

    Parameters
    ----------
    node : rclpy.node.Node
    vision : module or None
        vision_msgs.msg, where it's installed.
    controlled : Controlled

    """

    def __init__(self, node: Node, vision: Any, controlled: Controlled) -> None:
        self._node = node
        self._vision = vision
        self._controlled = controlled
        self._detector: Any = None
        self._subscriptions = [
            node.create_subscription(RegionOfInterest, '~/init_roi', self._on_roi, 1)]
        if vision is not None:
            self._subscriptions.append(node.create_subscription(
                vision.Detection2D, '~/init', self._on_detection, 1))
        self._services = [
            node.create_service(Trigger, '~/reset', self._on_reset),
            node.create_service(SetBool, '~/enable', self._on_enable),
            node.create_service(Trigger, '~/reinit', self._on_reinit)]

    def listen_to_detector(self, on: bool) -> None:
        """Subscribe to ~/init_detections, or unsubscribe."""
        if on and self._detector is None and self._vision is not None:
            self._detector = self._node.create_subscription(
                self._vision.Detection2DArray, '~/init_detections',
                self._controlled.detected, 1)
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

    def _on_detection(self, message: Any) -> None:
        try:
            self._controlled.select(from_detection(message, '~/init'))
        except (TypeError, ValueError) as error:
            self._controlled.refuse('~/init', error)

    def _on_roi(self, message: RegionOfInterest) -> None:
        try:
            self._controlled.select(from_roi(message, '~/init_roi'))
        except (TypeError, ValueError) as error:
            self._controlled.refuse('~/init_roi', error)

    def _on_reset(self, _: Any, response: Any) -> Any:
        response.success, response.message = True, self._controlled.reset()
        return response

    def _on_enable(self, request: Any, response: Any) -> Any:
        response.success, response.message = True, self._controlled.enable(bool(request.data))
        return response

    def _on_reinit(self, _: Any, response: Any) -> Any:
        done = self._controlled.reinit()
        response.success = done is not None
        response.message = done or 'there is no target to start again on; select one'
        return response
