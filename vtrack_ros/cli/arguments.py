"""Parsers of command-line values, with error messages that say what is valid."""

from argparse import ArgumentTypeError
from collections.abc import Callable
import math
import re
from typing import TypeVar

from vtrack_ros.geometry import Box

Number = TypeVar('Number', int, float)
#: With a longer one, the names of a node's own services would be too long for ROS.
_LONGEST_NODE_NAME = 221


def _number(kind: Callable[[str], Number], low: float, high: float,
            valid: str) -> Callable[[str], Number]:
    def read(text: str) -> Number:
        try:
            value = kind(text)
            if math.isfinite(value) and low <= value <= high:
                return value
        except (OverflowError, ValueError):
            # an integer beyond any float, or no number
            pass
        raise ArgumentTypeError(f'must be {valid}, not {text!r}')
    return read


positive_integer = _number(int, 1, math.inf, 'an integer of at least 1')
seed = _number(int, 0, 2 ** 31 - 1, f'an integer from 0 to {2 ** 31 - 1}')
positive_number = _number(float, math.ulp(0.0), math.inf, 'a positive number')
duration = _number(float, 0.0, 1e6, 'a number of seconds from 0 to 1,000,000')


def image_size(text: str) -> tuple[int, int]:
    """Read a size such as 640x480."""
    try:
        width, height = map(positive_integer, text.lower().split('x'))
    except (ArgumentTypeError, ValueError):
        raise ArgumentTypeError(
            f'must be WIDTHxHEIGHT in pixels, such as 640x480, not {text!r}') from None
    return width, height


def box(text: str) -> Box:
    """Read a box such as 10,20,30,40."""
    try:
        x, y, width, height = map(float, text.split(','))
    except ValueError:
        raise ArgumentTypeError(
            f'must be X,Y,WIDTH,HEIGHT in pixels, such as 10,20,30,40, not {text!r}') from None
    try:
        return Box(x, y, width, height)
    except ValueError as error:
        raise ArgumentTypeError(f'{text!r}: {error}') from None


def node_name(text: str) -> str:
    """Read the name of a node, and return it with its namespace."""
    name = text if text.startswith('/') else f'/{text}'
    if len(name) > _LONGEST_NODE_NAME or not re.fullmatch(r'(/[A-Za-z_][A-Za-z0-9_]*)+', name):
        raise ArgumentTypeError(f'must be the name of a node, such as /tracker, not {text!r}')
    return name
