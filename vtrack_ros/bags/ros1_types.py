"""Message types of ROS 1 bags, compared with those of ROS 2."""

from functools import cache

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import get_types_from_msg, TypesysError

from vtrack_ros.bags.messages import typestore

#: What ROS 2 puts into a message without fields.
_NO_FIELD = 'structure_needs_at_least_one_member'
_HEADER = 'std_msgs/msg/Header'


@cache
def is_convertible(name: str, definition: str) -> bool:
    """
    Return whether messages of a ROS 1 bag's type have the fields of ROS 2 Jazzy's of that name.

    `definition` is the bag's. Its bytes are converted field by field, so the fields have to be of
    the same types, in the same order; their names may differ.
    """
    if name not in typestore().fielddefs:
        return False
    try:
        types = get_types_from_msg(definition, name)
    except (TypesysError, ValueError):
        # nothing speaks against it: the conversion itself finds out
        return True
    return _same(name, types)


def _same(name: str, types: Typesdict) -> bool:
    """Compare a type with that of ROS 2; those that the definition leaves out are built in."""
    if name not in types or name == _HEADER:
        # the header's number in ROS 1 is left out in the conversion
        return True
    here = types[name][1]
    there = [field for field in typestore().fielddefs[name][1] if field[0] != _NO_FIELD]
    return len(here) == len(there) and all(
        one == other and _same(_inner(one), types) for (_, one), (_, other) in zip(here, there))


def _inner(field: FieldDesc) -> str:
    """Return the name of the type of a field, or of its elements."""
    kind = field[1][0] if field[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else field
    return str(kind[1])
