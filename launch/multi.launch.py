"""
Launch several trackers, one a namespace, as one YAML file describes them.

    ros2 launch vtrack_ros multi.launch.py targets:=targets.yaml

config/targets.yaml is an example.

"""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
import yaml

#: What a target may say of itself.
KEYS = ('image', 'camera_info', 'params_file', 'parameters')


def generate_launch_description():
    """Declare the argument; the nodes follow from the file that it names."""
    share = get_package_share_directory('vtrack_ros')
    example = os.path.join(share, 'config', 'targets.yaml')
    return LaunchDescription([
        DeclareLaunchArgument(
            'targets', default_value=example,
            description='YAML file: namespace -> ' + ', '.join(KEYS)),
        OpaqueFunction(function=nodes)])


def nodes(context):
    """Return a node for every target of the file."""
    path = LaunchConfiguration('targets').perform(context)
    with open(path) as file:
        targets = yaml.safe_load(file)
    if not isinstance(targets, dict) or not targets:
        raise ValueError(f'{path} must map namespaces to targets')
    return [node(path, namespace, target or {}) for namespace, target in targets.items()]


def node(path, namespace, target):
    """Return the node that follows a target."""
    unknown = set(target) - set(KEYS)
    if unknown:
        raise ValueError(f'{path}: {namespace}: unknown {", ".join(sorted(unknown))}; valid are '
                         + ', '.join(KEYS))
    parameters = dict(target.get('parameters') or {})
    if parameters.get('init_box'):
        parameters['init_box'] = [float(value) for value in parameters['init_box']]
    elif 'init_box' in parameters:
        # Nothing is nothing: launch has no type for an empty list.
        del parameters['init_box']
    compressed = parameters.get('image_transport') == 'compressed'
    profile = os.path.join(get_package_share_directory('vtrack_ros'), 'config', 'fastdds.xml')
    return Node(
        package='vtrack_ros', executable='tracker', name='tracker', namespace=namespace,
        parameters=[*filter(None, [target.get('params_file')]), parameters],
        remappings=[
            ('image/compressed' if compressed else 'image', target.get('image', 'image')),
            ('camera_info', target.get('camera_info', 'camera_info'))],
        additional_env={'FASTRTPS_DEFAULT_PROFILES_FILE': profile,
                        'FASTDDS_DEFAULT_PROFILES_FILE': profile},
        output='screen')
