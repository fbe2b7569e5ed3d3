"""
Launch one tracker.

    ros2 launch vtrack_ros tracker.launch.py image:=/camera/image_raw tracker:=gmpf

`ros2 launch vtrack_ros tracker.launch.py --show-args` lists the arguments.

"""

import os

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from vtrack_ros.dds import profile_variables
from vtrack_ros.ros.parameter_node import checked_init_box, INIT_BOX
import yaml

ARGUMENTS = {
    'tracker': ('', 'name of the tracker; empty: as params_file says, or gmpf'),
    'image': ('', 'topic of the images; for compressed ones, /compressed is appended unless it '
                  'is there; empty: image'),
    'camera_info': ('', 'topic of the calibration; empty: camera_info'),
    'image_transport': ('', 'raw or compressed; empty: as params_file says, or raw'),
    'init_box': ('', 'box of the target in the first image: "[x, y, width, height]" in pixels; '
                     'empty: wait for a selection'),
    'params_file': ('', 'YAML file with parameters, such as those in share/vtrack_ros/config'),
    'namespace': ('', 'namespace of the node and its topics'),
    'name': ('tracker', 'name of the node'),
    'managed': ('false', 'true: a lifecycle node, to be configured and activated'),
    'use_sim_time': ('', 'true: the time of /clock, as with ros2 bag play --clock; empty: as '
                         'params_file says, or false'),
    'state_file': ('', 'file in which the target is saved, so that a restarted node continues '
                       'with it; empty: as params_file says, or none'),
    'respawn': ('false', 'true: restart the node a second after it has ended by itself'),
    'fastdds_profile': ('true', 'true: enough shared memory for images (config/fastdds.xml), '
                        'unless the environment names another Fast DDS profile'),
    'log_level': ('info', 'debug, info, warn or error'),
}


def generate_launch_description():
    """Declare the arguments; the node is made from them."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context):
    """Return the node that the arguments describe."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    parameters = {name: given[name] for name in ('tracker', 'image_transport', 'state_file')
                  if given[name]}
    if given['use_sim_time']:
        parameters['use_sim_time'] = switch(given, 'use_sim_time')
    file = os.path.expanduser(given['params_file'])
    if file and not os.path.isfile(file):
        raise FileNotFoundError(f'params_file {file} does not exist')
    box = target(given['init_box'])
    if box is not None:
        parameters[INIT_BOX] = box.as_array().tolist()
    return [Node(
        package='vtrack_ros',
        executable='tracker_lifecycle' if switch(given, 'managed') else 'tracker',
        namespace=given['namespace'],
        name=given['name'],
        parameters=[*filter(None, [file, parameters])],
        remappings=[(name, given[name]) for name in ('image', 'camera_info') if given[name]],
        arguments=['--ros-args', '--log-level', given['log_level']],
        respawn=switch(given, 'respawn'),
        respawn_delay=1.0,
        additional_env=profile_variables(os.environ) if switch(given, 'fastdds_profile') else {},
        output='screen')]


def target(text):
    """Return the box that the argument init_box spells; None for an empty one."""
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        value = text
    return checked_init_box([] if value is None else value)


def switch(given, name):
    """Return the bool that an argument spells."""
    try:
        value = yaml.safe_load(given[name])
    except yaml.YAMLError:
        value = None
    if not isinstance(value, bool):
        raise ValueError(f'{name} must be true or false, not {given[name]!r}')
    return value
