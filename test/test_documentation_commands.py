"""Every command of the documentation is valid: its options, names, values and files exist."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
import re
import shlex

from conftest import REPOSITORY
from documented_commands import (
    arguments, commands, EXAMPLES_LEFT, EXECUTABLES, LEFT, OTHERS, PAGES)
import pytest
import sensor_msgs.msg
from vtrack_ros.cli.command_line import command_parser, negative_values
from vtrack_ros.evaluation.stress_kinds import stress_kinds
from vtrack_ros.evaluation.tracker_specification import parse_trackers
from vtrack_ros.ros.parameter_node import checked_init_box, parameter_table
from vtrack_ros.scenes import scene_names
import yaml


def check_vtrack(words: list[str]) -> None:
    """Check a command line of vtrack."""
    found = command_parser(words[0]).parse_args(negative_values(words))
    if hasattr(found, 'trackers'):
        parse_trackers(found.trackers.replace('steady', 'pf'))
        stress_kinds(found.stress or 'all')
    for scene in (getattr(found, 'scenes', None) or 'football').split(','):
        assert scene in scene_names()


def check_parameter(name: str, value: str) -> None:
    """Check that the node has a parameter that may have that value."""
    if name == 'init_box':
        assert checked_init_box(yaml.safe_load(value))
    elif not name.startswith('steady.') and value != 'steady':
        parameter_table()[name].parsed(value)


def check_ros2(verb: str, words: list[str]) -> None:
    """Check a command line of ros2, as far as it concerns this package."""
    if verb == 'run' and words[0] == 'vtrack_ros':
        assert words[1] in EXECUTABLES
        if words[1] == 'vtrack':
            check_vtrack(words[2:])
        for flag, value in zip(words, words[1:]):
            if flag == '-p':
                check_parameter(*value.split(':='))
    elif verb == 'launch' and words[0] == 'vtrack_ros':
        text = (REPOSITORY / 'launch' / words[1]).read_text()
        assert all(f"'{word.split(':=')[0]}'" in text for word in words[2:])
    elif verb == 'param' and words[0] == 'set':
        check_parameter(*words[2:])
    elif verb == 'topic' and words[0] == 'pub':
        package, kind = words[-2].split('/msg/')
        assert package == 'sensor_msgs'
        getattr(sensor_msgs.msg, kind)(**yaml.safe_load(words[-1]))
    else:
        if verb != 'run':
            call = arguments(['ros2', verb, *words])
            assert isinstance(call, str) or Path(call[0]).is_file(), call
        assert verb in ('bag', 'launch', 'param', 'pkg', 'run', 'security', 'topic'), verb


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_commands(page):
    """Options, names, types and values are valid; files exist."""
    for words in commands(page):
        program = words[0].removeprefix('./')
        if program == 'vtrack':
            check_vtrack(words[1:])
        elif program == 'ros2':
            check_ros2(words[1], words[2:])
        elif program in ('python', 'python3'):
            assert words[1].startswith('-') or (REPOSITORY / words[1]).is_file(), words
        elif program.startswith('scripts/'):
            assert (REPOSITORY / program).is_file(), words
        else:
            assert program in (*OTHERS, *EXECUTABLES) or program.startswith('.venv/bin/')


@pytest.mark.parametrize('name', [
    'synth', 'import', 'play', 'replay', 'evaluate', 'doctor', 'layout', 'select'])
def test_examples_of_the_help(name):
    """The commands that `vtrack NAME --help` shows are valid."""
    examples = import_module(f'vtrack_ros.cli.{name}_command').EXAMPLES
    found = [shlex.split(line.partition(' > ')[0], comments=True)
             for line in examples.splitlines() if line.startswith(f'  vtrack {name}')]
    assert found
    for words in found:
        check_vtrack(words[1:])


def test_commands_are_found():
    """On three of the pages at least the known number of commands is found."""
    counts = {page.name: len(list(commands(page))) for page in PAGES}
    assert counts['node.md'] >= 9 and counts['bags.md'] >= 14 and counts['start.md'] >= 14


def test_what_is_left():
    """The reasons why benchmarks/documented_commands.py leaves some out name tests that exist."""
    reasons = ' '.join((*OTHERS.values(), *LEFT.values(), *EXAMPLES_LEFT.values()))
    for name in re.findall(r'\S+\.py', reasons):
        assert list(REPOSITORY.glob(name if '/' in name else f'test/{name}')), name
    assert {*EXAMPLES_LEFT} <= {page.name for page in PAGES}
