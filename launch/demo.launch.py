# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A simulated camera, detector_node and pose_node: everything without hardware.

    ros2 launch p4pfr_ros demo.launch.py

Another board than the chessboard of 9 by 6 corners: board_file:=/path/to/board.yaml
To see it in RViz: rviz:=true
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    """Describe the nodes, and which board they look at."""
    share = FindPackageShare('p4pfr_ros')
    chessboard = PathJoinSubstitution([share, 'config', 'boards', 'chessboard_9x6_25mm.yaml'])
    board = {'board_file': LaunchConfiguration('board_file')}
    view = PathJoinSubstitution([share, 'config', 'p4pfr.rviz'])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'board_file', default_value=chessboard, description='YAML file of the board'
            ),
            DeclareLaunchArgument(
                'rviz', default_value='false', description='whether RViz is started'
            ),
            Node(package='p4pfr_ros', executable='camera_simulator', parameters=[board]),
            Node(package='p4pfr_ros', executable='detector_node', parameters=[board]),
            Node(package='p4pfr_ros', executable='pose_node', parameters=[board]),
            Node(
                package='rviz2',
                executable='rviz2',
                arguments=['-d', view],
                condition=IfCondition(LaunchConfiguration('rviz')),
            ),
        ]
    )
