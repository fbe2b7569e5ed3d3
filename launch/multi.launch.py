"""
Launch several trackers, one per namespace, from a YAML file that describes them.

    ros2 launch vtrack_ros multi.launch.py targets:=targets.yaml

config/targets.yaml is an example.

"""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from vtrack_ros.dds import profile_variables
from vtrack_ros.ros.parameter_node import checked_init_box, INIT_BOX
import yaml

#: Valid keys of a target's entry in the file, with the types of their values.
KEYS = {'image': str, 'camera_info': str, 'params_file': str, 'parameters': dict, 'respawn': bool}
#: The types in words.
WORDS = {str: 'text', dict: 'names with values', bool: 'true or false'}


def generate_launch_description():
    """Declare the argument; the nodes are made from the file that it names."""
    share = get_package_share_directory('vtrack_ros')
    example = os.path.join(share, 'config', 'targets.yaml')
    return LaunchDescription([
        DeclareLaunchArgument(
            'targets', default_value=example,
            description='YAML file: namespace -> ' + ', '.join(KEYS)),
        OpaqueFunction(function=nodes)])


def nodes(context):
    """Return a node for every target of the file."""
    path = os.path.expanduser(LaunchConfiguration('targets').perform(context))
    with open(path) as file:
        targets = yaml.safe_load(file)
    if not isinstance(targets, dict) or not targets:
        raise ValueError(f'{path} must map namespaces to targets')
    return [node(path, namespace, target or {}) for namespace, target in targets.items()]


def node(path, namespace, target):
    """Return the node that follows a target."""
    if not (isinstance(namespace, str) and isinstance(target, dict)):
        raise ValueError(f'{path}: {namespace!r}: must be a namespace with values for '
                         f'{", ".join(KEYS)}, not {target!r}')
    unknown = set(target) - set(KEYS)
    if unknown:
        raise ValueError(f'{path}: {namespace}: unknown {", ".join(sorted(unknown))}; valid are '
                         + ', '.join(KEYS))
    for key, value in target.items():
        if value is not None and not isinstance(value, KEYS[key]):
            raise ValueError(
                f'{path}: {namespace}: {key} must be {WORDS[KEYS[key]]}, not {value!r}')
    file = os.path.expanduser(target.get('params_file') or '')
    if file and not os.path.isfile(file):
        raise FileNotFoundError(f'{path}: {namespace}: params_file {file} does not exist')
    parameters = dict(target.get('parameters') or {})
    # An empty init_box is left out, because launch has no type for an empty list.
    try:
        value = parameters.pop(INIT_BOX, None)
        box = checked_init_box([] if value is None else value)
        check(parameters)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{path}: {namespace}: {error}') from None
    if box is not None:
        parameters[INIT_BOX] = box.as_array().tolist()
    return Node(
        package='vtrack_ros', executable='tracker', name='tracker', namespace=namespace,
        parameters=[*filter(None, [file, parameters])],
        remappings=[(name, target[name]) for name in ('image', 'camera_info')
                    if target.get(name)],
        respawn=bool(target.get('respawn')), respawn_delay=1.0,
        additional_env=profile_variables(os.environ),
        output='screen')


def check(parameters, prefix=''):
    """Raise ValueError at what launch would refuse without saying where it is."""
    for name, value in parameters.items():
        if not isinstance(name, str):
            raise ValueError(f'{prefix}{name!r} must be a name')
        if isinstance(value, dict):
            check(value, f'{prefix}{name}.')
        elif not isinstance(value, (bool, int, float, str, list)):
            raise ValueError(f'{prefix}{name} must be a number, text, true or false, '
                             f'not {value}')
