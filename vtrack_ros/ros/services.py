"""The node's selection topics and services: what to track, and when."""

from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import RegionOfInterest
from std_srvs.srv import SetBool, Trigger

from vtrack_ros.messages.selections import best_detection, from_detection, from_point, from_roi
from vtrack_ros.ros.message_types import MessageTypes
from vtrack_ros.ros.parameter_node import ParameterNode
from vtrack_ros.ros.qos import Input
from vtrack_ros.session.selection import Selection
from vtrack_ros.session.target import Log, Target


class Services:
    """
    Subscribes to the selections, and offers the services.

    While `paused`, or not `active`, images aren't processed. `give_up` is called to forget the
    target; `changed` after each service request, which may have changed the target or `paused`.
    """

    def __init__(self, node: ParameterNode, types: MessageTypes, with_vision: bool, target: Target,
                 log: Log, give_up: Callable[[], None], changed: Callable[[], None]) -> None:
        self._node = node
        self._types = types
        self._with_vision = with_vision
        self._target = target
        self._log = log
        self._give_up = give_up
        self._changed = changed
        self.paused = self.active = False
        self._inputs = [Input(node, RegionOfInterest, '~/init_roi',
                              partial(self._select, from_roi, '~/init_roi')),
                        Input(node, PointStamped, '~/init_point',
                              partial(self._select, self._from_point, '~/init_point'))]
        if with_vision:
            self._inputs.append(Input(node, types['vision_msgs/msg/Detection2D'], '~/init',
                                      partial(self._select, from_detection, '~/init')))
        self._detector: Input | None = None
        self._services = [
            node.create_service(Trigger, '~/reset', self._on_reset),
            node.create_service(SetBool, '~/enable', self._on_enable),
            node.create_service(Trigger, '~/reinit', self._on_reinit),
            node.create_service(Trigger, '~/larger', partial(self._on_resize, True)),
            node.create_service(Trigger, '~/smaller', partial(self._on_resize, False))]

    @property
    def inputs(self) -> list[Input]:
        """Return the subscriptions."""
        return [*self._inputs, *filter(None, [self._detector])]

    def invitation(self) -> str:
        """Say how to select a target, or that `init_box` does so, or that there is one already."""
        if self._target.estimate is not None:
            return 'tracking of the target continues'
        if self._target.starts_on_init_box:
            return 'tracking starts on init_box in the first image'
        topics = ' or '.join(one.topic for one in self._inputs)
        name = self._node.get_fully_qualified_name()
        page = 'vtrack select' + ('' if name == '/tracker' else f' {name}')
        return (f'select the target while images arrive: in the browser ({page}), on {topics}, '
                'or with the parameter init_box')

    def listen_to_detector(self, on: bool) -> None:
        """Subscribe to ~/init_detections, or unsubscribe."""
        if on and self._detector is None and self._with_vision:
            topic = self._node.resolve_topic_name('~/init_detections')
            if topic == self._node.resolve_topic_name('detections'):
                # it would start on its own last box
                self._log.error(
                    f'init_from_detections: ~/init_detections is remapped to {topic}, on which '
                    "this node publishes its own boxes: no detection is used; give the detector's "
                    'boxes another topic, or remap detections')
                return
            self._detector = Input(
                self._node, self._types['vision_msgs/msg/Detection2DArray'],
                '~/init_detections', self._on_detections)
        elif not on and self._detector is not None:
            self._detector.destroy()
            self._detector = None

    def destroy(self) -> None:
        """Take everything down."""
        for one in self.inputs:
            one.destroy()
        for service in self._services:
            self._node.destroy_service(service)

    def _on_detections(self, message: Any) -> None:
        """Select the best detection of the wanted class while there's no target or it's lost."""
        settings = self._node.settings
        # What is found while no images are processed may have moved away by the next one.
        if self.active and not self.paused and self._target.wanted:
            self._select(lambda array, source: best_detection(
                array, settings.text('init_class'), settings.number('init_score'), source),
                '~/init_detections', message)

    def _from_point(self, message: Any, source: str) -> Selection:
        return from_point(message, self._node.settings.number('click_size'), source)

    def _select(self, read: Callable[[Any, str], Selection | None], source: str,
                message: Any) -> None:
        try:
            selection = read(message, source)
            if selection is not None:
                self._target.select(selection)
        except (TypeError, ValueError) as error:
            detector = source == '~/init_detections'
            tell = self._log.repeated_error if detector else self._log.error
            tell(f'{source} refused: {error}')

    def _on_reset(self, _: Any, response: Any) -> Any:
        self._give_up()
        self._changed()
        response.success, response.message = True, 'the target is forgotten; select a new one'
        return response

    def _on_enable(self, request: Any, response: Any) -> Any:
        self.paused = not request.data
        self._changed()
        response.success = True
        response.message = 'paused; the target is kept' if self.paused else 'tracking is enabled'
        return response

    def _on_reinit(self, _: Any, response: Any) -> Any:
        try:
            response.success = self._node.session.restart() is not None
        except ValueError as error:
            response.success, response.message = False, f'the target is kept as it was: {error}'
            return response
        self._changed()
        response.message = ('restarted on the last measured box' if response.success else
                            self._failed('there is no target to restart on; select one'))
        return response

    def _on_resize(self, larger: bool, _: Any, response: Any) -> Any:
        try:
            response.success = self._node.session.resize(larger) is not None
        except ValueError as error:
            response.success, response.message = False, f'the box is unchanged: {error}'
            return response
        seen = self._node.session.last_measurement
        self._changed()
        response.message = (
            f'restarted on a box of {seen.box.width:.0f} x {seen.box.height:.0f} px' if seen else
            self._failed('there is no target yet; select one'))
        return response

    def _failed(self, without: str) -> str:
        """Say why the tracker failed to restart, or, if there was no target, the given text."""
        failure = self._node.session.failure
        return f'it failed, and the target is forgotten: {failure}' if failure else without
