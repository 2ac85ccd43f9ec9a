# SPDX-License-Identifier: Apache-2.0
"""
detector_node and pose_node behind a camera.

    ros2 launch p4pfr_ros p4pfr.launch.py board_file:=/path/to/board.yaml \
        image:=/camera/image_raw camera_info:=/camera/camera_info

All other parameters of both nodes may come from a file, each below its node's name:
params_file:=/path/to/parameters.yaml

The poses are on pose_node/pose, in the frame of the pictures.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    """Describe the two nodes and what they are told."""
    arguments = [
        DeclareLaunchArgument('board_file', description='YAML file of the board'),
        DeclareLaunchArgument(
            'params_file', default_value='', description='YAML file of parameters for both nodes'
        ),
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
    return LaunchDescription([*arguments, OpaqueFunction(function=_nodes)])


def _nodes(context):
    # Without such a file a node must not be told of one.
    params_file = LaunchConfiguration('params_file').perform(context)
    given = [params_file] if params_file else []
    detector = Node(
        package='p4pfr_ros',
        executable='detector_node',
        namespace=LaunchConfiguration('namespace'),
        parameters=[
            *given,
            {
                'board_file': LaunchConfiguration('board_file'),
                'image.transport': LaunchConfiguration('transport'),
            },
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
        parameters=given,
        remappings=[('camera_info', LaunchConfiguration('camera_info'))],
    )
    return [detector, pose]
