"""Tables of parameters: the one source of type, default, range, unit and description."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
import math
from typing import Any

#: The types of a parameter's value.
Value = bool | int | float | str
#: Those types in words.
_WORDS = {bool: 'true or false', int: 'an integer', float: 'a number', str: 'text'}


@dataclass(frozen=True)
class Parameter:
    """
    One parameter: everything that a node, a command line or a manual has to know about it.

    Its type is the default's, its description a sentence for the user. A number may have bounds,
    which are valid themselves, and a unit such as ``px``, empty where it has none; `choices` are
    the valid values, empty where any value of the type and in the range is valid. A dynamic one
    may change while the tracker runs. `check` raises a ValueError at a value of that type and
    range that is invalid still; the default is valid. TypeError or ValueError if the default isn't
    of such a type, in the range or among the choices.
    """

    name: str
    default: Value
    description: str
    low: float | None = None
    high: float | None = None
    unit: str = ''
    choices: tuple[str, ...] | tuple[int, ...] = ()
    dynamic: bool = True
    check: Callable[[Any], object] | None = None

    def __post_init__(self) -> None:
        """Check the default: a node could not declare a wrong one, and would not start."""
        if self.kind not in _WORDS:
            raise TypeError(f'{self.name}: the default must be a bool, int, float or str, not '
                            f'{self.default!r}')
        self.checked(self.default)

    @property
    def kind(self) -> type[Value]:
        """Return the type of the values."""
        return type(self.default)

    @property
    def valid(self) -> str:
        """Describe the valid values in words."""
        if self.choices:
            return 'one of ' + ', '.join(map(str, self.choices))
        text = _WORDS[self.kind]
        if self.low is not None and self.high is not None:
            text += f' from {self.low:.10g} to {self.high:.10g}'
        elif self.low is not None:
            text += f' of at least {self.low:.10g}'
        elif self.high is not None:
            text += f' of at most {self.high:.10g}'
        return text + (f' {self.unit}' if self.unit else '')

    def checked(self, value: Any) -> Value:
        """
        Return `value` in the parameter's type.

        TypeError if it's of another type (an integer is taken for a float); ValueError if it's
        outside the range, not finite, not among the choices, or `check` says so.
        """
        kind = self.kind
        if kind is bool or isinstance(value, bool):
            fits = kind is bool and isinstance(value, bool)
        elif kind is int:
            fits = hasattr(value, '__index__')
        elif kind is float:
            fits = hasattr(value, '__float__') and not isinstance(value, str)
        else:
            fits = isinstance(value, str)
        if not fits:
            raise TypeError(f'{self.name} must be {self.valid}, not {value!r}')
        try:
            result: Value = kind(value)
        except OverflowError:
            # an integer beyond any float
            raise ValueError(f'{self.name} must be {self.valid}, not {value!r}') from None
        if self.choices and result not in self.choices:
            raise ValueError(f'{self.name} must be {self.valid}, not {value!r}')
        if isinstance(result, (int, float)) and kind is not bool:
            below = self.low is not None and result < self.low
            above = self.high is not None and result > self.high
            if below or above or not math.isfinite(result):
                raise ValueError(f'{self.name} must be {self.valid}, not {value!r}')
        if self.check is not None and result != self.default:
            try:
                self.check(result)
            except ValueError as error:
                raise ValueError(f'{self.name}: {error}') from None
        return result

    def parsed(self, text: str) -> Value:
        """Return the value that `text` holds, as on a command line; errors as `checked`."""
        value: Value = text
        try:
            if self.kind is bool:
                value = {'true': True, 'false': False}[text.lower()]
            elif self.kind is not str:
                value = self.kind(text)
        except (KeyError, ValueError):
            raise ValueError(f'{self.name} must be {self.valid}, not {text!r}') from None
        return self.checked(value)


class ParameterTable(dict[str, Parameter]):
    """An ordered table of parameters by name; it's never changed in place."""

    def __init__(self, parameters: Iterable[Parameter]) -> None:
        super().__init__((parameter.name, parameter) for parameter in parameters)

    def __add__(self, other: ParameterTable) -> ParameterTable:
        """Return a table of both; a row of `other` replaces the row of the same name."""
        return ParameterTable({**self, **other}.values())

    def defaults(self) -> dict[str, Value]:
        """Return name -> default."""
        return {name: row.default for name, row in self.items()}

    def checked(self, values: Mapping[str, Any], owner: str = '') -> dict[str, Value]:
        """
        Return the values in their parameters' types; errors as `Parameter.checked`.

        An unknown name is a ValueError that lists the valid ones, and names the owner if given.
        """
        for name in values:
            if name not in self:
                whose = f' of {owner}' if owner else ''
                raise ValueError(
                    f'unknown parameter{whose}: {name!r}; valid are ' + ', '.join(self))
        return {name: self[name].checked(value) for name, value in values.items()}
