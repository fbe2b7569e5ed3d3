"""The files beside the node: parameter files, layouts, launch files, the documentation."""

import ast
import importlib.util
import json
import re

from node_harness import Client, NodeProcess
import pytest
from vtrack_ros.node.parameter_files import files
from vtrack_ros.ros.dds_profile import profile_path, receiving_profile, VARIABLES, with_profile
from vtrack_ros.ros.parameters import INIT_BOX, NODE_PARAMETERS, parameter_table
from vtrack_ros.trackers import tracker_class, tracker_names
import yaml

#: The topics and services that a node called tracker offers, as layouts name them.
OFFERED = ['/pose', '/pose_with_covariance', '/detections', '/bounding_box', '/tracker/state',
           '/tracker/particles', '/tracker/debug_image', '/diagnostics']


@pytest.mark.parametrize('name', files())
def test_made_from_the_table(repository, name):
    """Files and table say the same; after a change of the table they are to be made again."""
    path = repository / name
    assert path.is_file() and path.read_text() == files()[name], (
        f'{name} is not what the table says: run python -m vtrack_ros.node.parameter_files')


@pytest.mark.parametrize('tracker', tracker_names())
def test_parameter_files_hold_the_defaults(repository, tracker):
    """Read as ROS reads them, they give every parameter its default."""
    tree = yaml.safe_load((repository / 'config' / f'{tracker}.yaml').read_text())
    values = tree['/**']['ros__parameters']
    own = values.pop(tracker, None) or {}
    assert own == tracker_class(tracker).PARAMETERS.defaults()
    assert values.pop('tracker') == tracker
    expected = NODE_PARAMETERS.defaults()
    del expected['tracker']
    assert values == expected


def test_a_node_takes_every_parameter_file(repository):
    """The real node, started with one file after another, has that tracker."""
    arguments = []
    for tracker in tracker_names():
        arguments += ['--params-file', str(repository / 'config' / f'{tracker}.yaml')]
    with NodeProcess(*arguments), Client() as client:
        assert client.parameters.wait_for_services(20)
        # The last file wins for what all of them have.
        assert client.get('tracker') == [tracker_names()[-1]]
        table = parameter_table()
        names = [name for name in table if name != 'tracker']
        assert client.get(*names) == [table[name].default for name in names]
        # All topics that layouts name are there.
        client.until(lambda: all(map(client.node.count_publishers, OFFERED)), 'topics missing')


def test_layouts_name_topics_that_exist(repository):
    """The two of them show what the node publishes."""
    config = repository / 'config'
    tree = yaml.safe_load((config / 'vtrack.rviz').read_text())
    displays = tree['Visualization Manager']['Displays']
    topics = [display['Topic']['Value'] for display in displays if 'Topic' in display]
    assert len(topics) >= 2 and set(topics) <= set(OFFERED)

    layout = json.loads((config / 'vtrack.foxglove.json').read_text())
    text = json.dumps(layout['configById'])
    named = re.findall(r'"(/[\w/]+)', text)
    assert len(named) >= 5 and set(named) <= set(OFFERED)
    panels = re.findall(r'\w+!\w+', json.dumps(layout['layout']))
    assert sorted(panels) == sorted(layout['configById'])


def test_targets_file(repository):
    """The example of several targets has parameters that the node takes."""
    targets = yaml.safe_load((repository / 'config' / 'targets.yaml').read_text())
    table = parameter_table()
    assert len(targets) >= 2
    for target in targets.values():
        assert set(target) <= {'image', 'camera_info', 'params_file', 'parameters'}
        for name, value in target['parameters'].items():
            if isinstance(value, dict):
                for own, number in value.items():
                    table[f'{name}.{own}'].checked(number)
            elif name != INIT_BOX:
                table[name].checked(value)


@pytest.mark.parametrize('name', ['tracker.launch.py', 'multi.launch.py'])
def test_launch_files(repository, name):
    """They are Python, say how to be used, and describe a launch where launch is installed."""
    path = repository / 'launch' / name
    tree = ast.parse(path.read_text())
    assert f'ros2 launch vtrack_ros {name}' in ast.get_docstring(tree)
    names = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert 'generate_launch_description' in names
    if importlib.util.find_spec('launch_ros') is None:
        return
    spec = importlib.util.spec_from_file_location('launch_file', path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.generate_launch_description().entities


def test_documentation_names_every_row(repository):
    """Every topic, service and parameter of the node is in its manual."""
    text = (repository / 'docs' / 'node.md').read_text()
    rows = ['image', 'image/compressed', 'camera_info', '~/init', '~/init_roi',
            '~/init_detections', 'pose', 'pose_with_covariance', 'detections', 'bounding_box',
            '~/state', '~/particles', '~/debug_image', '/diagnostics', '~/reset', '~/enable',
            '~/reinit', '/tf']
    for name in (*rows, INIT_BOX, *NODE_PARAMETERS):
        assert f'`{name}`' in text, name


def test_profile_is_found_and_not_forced_on_anybody():
    """A child gets our profile, unless somebody chose another; the node a lighter one."""
    path = str(profile_path())
    assert with_profile({}) == dict.fromkeys(VARIABLES, path)
    chosen = {VARIABLES[0]: '/my/profile.xml'}
    assert with_profile(chosen) == chosen
    assert receiving_profile(chosen) == chosen and receiving_profile({}) == {}
    lighter = receiving_profile({VARIABLES[0]: path})[VARIABLES[0]]
    assert lighter.endswith('config/fastdds_node.xml')
    sizes = [int(re.search(r'<segment_size>(\d+)', open(file).read()).group(1))
             for file in (path, lighter)]
    assert sizes[1] < sizes[0]
