"""The node's parameters: declared, checked and read from the one table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
import sys
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from vtrack_ros.geometry import Box
from vtrack_ros.parameters import Parameter, ParameterTable, Value
from vtrack_ros.trackers import create_tracker, tracker_class, tracker_names

#: The name of the only parameter that isn't a scalar, and so isn't in the table.
INIT_BOX = 'init_box'
INIT_BOX_DESCRIPTION = (
    'The target on the first frame of the stream: x, y, width, height in pixels of the image. '
    'Empty: wait for a selection.')

#: The node's own parameters; every tracker's own ones come beside them, behind its name.
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
    Parameter('pose_units', 'auto', 'Units of the pose; auto: metres when a size of the target '
              'and camera_info are known, a ray at depth 1 with camera_info alone, else pixels.',
              choices=('auto', 'pixels', 'ray', 'metres')),
    Parameter('target_width', 0.0, "The target's real width; 0: unknown.", 0.0, 1000.0, 'm'),
    Parameter('target_height', 0.0, "The target's real height, used when the width is unknown; "
              '0: unknown.', 0.0, 1000.0, 'm'),
    Parameter('target_frame', '', 'Child frame of a transform to the target, sent on /tf while '
              'the pose is in metres; empty: none.'),
])


def parameter_table() -> dict[str, Parameter]:
    """Return every scalar parameter of the node by its full name, trackers' own ones last."""
    rows = dict(NODE_PARAMETERS)
    for tracker in tracker_names():
        for name, row in tracker_class(tracker).PARAMETERS.items():
            full = f'{tracker}.{name}'
            rows[full] = replace(row, name=full)
    return rows


@dataclass(frozen=True)
class Settings:
    """
    The values in force.

    Parameters
    ----------
    node : dict of str to value
        The values of `NODE_PARAMETERS`.
    trackers : dict of str to dict
        Tracker name -> its parameters' values.
    init_box : Box or None
        The target on the first frame.

    """

    node: dict[str, Value] = field(default_factory=dict)
    trackers: dict[str, dict[str, Value]] = field(default_factory=dict)
    init_box: Box | None = None

    def text(self, name: str) -> str:
        """Return a value of the node that is text."""
        return str(self.node[name])

    def number(self, name: str) -> float:
        """Return a value of the node that is a number."""
        return float(self.node[name])

    def merged(self, changes: Settings, names: Sequence[str]) -> Settings:
        """Return these settings with `changes`, whose full names are given, taken over."""
        trackers = {name: dict(values) for name, values in self.trackers.items()}
        for name, values in changes.trackers.items():
            trackers.setdefault(name, {}).update(values)
        box = changes.init_box if INIT_BOX in names else self.init_box
        return Settings({**self.node, **changes.node}, trackers, box)


def checked_settings(values: Mapping[str, Any]) -> Settings:
    """
    Sort and check values by full name.

    Raises
    ------
    TypeError, ValueError
        If one is wrong: its name, its value and what's valid.

    """
    table = parameter_table()
    node: dict[str, Value] = {}
    trackers: dict[str, dict[str, Value]] = {}
    box = None
    for full, value in values.items():
        if full == INIT_BOX:
            box = init_box(value)
        elif full in NODE_PARAMETERS:
            node[full] = table[full].checked(value)
        elif full in table:
            tracker, name = full.split('.', 1)
            trackers.setdefault(tracker, {})[name] = table[full].checked(value)
    return Settings(node, trackers, box)


def init_box(value: Any) -> Box | None:
    """
    Return the box that the parameter `init_box` spells; None for an empty one.

    Raises
    ------
    TypeError, ValueError
        If it isn't four finite numbers with a positive size.

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
        low = -2**63 if row.low is None else int(row.low)
        high = 2**63 - 1 if row.high is None else int(row.high)
        result.integer_range = [IntegerRange(from_value=low, to_value=high, step=0)]
    elif row.kind is float:
        largest = sys.float_info.max
        low_value = -largest if row.low is None else float(row.low)
        high_value = largest if row.high is None else float(row.high)
        result.floating_point_range = [
            FloatingPointRange(from_value=low_value, to_value=high_value, step=0.0)]
    return result


class TellingNode(Node):
    """
    A node that says what is valid when it refuses a parameter.

    rclpy's own answers leave out the name of an unknown parameter, and the range of one that is of
    the wrong type.

    """

    def set_parameters_atomically(
            self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set all of the parameters, or none."""
        table = parameter_table()
        try:
            for parameter in parameter_list:
                name, value = parameter.name, parameter.value
                if name in table:
                    _check_as_ros_does(table[name], value)
                elif not self.has_parameter(name):
                    raise ValueError(f'unknown parameter {name!r}; valid are {_neighbours(name)}')
        except (TypeError, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return super().set_parameters_atomically(parameter_list)


def _check_as_ros_does(row: Parameter, value: Any) -> None:
    row.checked(value)
    if row.kind is float and isinstance(value, int):
        raise TypeError(f'{row.name} must be {row.valid}, with a decimal point: {float(value)}, '
                        f'not {value}')


def _neighbours(name: str) -> str:
    """Return the valid names beside a wrong one: a tracker's own, or the node's."""
    prefix = name.split('.', 1)[0] + '.'
    table = parameter_table()
    own = [full for full in table if full.startswith(prefix)]
    return ', '.join(own or [*NODE_PARAMETERS, INIT_BOX, *(
        f'{tracker}.*' for tracker in tracker_names())])


class ParameterServer:
    """
    Declares the parameters of a node, and refuses wrong changes before any is made.

    Parameters
    ----------
    node : rclpy.node.Node

    Raises
    ------
    TypeError, ValueError
        If a value from the command line or a file is wrong.
    rclpy.exceptions.ParameterException
        The same, where rclpy's own check finds it first.

    Attributes
    ----------
    settings : Settings
        The values in force.
    listener : callable or None
        Called with the changes alone and their full names, once they are in force.

    """

    def __init__(self, node: Node) -> None:
        for name, row in parameter_table().items():
            node.declare_parameter(name, row.default, descriptor(row))
        # A list that YAML or a command line spells may be of integers, of floats or empty: all
        # are right, and static typing would take but one of them.
        node.declare_parameter(INIT_BOX, [], ParameterDescriptor(
            name=INIT_BOX, description=INIT_BOX_DESCRIPTION, dynamic_typing=True,
            additional_constraints='valid: 4 finite numbers, width and height positive; or none'))
        if node.get_parameter(INIT_BOX).value is None:
            # What [] is for ROS, which can't tell what there is none of.
            node.set_parameters([RosParameter(INIT_BOX, value=[])])
        # rclpy takes no notice of these, and a slip of the pen would go unseen. They may be meant
        # for other nodes of the same file, so that they are no reason to stop.
        for name in sorted(node._parameter_overrides):
            if not node.has_parameter(name) and not name.startswith('qos_overrides.'):
                node.get_logger().warning(
                    f'unknown parameter {name!r} ignored; valid are {_neighbours(name)}')
        names = [*parameter_table(), INIT_BOX]
        self.settings = checked_settings(
            {name: node.get_parameter(name).value for name in names})
        for tracker, values in self.settings.trackers.items():
            create_tracker(tracker, seed=0, **values)
        self.listener: Callable[[Settings, Sequence[str]], None] | None = None
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._take)

    def _take(self, parameters: Sequence[RosParameter]) -> None:
        """Put validated changes in force."""
        names = [parameter.name for parameter in parameters]
        changes = checked_settings({parameter.name: parameter.value for parameter in parameters})
        self.settings = self.settings.merged(changes, names)
        if self.listener is not None:
            self.listener(changes, names)

    def _validate(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        names = [parameter.name for parameter in parameters]
        try:
            changes = checked_settings(
                {parameter.name: parameter.value for parameter in parameters})
            merged = self.settings.merged(changes, names)
            for tracker in changes.trackers:
                create_tracker(tracker, seed=0, **merged.trackers[tracker])
        except (TypeError, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)
