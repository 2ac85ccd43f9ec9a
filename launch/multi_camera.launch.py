# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Several cameras that detect the same board, each with its own nodes in its own namespace.

    ros2 launch p4pfr_ros multi_camera.launch.py cameras:=left,right \
        board_file:=/path/to/board.yaml

The camera left subscribes to /left/image_raw, publishes poses on /left/pose_node/pose and uses the
board frame left/board: a frame in /tf has one parent, so each camera needs its own board frame.

In params_file, parameters of all cameras go below /**/pose_node: and /**/detector_node:, followed
by those of one camera below /left/pose_node: etc.; the later value applies.
"""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

# Passed to p4pfr.launch.py. The topics are relative to the namespace of each camera.
ARGUMENTS = (
    ('params_file', '', 'YAML file with parameters of all nodes, below /**/pose_node: etc.'),
    ('image', 'image_raw', 'image topic in the namespace of each camera'),
    ('camera_info', 'camera_info', 'topic with the image size, likewise'),
    ('transport', '', 'raw, or compressed for the topic IMAGE/compressed'),
    ('publish_tf', 'true', 'whether poses are also published on /tf; overrides the file'),
)


def generate_launch_description():
    """Describe the arguments and the nodes of each camera."""
    declared = [
        DeclareLaunchArgument('cameras', description='names of the cameras, such as left,right'),
        DeclareLaunchArgument('board_file', description='board YAML file'),
        *(
            DeclareLaunchArgument(name, default_value=default, description=text)
            for name, default, text in ARGUMENTS
        ),
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_cameras)])


def _cameras(context):
    names = LaunchConfiguration('cameras').perform(context).replace(',', ' ').split()
    return [_camera(name) for name in names]


def _camera(name):
    share = FindPackageShare('p4pfr_ros')
    launch_file = PathJoinSubstitution([share, 'launch', 'p4pfr.launch.py'])
    arguments = {
        'namespace': name,
        'camera_name': name,
        'board_frame': f'{name}/board',
        'board_file': LaunchConfiguration('board_file'),
        'rviz': 'false',
        'lifecycle': 'false',
        **{name: LaunchConfiguration(name) for name, _, _ in ARGUMENTS},
    }
    source = PythonLaunchDescriptionSource(launch_file)
    # The group limits the scope of the arguments to one camera.
    return GroupAction([IncludeLaunchDescription(source, launch_arguments=arguments.items())])
