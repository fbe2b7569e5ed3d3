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
from vtrack_ros.parameters import Parameter, ParameterTable, Value
from vtrack_ros.session.session import TrackingSession
from vtrack_ros.trackers import tracker_class, tracker_names

#: The only parameter that isn't a scalar, and so isn't in the table.
INIT_BOX = 'init_box'
INIT_BOX_DESCRIPTION = (
    'The target on the first frame of the stream: x, y, width, height in pixels of the image. '
    'Empty: wait for a selection.')
#: The warning about `qos_overrides` parameters, which this node doesn't apply.
_QUALITY = ('inputs take what their publisher offers, and the newest message alone; the images '
            "have the parameter 'reliability'")

#: The node's own parameters. Those of each tracker are added, with its name as their prefix.
NODE_PARAMETERS = ParameterTable([
    Parameter('tracker', 'gmpf', 'The tracker; changing it keeps the target.',
              choices=tracker_names()),
    Parameter('seed', 0, 'Seed of the random numbers, used from the next start on; the same '
              'images and seed give the same output.', 0, 2**31 - 1),
    Parameter('image_transport', 'raw', 'How images arrive: raw on image, or compressed on '
              'image/compressed.', choices=('raw', 'compressed'), dynamic=False),
    Parameter('reliability', 'auto', 'Reliability of the image subscription; auto takes what the '
              'publisher offers.', choices=('auto', 'reliable', 'best_effort'), dynamic=False),
    Parameter('history_seconds', 2.0, 'How far back a stamped selection may reach.', 0.0, 30.0,
              's'),
    Parameter('history_megabytes', 16.0, 'How much memory the frames kept for selections may '
              'take.', 0.0, 1024.0, 'MB'),
    Parameter('init_from_detections', False, 'Take the best detection of ~/init_detections as '
              'target when there is none, or when it is lost.'),
    Parameter('init_class', '', 'The class of detections to start on; empty: any.'),
    Parameter('init_score', 0.5, 'The least score of a detection to start on.', 0.0, 1.0),
    Parameter('click_size', 0.0, 'Side of the square that a point on ~/init_point stands for; '
              "0: the target's extent is found about it.", 0.0, 10000.0, 'px'),
    Parameter('pose_units', 'auto', 'Units of the pose; auto: metres when a size of the target '
              'and camera_info are known, a ray at depth 1 with camera_info alone, else pixels.',
              choices=('auto', 'pixels', 'ray', 'metres')),
    Parameter('target_width', 0.0, "The target's real width; 0: unknown.", 0.0, 1000.0, 'm'),
    Parameter('target_height', 0.0, "The target's real height, used when the width is unknown; "
              '0: unknown.', 0.0, 1000.0, 'm'),
    Parameter('target_frame', '', 'Child frame of a transform to the target, sent on /tf while '
              'the pose is in metres; empty: none.'),
    Parameter('predict_to_now', False, 'Publish pose, twist and transform not as they were in the '
              'image but as they are expected to be now, stamped so; their covariance grows.'),
    Parameter('state_file', '', 'File in which the target is saved, so that the node goes on with '
              'it after it was killed; empty: none.', dynamic=False),
    Parameter('state_seconds', 30.0, 'How old a target of state_file may be when images come.',
              0.0, 86400.0, 's'),
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
            additional_constraints='valid: 4 finite numbers, width and height positive; or none'))
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
        self.settings = NodeSettings(own)
        self.init_box = checked_init_box(self.get_parameter(INIT_BOX).value)
        self.session = TrackingSession(
            self.settings.text('tracker'), int(self.settings.number('seed')), trackers)

    def set_parameters(self, parameter_list: list[RosParameter]) -> list[SetParametersResult]:
        """Set parameters one by one."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(
            self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set all of the parameters, or none."""
        values = {parameter.name: parameter.value for parameter in parameter_list}
        try:
            self._check_as_ros_does(values)
            own, trackers = _by_owner(values)
            own = NODE_PARAMETERS.checked(own)
            box = checked_init_box(values[INIT_BOX]) if INIT_BOX in values else self.init_box
            tracker, seed = own.get('tracker'), own.get('seed')
            self.session.change(None if tracker is None else str(tracker),
                                None if seed is None else int(seed), trackers)
        except (TypeError, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            self.settings.update(own)
            self.init_box = box
            if self.on_change is not None:
                self.on_change(values)
        return result

    def _check_as_ros_does(self, values: dict[str, Any]) -> None:
        """Raise an error at what rclpy would refuse less clearly, or not at all."""
        for name, value in values.items():
            row = self._table.get(name)
            if row is None:
                if not self.has_parameter(name):
                    raise ValueError(
                        f'unknown parameter {name!r}; valid are {self._neighbours(name)}')
            elif not row.dynamic:
                raise ValueError(f'{name} is read-only: it is fixed when the node starts')
            elif row.kind is float and type(value) is int:
                raise _wrong_type(row, value)

    def _neighbours(self, name: str) -> str:
        """List valid names in place of a wrong one: those with its prefix, else the node's."""
        prefix = name.split('.', 1)[0] + '.'
        own = [full for full in self._table if full.startswith(prefix)]
        return ', '.join(own or [*NODE_PARAMETERS, INIT_BOX, *(
            f'{tracker}.*' for tracker in tracker_names())])


def _wrong_type(row: Parameter, value: Any) -> TypeError:
    point = row.kind is float and type(value) is int
    form = f', with a decimal point: {float(value)}' if point else ''
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
