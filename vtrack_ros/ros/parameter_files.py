"""
Parameter files and manual: config/*.yaml and docs/parameters.md, generated from the tables.

`python -m vtrack_ros.ros.parameter_files` regenerates them in the source tree.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
import textwrap

from vtrack_ros.parameters import Parameter, Value
from vtrack_ros.ros.parameter_node import INIT_BOX, INIT_BOX_DESCRIPTION, NODE_PARAMETERS
from vtrack_ros.trackers import tracker_class, tracker_names

_HEAD = """\
# {title}
#
# ros2 run vtrack_ros tracker --ros-args --params-file {name}.yaml
#
# All values are the defaults; a parameter that is left out keeps its default. Several files may be
# given, each with its own --params-file.{note}

/**:
  ros__parameters:
"""
_PAGE = """\
# Parameters

All parameters of the node and of its trackers. Those marked *fixed* are read when the node starts.
All others can be changed while it runs and take effect with the next image, unless the description
says that they take effect with the next target; the service `~/reinit` applies those at once. A
wrong value is refused with the reason and the valid range, and nothing changes.

    ros2 param set /tracker gmpf.particles 300
    ros2 param describe /tracker gmpf.particles

`config/node.yaml` contains the node's own parameters; `config/gmpf.yaml` and the like select a
tracker and contain its parameters. This page and those files are generated from the tables in the
code by `python -m vtrack_ros.ros.parameter_files`.
"""
#: The trackers that get a file: without OpenCV's, the papers' and those of other packages.
_PRODUCT = tracker_names(replicas=False, installed=False)
_TABLE = '| parameter | default | valid | what it does |', '| --- | --- | --- | --- |'


def files() -> dict[str, str]:
    """Return the text of every file, by its path in the source tree."""
    texts = {f'config/{name}.yaml': _tracker_yaml(name) for name in _PRODUCT}
    texts['config/node.yaml'] = _node_yaml()
    texts['docs/parameters.md'] = _page()
    return texts


def _node_yaml() -> str:
    text = _HEAD.format(title="The node's own parameters.", name='node',
                        note=' Those marked "fixed" are read at the start.')
    rows = [row for name, row in NODE_PARAMETERS.items() if name != 'tracker']
    lines = [*_entries(rows, 4), *_comment(INIT_BOX_DESCRIPTION, 4),
             f'    # {INIT_BOX}: [100.0, 200.0, 60.0, 60.0]']
    return text + '\n'.join(lines) + '\n'


def _tracker_yaml(tracker: str) -> str:
    cls = tracker_class(tracker)
    text = _HEAD.format(title=f'{tracker}: {cls.SUMMARY}.', name=tracker, note='')
    lines = [f'    tracker: {tracker}']
    if cls.PARAMETERS:
        lines += [f'    {tracker}:', *_entries(cls.PARAMETERS.values(), 6)]
    return text + '\n'.join(lines) + '\n'


def _entries(rows: Iterable[Parameter], indent: int) -> Iterator[str]:
    for row in rows:
        fixed = '' if row.dynamic else ' Fixed.'
        yield from _comment(f'{row.description} Valid: {row.valid}.{fixed}', indent)
        yield f'{" " * indent}{row.name}: {_scalar(row.default)}'


def _comment(text: str, indent: int) -> list[str]:
    start = ' ' * indent + '# '
    return textwrap.wrap(text, 99, initial_indent=start, subsequent_indent=start)


def _scalar(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value if value and value.isidentifier() else f"'{value}'"
    return repr(value)


def _page() -> str:
    lines = [_PAGE, '## The node', '', *_TABLE]
    lines += [_row(f'`{name}`', row) for name, row in NODE_PARAMETERS.items()]
    lines += [f'| `{INIT_BOX}` | `[]` | four numbers, or none | {INIT_BOX_DESCRIPTION} |', '']
    others = [name for name in tracker_names(installed=False) if name not in _PRODUCT]
    opencv = [name for name in others if name.startswith('opencv_')]
    for title, trackers in (
            ('The trackers', _PRODUCT), ("OpenCV's trackers", opencv),
            ("The papers' methods", [name for name in others if name not in opencv])):
        lines += [f'## {title}', '']
        lines += [f'- `{name}`: {tracker_class(name).SUMMARY}' for name in trackers]
        example = next(f'{name}.{row}' for name in trackers
                       for row in tracker_class(name).PARAMETERS)
        lines += ['', f"Prefix each name with the tracker's, as in `{example}`:", '', *_TABLE]
        owners: dict[Parameter, list[str]] = {}
        for name in trackers:
            for row in tracker_class(name).PARAMETERS.values():
                owners.setdefault(row, []).append(name)
        lines += [_row(f'`{row.name}` of ' + ', '.join(names), row)
                  for row, names in owners.items()]
        lines.append('')
    return '\n'.join(lines).rstrip() + '\n'


def _row(name: str, row: Parameter) -> str:
    fixed = '' if row.dynamic else ' *(fixed)*'
    description = row.description.replace('|', '\\|')
    return f'| {name} | `{_scalar(row.default)}` | {row.valid} | {description}{fixed} |'


if __name__ == '__main__':
    for path, contents in files().items():
        (Path(__file__).resolve().parents[2] / path).write_text(contents)
        print(path)
