"""Topics of bags, and their names, checked without ROS."""

from dataclasses import dataclass
import re

from vtrack_ros.bags.errors import BagError

_LONGEST = 247
_NAME = re.compile(r'(/[A-Za-z_][A-Za-z0-9_]*)+')


@dataclass(frozen=True)
class Topic:
    """
    A topic of a bag, its name with a leading slash; `count` is the number of its messages.

    `reliable` and `transient_local` are what its publishers offered, as far as that's known; in
    ROS 1 a latched topic is what `transient_local` is in ROS 2. It's not `convertible` if it's of
    ROS 1, and ROS 2 Jazzy has no such type or another one.
    """

    name: str
    message_type: str
    count: int
    reliable: bool
    transient_local: bool
    convertible: bool = True


def absolute(name: str) -> str:
    """Return a topic's name with its leading slash."""
    return '/' + name.lstrip('/')


def checked_topic(name: str, remedy: str = '') -> str:
    """Return a topic's name with its leading slash; BagError if it isn't valid in ROS."""
    full = absolute(name)
    if len(full) > _LONGEST or not _NAME.fullmatch(full):
        raise BagError(
            f'{name!r} is not a valid topic name: each part between slashes consists of letters, '
            f'digits and underscores without a leading digit, and the whole name has at most '
            f'{_LONGEST} characters{remedy}')
    return full
