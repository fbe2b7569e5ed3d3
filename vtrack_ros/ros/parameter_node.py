"""A node's parameters: declared from the tables, checked with clear errors, and applied."""

from collections.abc import Callable, Collection
from dataclasses import replace
import sys
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult)
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from vtrack_ros.geometry import Box
from vtrack_ros.geometry.camera import UNITS
from vtrack_ros.parameters import Parameter, ParameterTable, Value
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import tracker_class, tracker_names

#: The only parameter that isn't a scalar, and so isn't in the table.
INIT_BOX = 'init_box'
INIT_BOX_DESCRIPTION = (
    'Box of the target in the first image of every stream, and in the next image after a change: '
    '[x, y, width, height] in pixels, x and y of its upper left corner. Empty: wait for a '
    'selection.')
#: The warning about `qos_overrides` parameters, which this node doesn't apply.
_QUALITY = ('each subscription adopts the reliability of its publisher and keeps only the newest '
            "message; for images use the parameter 'reliability'")

#: The node's own parameters. Those of each tracker are added, with its name as their prefix.
NODE_PARAMETERS = ParameterTable([
    Parameter('tracker', 'gmpf', 'Name of the tracker; a new tracker continues with the target.',
              choices=tracker_names()),
    Parameter('seed', 0, 'Seed of the random number generator; the same images and seed give the '
              'same output. A change takes effect with the next target, ~/reinit or change of '
              'tracker.', 0, 2**31 - 1),
    Parameter('image_transport', 'raw', 'Subscribe to raw images on image, or to compressed '
              'images on image/compressed.', choices=('raw', 'compressed'), dynamic=False),
    Parameter('reliability', 'auto', 'Reliability (QoS) of the image subscription; auto adopts '
              'that of the publisher.', choices=('auto', 'reliable', 'best_effort'),
              dynamic=False),
    Parameter('history_seconds', 3.0, 'How long images are kept, so that a selection with an '
              'older stamp is applied to the image that it was made on. A larger value accepts '
              'older selections.', 0.0, 30.0, 's'),
    Parameter('history_megabytes', 256.0, 'Maximum memory for the images that are kept for '
              'selections; beyond it the oldest are dropped.', 0.0, 1024.0, 'MB'),
    Parameter('init_from_detections', False, 'Start on the detection with the highest score on '
              '~/init_detections while there is no target, or the target is lost.'),
    Parameter('init_class', '', 'Class of the detections that init_from_detections uses; empty: '
              'any class.'),
    Parameter('init_score', 0.5, 'Minimum score of a detection that init_from_detections uses.',
              0.0, 1.0),
    Parameter('click_size', 0.0, 'Side of the square box around a point from ~/init_point; 0: '
              'the box is estimated from the image around the point.', 0.0, 10000.0, 'px'),
    Parameter('pose_units', 'auto', 'Units of pose and twist. pixels: position in the image; ray: '
              'point at depth 1 on the line of sight, needs camera_info; metres: needs '
              'camera_info and target_width or target_height; auto: metres if possible, else '
              'ray, else pixels.', choices=UNITS),
    Parameter('target_width', 0.0, 'Real width of the target, from which its distance is '
              'computed; 0: unknown.', 0.0, 1000.0, 'm'),
    Parameter('target_height', 0.0, 'Real height of the target, used if target_width is 0; 0: '
              'unknown.', 0.0, 1000.0, 'm'),
    Parameter('target_frame', '', "Child frame of the transform from the image's frame to the "
              'target, which is sent on /tf while the pose is in metres; empty: no transform.'),
    Parameter('predict_to_now', False, 'Predict pose, twist and transform from the stamp of the '
              'image to the current time, by at most 0.5 s, and stamp them with it. Their '
              'covariance grows with the time predicted.'),
    Parameter('state_file', '', 'File in which the target is saved every second, so that a '
              'restarted node continues with it; empty: the target is not saved.',
              dynamic=False),
    Parameter('state_seconds', 30.0, 'Maximum age of the target in state_file when the first '
              'image arrives; an older one is not restored.', 0.0, 86400.0, 's'),
])


def parameter_table() -> dict[str, Parameter]:
    """Return every scalar parameter by its full name: the node's, then the trackers'."""
    rows = dict(NODE_PARAMETERS)
    for tracker in tracker_names():
        for name, row in tracker_class(tracker).PARAMETERS.items():
            full = f'{tracker}.{name}'
            rows[full] = replace(row, name=full)
    return rows


class NodeSettings(dict[str, Value]):
    """The current values of the node's own parameters."""

    def text(self, name: str) -> str:
        """Return a value that is text."""
        return str(self[name])

    def number(self, name: str) -> float:
        """Return a value that is a number."""
        return float(self[name])


def checked_init_box(value: Any) -> Box | None:
    """
    Return the value of the parameter `init_box` as a box; None for an empty one.

    TypeError or ValueError if it isn't four finite numbers with a positive size.
    """
    valid = 'valid is [x, y, width, height] in pixels, or [] to wait for a selection'
    if isinstance(value, (str, bytes)) or not hasattr(value, '__len__'):
        raise TypeError(f'{INIT_BOX} is {value!r}; {valid}')
    if len(value) == 0:
        return None
    if len(value) != 4:
        raise ValueError(f'{INIT_BOX} has {len(value)} values; {valid}')
    if any(isinstance(number, (bool, str, bytes)) for number in value):
        raise TypeError(f'{INIT_BOX} is {list(value)!r}; {valid}')
    try:
        return Box(*value)
    except ValueError as error:
        raise ValueError(f'{INIT_BOX}: {error}; {valid}') from None


def descriptor(row: Parameter) -> ParameterDescriptor:
    """Return what `ros2 param describe` tells about a parameter."""
    text = row.description
    if row.unit:
        text += f' Unit: {row.unit}.'
    if row.choices:
        text += ' One of: ' + ', '.join(map(str, row.choices)) + '.'
    result = ParameterDescriptor(
        name=row.name, description=text, read_only=not row.dynamic,
        additional_constraints='valid: ' + row.valid)
    if row.low is None and row.high is None:
        return result
    if row.kind is int:
        result.integer_range = [IntegerRange(
            from_value=-2**63 if row.low is None else int(row.low),
            to_value=2**63 - 1 if row.high is None else int(row.high))]
    elif row.kind is float:
        result.floating_point_range = [FloatingPointRange(
            from_value=-sys.float_info.max if row.low is None else float(row.low),
            to_value=sys.float_info.max if row.high is None else float(row.high))]
    return result


class ParameterNode(Node):
    """
    A node whose parameters are declared from the tables, with the tracking session they configure.

    rclpy's own errors leave out the name of an unknown parameter, and the range of one of the
    wrong type: here errors name them, and what the session refuses.

    `settings` and `init_box` are the current values, `session` has the trackers' parameters;
    `on_change` is called with the names of changed parameters after the change was applied.

    TypeError, ValueError or rclpy's ParameterException if a value given at the start is wrong.
    """

    def __init__(self, name: str, **arguments: Any) -> None:
        super().__init__(name, **arguments)
        self.on_change: Callable[[Collection[str]], None] | None = None
        self._table = parameter_table()
        for full, row in self._table.items():
            try:
                self.declare_parameter(full, row.default, descriptor(row))
            except InvalidParameterTypeException:
                raise _wrong_type(row, self._parameter_overrides[full].value) from None
        # A list from YAML or a command line may hold integers or floats, or be empty: all are
        # valid, but static typing would accept only one of them.
        self.declare_parameter(INIT_BOX, [], ParameterDescriptor(
            name=INIT_BOX, description=INIT_BOX_DESCRIPTION, dynamic_typing=True,
            additional_constraints='valid: 4 finite numbers, width and height positive; or []'))
        if self.get_parameter(INIT_BOX).value is None:
            # ROS gives None for [], whose element type it can't infer.
            super().set_parameters([RosParameter(INIT_BOX, value=[])])
        # rclpy ignores unknown parameters, and a typo would go unnoticed. They may be meant for
        # other nodes of the same file, so this is only a warning.
        for full in sorted(self._parameter_overrides):
            if self.has_parameter(full) or full.startswith('qos_overrides./clock.'):
                continue
            quality = full.startswith('qos_overrides.')
            valid = _QUALITY if quality else f'valid are {self._neighbours(full)}'
            Node.get_logger(self).warning(f'unknown parameter {full!r} ignored; {valid}')
        values = {full: self.get_parameter(full).value for full in self._table}
        own, trackers = _by_owner(values)
        self.settings = NodeSettings(NODE_PARAMETERS.checked(own))
        self.init_box = checked_init_box(self.get_parameter(INIT_BOX).value)
        self.session = TrackingSession(
            self.settings.text('tracker'), int(self.settings.number('seed')), trackers)
        # A change of the session can't be undone: so rclpy makes its own checks before it.
        self.add_on_set_parameters_callback(self._change_session)

    def set_parameters(self, parameter_list: list[RosParameter]) -> list[SetParametersResult]:
        """Set parameters one by one."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set all of the parameters, or none."""
        try:
            for parameter in parameter_list:
                self._check_before_ros(parameter.name, parameter.value)
        except (TypeError, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            values = {parameter.name: parameter.value for parameter in parameter_list}
            self.settings.update(_by_owner(values)[0])
            if INIT_BOX in values:
                self.init_box = checked_init_box(values[INIT_BOX])
            if self.on_change is not None:
                self.on_change(values)
        return result

    def _check_before_ros(self, name: str, value: Any) -> None:
        """Raise an error at what rclpy would refuse less clearly, or not at all."""
        row = self._table.get(name)
        if name == INIT_BOX:
            checked_init_box(value)
        elif row is None:
            if not self.has_parameter(name):
                raise ValueError(f'unknown parameter {name!r}; valid are {self._neighbours(name)}')
        elif not row.dynamic:
            raise ValueError(f'{name} is read-only: it is fixed when the node starts')
        elif type(value) is not row.kind:
            raise _wrong_type(row, value)
        else:
            row.checked(value)

    def _change_session(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Change the session, if it takes the values; rclpy has found nothing wrong with them."""
        own, trackers = _by_owner({one.name: one.value for one in parameter_list})
        try:
            self.session.change(own.get('tracker'), own.get('seed'), trackers)
        except (TypeError, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _neighbours(self, name: str) -> str:
        """List valid names in place of a wrong one: those with its prefix, else the node's."""
        prefix = name.split('.', 1)[0] + '.'
        own = [full for full in self._table if full.startswith(prefix)]
        return ', '.join(own or [*NODE_PARAMETERS, INIT_BOX, *(
            f'{tracker}.*' for tracker in tracker_names())])


def _wrong_type(row: Parameter, value: Any) -> TypeError:
    form = ''
    if row.kind is float and type(value) is int:
        form = f', with a decimal point: {float(value)}'
    elif row.kind is str and not row.choices and type(value) in (int, float):
        # quotes for YAML, within those that a shell removes
        form = f', in quotes: "\'{value}\'"'
    return TypeError(f'{row.name} must be {row.valid}{form}, not {value!r}')


def _by_owner(values: dict[str, Any]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Split values into the node's own parameters and, by tracker name, the trackers'."""
    own = {name: value for name, value in values.items() if name in NODE_PARAMETERS}
    trackers: dict[str, dict[str, Any]] = {}
    for full, value in values.items():
        tracker, dot, name = full.partition('.')
        if dot and tracker in tracker_names():
            trackers.setdefault(tracker, {})[name] = value
    return own, trackers
