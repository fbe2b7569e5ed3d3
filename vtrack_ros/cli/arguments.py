"""Values on the command line, each with a message that says what is valid."""

from __future__ import annotations

from argparse import ArgumentTypeError
import math

from vtrack_ros.geometry import Box


def positive_integer(text: str) -> int:
    """Read a whole number from 1 on."""
    value = _integer(text)
    if value is None or value < 1:
        raise ArgumentTypeError(f'must be a whole number from 1 on, not {text!r}')
    return value


def seed(text: str) -> int:
    """Read a whole number from 0 on, as seeds are."""
    value = _integer(text)
    if value is None or not 0 <= value < 2 ** 31:
        raise ArgumentTypeError(f'must be a whole number from 0 to {2 ** 31 - 1}, not {text!r}')
    return value


def positive_number(text: str) -> float:
    """Read a number above 0."""
    value = _number(text)
    if not value > 0:
        raise ArgumentTypeError(f'must be a number above 0, not {text!r}')
    return value


def duration(text: str) -> float:
    """Read a number of seconds, 0 included."""
    value = _number(text)
    if not value >= 0:
        raise ArgumentTypeError(f'must be a number of seconds from 0 on, not {text!r}')
    return value


def image_size(text: str) -> tuple[int, int]:
    """Read a size such as 640x480."""
    sizes = [_integer(part) for part in text.lower().split('x')]
    if len(sizes) != 2 or sizes[0] is None or sizes[1] is None or min(sizes[0], sizes[1]) < 1:
        raise ArgumentTypeError(f'must be WIDTHxHEIGHT in pixels, such as 640x480, not {text!r}')
    return sizes[0], sizes[1]


def box(text: str) -> Box:
    """Read a box such as 10,20,30,40."""
    try:
        x, y, width, height = (float(part) for part in text.split(','))
    except ValueError:
        raise ArgumentTypeError(
            f'must be X,Y,WIDTH,HEIGHT in pixels, such as 10,20,30,40, not {text!r}') from None
    try:
        return Box(x, y, width, height)
    except ValueError as error:
        raise ArgumentTypeError(f'{text!r}: {error}') from None


def _integer(text: str) -> int | None:
    try:
        return int(text)
    except ValueError:
        return None


def _number(text: str) -> float:
    """Return a finite number, or NaN for anything else."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
