"""
The parameters as files: config/*.yaml and docs/parameters.md, made from the one table.

`python -m vtrack_ros.ros.parameter_files` writes them afresh into the source tree.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
import textwrap

from vtrack_ros.parameters import Parameter, Value
from vtrack_ros.ros.parameter_node import INIT_BOX, INIT_BOX_DESCRIPTION, NODE_PARAMETERS
from vtrack_ros.trackers import tracker_class, tracker_names

_HEAD = """\
# {name}: {summary}.
#
# ros2 run vtrack_ros tracker --ros-args --params-file {name}.yaml
#
# All parameters with their defaults, in any order and number: what is left out keeps its default.
# Those marked "fixed" are read once; all others may change while the node runs. Those that act at
# the next start do so with the next target, or at once with the service ~/reinit.
"""
_PAGE = """\
# Parameters

Every parameter of the node, its trackers' own ones included. All but those marked *fixed* may
change while the node runs, and act on the next frame; a few say that they act at the next start,
which is that of the next target, or at once with the service `~/reinit`. A wrong value is refused
with the reason and the valid range, and nothing changes.

    ros2 param set /tracker gmpf.particles 300
    ros2 param describe /tracker gmpf.particles

This page and the files `config/*.yaml` are made from the table in the code by
`python -m vtrack_ros.ros.parameter_files`.
"""


def files() -> dict[str, str]:
    """Return the path in the source tree -> the text of every file."""
    texts = {f'config/{name}.yaml': _yaml(name) for name in tracker_names(replicas=False)}
    texts['docs/parameters.md'] = _markdown()
    return texts


def write(root: Path) -> list[Path]:
    """Write the files below a source tree's root; return their paths."""
    paths = []
    for name, text in files().items():
        path = root / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        paths.append(path)
    return paths


def _yaml(tracker: str) -> str:
    cls = tracker_class(tracker)
    lines = [_HEAD.format(name=tracker, summary=cls.SUMMARY), '/**:', '  ros__parameters:']
    for name, row in NODE_PARAMETERS.items():
        lines += _entry(row, tracker if name == 'tracker' else row.default, 4)
        if name == 'seed':
            lines += _comment(INIT_BOX_DESCRIPTION, 4)
            lines.append(f'    # {INIT_BOX}: [100.0, 200.0, 60.0, 60.0]')
    lines += ['', f'    {tracker}:']
    for row in cls.PARAMETERS.values():
        lines += _entry(row, row.default, 6)
    if not cls.PARAMETERS:
        del lines[-2:]
    return '\n'.join(lines) + '\n'


def _entry(row: Parameter, value: Value, indent: int) -> Iterator[str]:
    fixed = '' if row.dynamic else ' Fixed.'
    yield from _comment(f'{row.description} Valid: {row.valid}.{fixed}', indent)
    yield f'{" " * indent}{row.name}: {_scalar(value)}'


def _comment(text: str, indent: int) -> list[str]:
    start = ' ' * indent + '# '
    return textwrap.wrap(text, 99, initial_indent=start, subsequent_indent=start)


def _scalar(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value if value and value.isidentifier() else f"'{value}'"
    return repr(value)


def _markdown() -> str:
    lines = [_PAGE, '## The node', '', *_table(NODE_PARAMETERS.values(), ''),
             f'| `{INIT_BOX}` | `[]` | four numbers, or none | {INIT_BOX_DESCRIPTION} |', '']
    for tracker in tracker_names():
        cls = tracker_class(tracker)
        lines += [f'## `{tracker}`: {cls.SUMMARY}', '']
        lines += [*_table(cls.PARAMETERS.values(), f'{tracker}.'), ''] if cls.PARAMETERS else [
            'It has no parameters of its own.', '']
    return '\n'.join(lines).rstrip() + '\n'


def _table(rows: Iterable[Parameter], prefix: str) -> Iterator[str]:
    yield '| parameter | default | valid | what it does |'
    yield '| --- | --- | --- | --- |'
    for row in rows:
        fixed = '' if row.dynamic else ' *(fixed)*'
        description = row.description.replace('|', '\\|')
        yield (f'| `{prefix}{row.name}` | `{_scalar(row.default)}` | {row.valid} | '
               f'{description}{fixed} |')


if __name__ == '__main__':
    for written in write(Path(__file__).resolve().parents[2]):
        print(written)
