"""A node's parameters as inputs of a page, made from their descriptors."""

from collections.abc import Sequence
import sys
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType, ParameterValue
from rclpy.parameter import parameter_value_to_python

_CHOICES = 'valid: one of '
_KINDS = {ParameterType.PARAMETER_BOOL: 'bool', ParameterType.PARAMETER_INTEGER: 'int',
          ParameterType.PARAMETER_DOUBLE: 'float', ParameterType.PARAMETER_STRING: 'text'}


def parameter_inputs(descriptors: Sequence[ParameterDescriptor],
                     values: Sequence[ParameterValue]) -> list[dict[str, Any]]:
    """
    Return the scalar parameters that aren't read-only, in the form that the page expects.

    Each has its `name`, `kind` (bool, int, float or text), `value` and `text`; `low` and `high`
    where it's bounded, `choices` where it's one of several.
    """
    rows = []
    for described, value in zip(descriptors, values):
        kind = _KINDS.get(value.type)
        if kind is None or described.read_only:
            continue
        row: dict[str, Any] = {
            'name': described.name, 'kind': kind, 'value': parameter_value_to_python(value),
            'text': described.description}
        for span in (*described.integer_range, *described.floating_point_range):
            if abs(span.from_value) < min(2**53, sys.float_info.max):
                row['low'] = span.from_value
            if abs(span.to_value) < min(2**53, sys.float_info.max):
                row['high'] = span.to_value
        if described.additional_constraints.startswith(_CHOICES):
            row['choices'] = described.additional_constraints.removeprefix(_CHOICES).split(', ')
        rows.append(row)
    return rows


def parameter_value(kind: str, value: Any) -> ParameterValue:
    """Return a value from the page as a parameter's; ValueError if it isn't of its kind."""
    if kind == 'bool' and isinstance(value, bool):
        return ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=value)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if kind == 'int' and number and value == int(value) and abs(value) < 2**63:
        return ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=int(value))
    if kind == 'float' and number:
        return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float(value))
    if kind == 'text' and isinstance(value, str):
        return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    raise ValueError(f'{value!r} is no value of kind {kind!r}')
