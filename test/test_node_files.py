"""The files beside the node: parameter files, layouts, launch files, the documentation."""

import ast
import importlib.util
import json
import re
import sys
from types import SimpleNamespace
from xml.etree import ElementTree

from node_harness import Client, NodeProcess
import pytest
from sensor_msgs.msg import CompressedImage
from vtrack_ros.cli.command_line import main
from vtrack_ros.dds import (
    profile_path, receiving_profile, TRANSPORTS, VARIABLES, with_profile)
from vtrack_ros.ros.parameter_files import files
from vtrack_ros.ros.parameter_node import INIT_BOX, NODE_PARAMETERS, parameter_table
from vtrack_ros.trackers import tracker_class, tracker_names
import yaml

#: The topics that a node called tracker publishes, as layouts name them.
OFFERED = ['/pose', '/pose_with_covariance', '/twist', '/detections', '/bounding_box',
           '/tracker/state', '/tracker/particles', '/tracker/debug_image', '/diagnostics']


@pytest.mark.parametrize('name', files())
def test_made_from_the_table(repository, name):
    """Each generated file is up to date with the table of parameters."""
    path = repository / name
    assert path.is_file() and path.read_text() == files()[name], (
        f'{name} is not what the table says: run python -m vtrack_ros.ros.parameter_files')


def parameters(repository, name):
    """Return the parameters that a parameter file sets."""
    tree = yaml.safe_load((repository / 'config' / f'{name}.yaml').read_text())
    return tree['/**']['ros__parameters']


@pytest.mark.parametrize('tracker', tracker_names(replicas=False))
def test_parameter_files_hold_the_defaults(repository, tracker):
    """Each sets the tracker, and that tracker's parameters to their defaults, and nothing else."""
    values = parameters(repository, tracker)
    assert values.pop('tracker') == tracker
    assert values.pop(tracker, {}) == tracker_class(tracker).PARAMETERS.defaults()
    assert not values


def test_the_nodes_own_parameters_have_a_file(repository):
    """config/node.yaml has all node parameters but `tracker`, with their defaults."""
    assert {**parameters(repository, 'node'), 'tracker': 'gmpf'} == NODE_PARAMETERS.defaults()


def test_a_node_takes_every_parameter_file(repository):
    """A node started with all parameter files has the last one's tracker, and all defaults."""
    arguments = ['--params-file', str(repository / 'config' / 'node.yaml')]
    trackers = tracker_names(replicas=False)
    for tracker in trackers:
        arguments += ['--params-file', str(repository / 'config' / f'{tracker}.yaml')]
    with NodeProcess(*arguments), Client() as client:
        assert client.parameters.wait_for_services(20)
        # Of a parameter that several files set, the last file's value is used.
        assert client.get('tracker') == [trackers[-1]]
        table = parameter_table()
        names = [name for name in table if name != 'tracker']
        assert client.get(*names) == [table[name].default for name in names]
        # All topics that layouts name are there.
        client.until(lambda: all(map(client.node.count_publishers, OFFERED)), 'topics missing')


def test_layouts_name_topics_that_exist(repository):
    """The layouts of RViz and Foxglove only name topics that the node publishes."""
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
    """They are Python, document their use, and describe a launch where launch is installed."""
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


@pytest.fixture
def launched(repository, monkeypatch):
    """Return a function that makes a launch file's nodes; launch (there's no wheel) is mocked."""
    configuration = SimpleNamespace(
        LaunchConfiguration=lambda name: SimpleNamespace(perform=lambda given: given[name]))
    stand_ins = {
        'launch': SimpleNamespace(LaunchDescription=list),
        'launch.actions': SimpleNamespace(
            DeclareLaunchArgument=lambda name, default_value, description: {name: default_value},
            OpaqueFunction=lambda function: {}),
        'launch.substitutions': configuration,
        'launch_ros': SimpleNamespace(), 'launch_ros.actions': SimpleNamespace(
            Node=SimpleNamespace)}
    for name, stand_in in stand_ins.items():
        monkeypatch.setitem(sys.modules, name, stand_in)
    monkeypatch.setattr('ament_index_python.packages.get_package_share_directory',
                        lambda name: str(repository))

    def nodes(name, **given):
        spec = importlib.util.spec_from_file_location('launch_file', repository / 'launch' / name)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        defaults = {}
        for declared in module.generate_launch_description():
            defaults.update(declared)
        return module.nodes({**defaults, **given})
    return nodes


def values(node):
    """Return the parameters that a launch file gives beside parameter files."""
    return next((row for row in node.parameters if isinstance(row, dict)), {})


def test_launch_passes_on_what_is_given(launched, repository):
    """Only given arguments are passed on; others are left to parameter file or defaults."""
    file = str(repository / 'config' / 'pf.yaml')
    node, = launched('tracker.launch.py', params_file=file)
    assert node.parameters[0] == file and values(node) == {}
    assert node.remappings == []
    node, = launched(
        'tracker.launch.py', tracker='pf', image='/camera', image_transport='compressed',
        use_sim_time='true', init_box='[300, 200, 60, 80]', camera_info='/info')
    assert values(node) == {'tracker': 'pf', 'image_transport': 'compressed',
                            'use_sim_time': True, 'init_box': [300.0, 200.0, 60.0, 80.0]}
    assert sorted(node.remappings) == [('camera_info', '/info'), ('image', '/camera')]


@pytest.mark.parametrize('image', ['/image_raw', '/image_raw/compressed'])
@pytest.mark.parametrize('name', ['tracker.launch.py', 'multi.launch.py'])
def test_compressed_images_of_a_camera(launched, tmp_path, name, image):
    """Given a camera's topic, or its compressed one, the node takes the compressed images."""
    if name.startswith('multi'):
        path = tmp_path / 'targets.yaml'
        path.write_text(f'a: {{image: {image}, parameters: {{image_transport: compressed}}}}')
        node, = launched(name, targets=str(path))
    else:
        node, = launched(name, image=image, image_transport='compressed')
    remaps = [word for old, new in node.remappings for word in ('-r', f'{old}:={new}')]
    with NodeProcess(*remaps, **values(node)) as process:
        process.wait_for_log('images are taken from /image_raw/compressed;')


@pytest.mark.parametrize('text', ['', '[]'])
def test_launch_without_a_box(launched, text):
    """An empty init_box isn't passed on, because launch has no type for an empty list."""
    node, = launched('tracker.launch.py', init_box=text)
    assert 'init_box' not in values(node)


@pytest.mark.parametrize('text', ['300,200,60,80', '[300, 200, 60]', 'here', '[a, b, c, d]', '7',
                                  '0', '[1, 2, -3, 4]', '[1, 2'])
def test_launch_refuses_what_is_no_box(launched, text):
    """A wrong init_box raises an error that says what is valid."""
    with pytest.raises((TypeError, ValueError), match=r'valid is \[x, y, width, height\]'):
        launched('tracker.launch.py', init_box=text)


@pytest.mark.parametrize('text', ['often', '1', '['])
def test_launch_refuses_what_is_no_switch(launched, text):
    """An argument that is neither true nor false raises an error that names it."""
    with pytest.raises(ValueError, match='managed must be true or false, not'):
        launched('tracker.launch.py', managed=text)


def test_launch_starts_again_what_ended(launched, tmp_path):
    """Nodes get `respawn` and `state_file` if they are given; `respawn` must be a bool."""
    node, = launched('tracker.launch.py')
    assert not node.respawn and 'state_file' not in values(node)
    node, = launched('tracker.launch.py', respawn='true', state_file='/run/target.json')
    assert node.respawn and node.respawn_delay == 1.0
    assert values(node) == {'state_file': '/run/target.json'}
    path = tmp_path / 'targets.yaml'
    path.write_text('left: {respawn: true}\nright:\n')
    left, right = launched('multi.launch.py', targets=str(path))
    assert left.respawn and not right.respawn
    path.write_text('left: {respawn: often}')
    with pytest.raises(ValueError, match="left: respawn must be true or false, not 'often'"):
        launched('multi.launch.py', targets=str(path))


def test_launch_of_several_targets(launched, tmp_path):
    """Each has its namespace, and only the parameters and remaps of its own entry in the file."""
    path, mine = tmp_path / 'targets.yaml', tmp_path / 'mine.yaml'
    mine.touch()
    path.write_text(f"""
left:
  image: /camera
  params_file: {mine}
  parameters: {{init_box: [1, 2, 30, 40], gmpf: {{particles: 50}}}}
right:
  parameters: {{init_box: []}}
third:
""")
    left, right, third = launched('multi.launch.py', targets=str(path))
    assert (left.namespace, right.namespace, third.namespace) == ('left', 'right', 'third')
    assert left.parameters[0] == str(mine)
    assert values(left) == {'init_box': [1.0, 2.0, 30.0, 40.0], 'gmpf': {'particles': 50}}
    assert left.remappings == [('image', '/camera')]
    assert values(right) == values(third) == {}
    assert right.remappings == []
    path.write_text('left: {parameters: {init_box: [1, 2]}}')
    with pytest.raises(ValueError, match='targets.yaml: left: init_box has 2 values'):
        launched('multi.launch.py', targets=str(path))


@pytest.mark.parametrize('name', ['tracker.launch.py', 'multi.launch.py'])
def test_launch_sets_the_profile_unless_one_is_chosen(launched, monkeypatch, name):
    """Nodes get our profile; a user's own and a user's own transports stay in force."""
    given = {'targets': str(profile_path().with_name('targets.yaml'))} if 'multi' in name else {}
    for variable in (*VARIABLES, TRANSPORTS):
        monkeypatch.delenv(variable, raising=False)
    assert launched(name, **given)[0].additional_env == with_profile({})
    monkeypatch.setenv(VARIABLES[0], '/my/profile.xml')
    assert launched(name, **given)[0].additional_env == {VARIABLES[0]: '/my/profile.xml'}
    monkeypatch.delenv(VARIABLES[0])
    monkeypatch.setenv(TRANSPORTS, 'UDPv4')
    assert launched(name, **given)[0].additional_env == {}


@pytest.mark.parametrize('text, words', [
    ('left: /camera', "'left': .*image, .*not '/camera'"), ('7: {image: /camera}', '7: must be'),
    ('left: [image]', r"'left': .*not \['image'\]"),
    ('left: {image: 5}', 'left: image must be text, not 5'),
    ('left: {parameters: [1]}', r'left: parameters must be names with values, not \[1\]'),
    ('left: {parameters: {init_class: }}', 'left: init_class must be a number, .*, not None'),
    ('left: {parameters: {pf: {particles: 2026-01-01}}}', 'left: pf.particles must be .*2026'),
    ('left: {parameters: {pf: {1: 2}}}', 'left: pf.1 must be a name'),
    ('left: {parameters: {init_box: 0}}', 'left: init_box is 0; valid is')])
def test_launch_refuses_what_is_no_target(launched, tmp_path, text, words):
    """A wrong entry in the file of targets raises an error that names it and what is valid."""
    path = tmp_path / 'targets.yaml'
    path.write_text(text)
    with pytest.raises(ValueError, match=f'targets.yaml: {words}'):
        launched('multi.launch.py', targets=str(path))


def test_launch_refuses_a_file_that_is_not_there(launched, tmp_path):
    """A params_file that doesn't exist raises an error before a node runs without it."""
    with pytest.raises(FileNotFoundError, match='params_file nowhere.yaml does not exist'):
        launched('tracker.launch.py', params_file='nowhere.yaml')
    path = tmp_path / 'targets.yaml'
    path.write_text('left: {params_file: nowhere.yaml}')
    with pytest.raises(FileNotFoundError, match='left: params_file nowhere.yaml does not exist'):
        launched('multi.launch.py', targets=str(path))


@pytest.mark.parametrize('name', ['tracker.launch.py', 'multi.launch.py'])
def test_launch_finds_files_in_the_home_folder(launched, monkeypatch, tmp_path, name):
    """A shell leaves the ~ after := as it is."""
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / 'mine.yaml').touch()
    (tmp_path / 'targets.yaml').write_text('left: {params_file: ~/mine.yaml}')
    given = {'targets': '~/targets.yaml'} if 'multi' in name else {'params_file': '~/mine.yaml'}
    node, = launched(name, **given)
    assert node.parameters[0] == str(tmp_path / 'mine.yaml')


def test_compressed_images_beside_the_raw_ones():
    """A remap of image alone moves image/compressed as well."""
    with NodeProcess('-r', 'image:=/camera/image_raw', '-r', '__ns:=/arm',
                     image_transport='compressed') as process:
        process.wait_for_log('images are taken from /camera/image_raw/compressed')


def test_image_topic_is_that_of_the_transport():
    """With both image topics remapped to one, the node takes its transport's images from there."""
    remaps = ['-r', 'image:=/camera', '-r', 'image/compressed:=/camera']
    with NodeProcess(*remaps, image_transport='compressed') as process, (
            Client(publish=CompressedImage, topic='camera')) as client:
        process.wait_for_log('images are taken from /camera')
        client.until(client.images.get_subscription_count, 'takes no images')
        assert 'sends' not in process.log


def test_launch_files_depend_on_what_they_import(repository):
    """All that they import is in the standard library or a run-time dependency of the package."""
    root = ElementTree.parse(repository / 'package.xml').getroot()
    needed = {element.text for element in root.iter('exec_depend')}
    needed |= {'vtrack_ros', 'yaml' if 'python3-yaml' in needed else ''}
    for path in (repository / 'launch').glob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else (
                [node.module] if isinstance(node, ast.ImportFrom) else [])
            for name in names:
                package = name.split('.')[0]
                assert package in needed or package in sys.stdlib_module_names, (path, name)


def test_documentation_names_every_row(repository):
    """Every topic, service and parameter of the node is in its manual."""
    text = (repository / 'docs' / 'node.md').read_text()
    rows = ['image', 'image/compressed', 'camera_info', '~/init', '~/init_roi',
            '~/init_point', '~/init_detections', 'pose', 'pose_with_covariance', 'twist',
            'detections', 'bounding_box', '~/state', '~/particles', '~/debug_image',
            '/diagnostics', '~/reset', '~/enable', '~/reinit', '~/larger', '~/smaller',
            '/tf']
    for name in (*rows, INIT_BOX, *NODE_PARAMETERS):
        assert f'`{name}`' in text, name


def test_profile_is_found_and_not_forced_on_anybody():
    """A child process gets our profile unless another is set; the node gets a smaller one."""
    path = str(profile_path())
    assert with_profile({}) == dict.fromkeys(VARIABLES, path)
    chosen = {VARIABLES[0]: '/my/profile.xml'}
    assert with_profile(chosen) == chosen
    assert receiving_profile(chosen) == chosen and receiving_profile({}) == {}
    assert with_profile({TRANSPORTS: 'UDPv4'}) == {TRANSPORTS: 'UDPv4'}
    lighter = receiving_profile({VARIABLES[0]: path})[VARIABLES[0]]
    assert lighter.endswith('config/fastdds_node.xml')
    sizes = [int(re.search(r'<segment_size>(\d+)', open(file).read()).group(1))
             for file in (path, lighter)]
    assert sizes[1] < sizes[0]


@pytest.mark.parametrize('program', ['rviz', 'foxglove'])
@pytest.mark.parametrize('namespace, node', [
    ('/arm', 'left'), ('/tracker', 'tracker'), ('/tracker/pose', 'detections')])
def test_layouts_of_a_namespace(repository, capsys, program, namespace, node):
    """All topics but /diagnostics are in the given namespace; without one, the file is printed."""
    assert main(['layout', program, f'{namespace[1:]}/{node}']) == 0
    printed = capsys.readouterr().out
    layout = json.loads(printed) if program == 'foxglove' else yaml.safe_load(printed)
    text = json.dumps(layout)
    own = f'{namespace}/{node}'
    wanted = {'rviz': {f'{own}/debug_image', f'{namespace}/pose_with_covariance'},
              'foxglove': {f'{own}/debug_image', f'{own}/state', f'{namespace}/pose',
                           f'{namespace}/detections', '/diagnostics'}}
    assert set(re.findall(r'"(/[a-z_/]+)', text)) == wanted[program]
    assert main(['layout', program]) == 0
    name = {'rviz': 'vtrack.rviz', 'foxglove': 'vtrack.foxglove.json'}[program]
    assert capsys.readouterr().out == (repository / 'config' / name).read_text()
