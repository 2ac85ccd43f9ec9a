# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Several cameras that look for the same board, each with its own nodes in its own namespace.

    ros2 launch p4pfr_ros multi_camera.launch.py cameras:=left,right \
        board_file:=/path/to/board.yaml

The pictures of the camera left come from /left/image_raw, its poses are on /left/pose_node/pose,
and to it the board's frame is left/board: in /tf a frame has one parent, so what two cameras see
are two frames, even if it is one board.

In params_file, what all cameras have in common stands below /**/pose_node: and /**/detector_node:,
and after it what is of one alone below /left/pose_node: and such; the later one counts.
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

# Handed on to p4pfr.launch.py as they are. The topics are relative: in each camera's namespace.
ARGUMENTS = (
    ('params_file', '', 'YAML file of parameters for all nodes, below /**/pose_node: and such'),
    ('image', 'image_raw', 'topic of the pictures, in the namespace of each camera'),
    ('camera_info', 'camera_info', 'topic that tells the size of the pictures, likewise'),
    ('transport', '', 'raw, or compressed: IMAGE/compressed'),
    ('publish_tf', 'true', 'whether poses are on /tf too, whatever the file says'),
)


def generate_launch_description():
    """Describe the arguments, and the nodes of each camera."""
    declared = [
        DeclareLaunchArgument('cameras', description='names of the cameras: left,right'),
        DeclareLaunchArgument('board_file', description='YAML file of the board'),
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
    one = PathJoinSubstitution([FindPackageShare('p4pfr_ros'), 'launch', 'p4pfr.launch.py'])
    told = {
        'namespace': name,
        'camera_name': name,
        'board_frame': f'{name}/board',
        'board_file': LaunchConfiguration('board_file'),
        'rviz': 'false',
        'lifecycle': 'false',
        **{argument: LaunchConfiguration(argument) for argument, _, _ in ARGUMENTS},
    }
    source = PythonLaunchDescriptionSource(one)
    # The group keeps what one camera is told from the next.
    return GroupAction([IncludeLaunchDescription(source, launch_arguments=told.items())])
