# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
apriltag_ros detects, pose_node estimates.

    ros2 launch examples/apriltag_topics.launch.py board_file:=/path/to/tag.yaml \
        image:=/camera/image_raw camera_info:=/camera/camera_info

Needs the packages apriltag_ros and apriltag_msgs. apriltag_ros searches the *raw* image here, on
its topic image_rect, and wants a camera_info with the same stamps, whatever it contains. Its own
poses on /tf, which would need a calibration, are remapped away.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = (
    ('image', '/camera/image_raw', 'raw image'),
    ('camera_info', '/camera/camera_info', 'camera_info of the image; its K may be 0'),
    ('family', '36h11', 'family of the tags'),
)


def generate_launch_description():
    """Describe both nodes."""
    camera_info = ('camera_info', LaunchConfiguration('camera_info'))
    return LaunchDescription(
        [
            DeclareLaunchArgument('board_file', description='board file with the tags'),
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, default, text in ARGUMENTS
            ),
            Node(
                package='apriltag_ros',
                executable='apriltag_node',
                parameters=[{'family': LaunchConfiguration('family')}],
                remappings=[
                    ('image_rect', LaunchConfiguration('image')),
                    camera_info,
                    ('/tf', '/apriltag/tf_unused'),
                ],
            ),
            Node(
                package='p4pfr_ros',
                executable='pose_node',
                parameters=[{'board_file': LaunchConfiguration('board_file')}],
                remappings=[camera_info],
            ),
        ]
    )
