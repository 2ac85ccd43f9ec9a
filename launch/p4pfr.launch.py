# SPDX-License-Identifier: Apache-2.0
"""
detector_node and pose_node behind a camera.

    ros2 launch p4pfr_ros p4pfr.launch.py board_file:=/path/to/board.yaml \
        image:=/camera/image_raw camera_info:=/camera/camera_info

The poses are on pose_node/pose, in the frame of the pictures.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    """Describe the two nodes and what they are told."""
    arguments = [
        DeclareLaunchArgument('board_file', description='YAML file of the board'),
        DeclareLaunchArgument('namespace', default_value='', description='of both nodes'),
        DeclareLaunchArgument('image', default_value='image', description='topic of the pictures'),
        DeclareLaunchArgument(
            'camera_info',
            default_value='camera_info',
            description='topic that tells the size of the pictures; its K may be 0',
        ),
        DeclareLaunchArgument(
            'transport', default_value='raw', description='raw, or compressed: IMAGE/compressed'
        ),
    ]
    detector = Node(
        package='p4pfr_ros',
        executable='detector_node',
        namespace=LaunchConfiguration('namespace'),
        parameters=[
            {
                'board_file': LaunchConfiguration('board_file'),
                'image.transport': LaunchConfiguration('transport'),
            }
        ],
        remappings=[
            ('image', LaunchConfiguration('image')),
            ('image/compressed', [LaunchConfiguration('image'), '/compressed']),
        ],
    )
    pose = Node(
        package='p4pfr_ros',
        executable='pose_node',
        namespace=LaunchConfiguration('namespace'),
        remappings=[('camera_info', LaunchConfiguration('camera_info'))],
    )
    return LaunchDescription([*arguments, detector, pose])
