# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A simulated camera, detector_node and pose_node, without hardware.

    ros2 launch p4pfr_ros demo.launch.py

A board other than the 9x6 chessboard: board_file:=/path/to/board.yaml
View in RViz: rviz:=true
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    """Describe the nodes and the board."""
    share = FindPackageShare('p4pfr_ros')
    chessboard = PathJoinSubstitution([share, 'config', 'boards', 'chessboard_9x6_25mm.yaml'])
    board = {'board_file': LaunchConfiguration('board_file')}
    rviz_config = PathJoinSubstitution([share, 'config', 'p4pfr.rviz'])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'board_file', default_value=chessboard, description='board YAML file'
            ),
            DeclareLaunchArgument(
                'rviz', default_value='false', description='whether to start RViz'
            ),
            Node(package='p4pfr_ros', executable='camera_simulator', parameters=[board]),
            Node(package='p4pfr_ros', executable='detector_node', parameters=[board]),
            Node(package='p4pfr_ros', executable='pose_node', parameters=[board]),
            Node(
                package='rviz2',
                executable='rviz2',
                arguments=['-d', rviz_config],
                condition=IfCondition(LaunchConfiguration('rviz')),
            ),
        ]
    )
