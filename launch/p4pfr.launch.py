# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
detector_node and pose_node behind a camera, and RViz where it is wanted.

    ros2 launch p4pfr_ros p4pfr.launch.py board_file:=/path/to/board.yaml \
        image:=/camera/image_raw camera_info:=/camera/camera_info

All other parameters of both nodes may come from a file: params_file:=/path/to/parameters.yaml
There they stand below /**/pose_node: and /**/detector_node: (a plain pose_node: is the node
without a namespace, and /**: is both nodes). An argument that is given counts, not the file.

The poses are on pose_node/pose, in the frame of the pictures; with publish_tf:=true on /tf too.
rviz:=true camera_frame:=FRAME shows them, FRAME being the one that the pictures are in.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = (
    ('params_file', '', 'YAML file of parameters for both nodes'),
    ('namespace', '', 'of all nodes'),
    ('image', 'image', 'topic of the pictures'),
    ('camera_info', 'camera_info', 'topic that tells the size of the pictures; its K may be 0'),
    ('lifecycle', 'false', 'whether pose_node waits for `ros2 lifecycle` to start it'),
    ('rviz', 'false', 'whether RViz is started'),
    ('camera_frame', 'camera_optical_frame', 'frame of the pictures, from which RViz looks'),
)

# Arguments that are parameters: (argument, parameter, type, what). Without them, the file tells.
DETECTOR_PARAMETERS = (
    ('transport', 'image.transport', str, 'raw, or compressed: IMAGE/compressed'),
)
POSE_PARAMETERS = (
    ('board_frame', 'board_frame', str, "the board's frame"),
    ('camera_name', 'camera_name', str, "the camera's name in the file of its calibration"),
    ('publish_tf', 'publish_tf', bool, 'whether poses are on /tf too'),
)


def generate_launch_description():
    """Describe the nodes and what they are told."""
    board_file = DeclareLaunchArgument('board_file', description='YAML file of the board')
    parameters = (*DETECTOR_PARAMETERS, *POSE_PARAMETERS)
    others = [*ARGUMENTS, *((name, '', text) for name, _, _, text in parameters)]
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in others
    ]
    return LaunchDescription([board_file, *declared, OpaqueFunction(function=_nodes), _rviz()])


def _nodes(context):
    # Without such a file a node must not be told of one.
    params_file = LaunchConfiguration('params_file').perform(context)
    given = [params_file] if params_file else []
    board_file = {'board_file': LaunchConfiguration('board_file')}
    detector = Node(
        package='p4pfr_ros',
        executable='detector_node',
        namespace=LaunchConfiguration('namespace'),
        parameters=[*given, {**board_file, **_told(context, DETECTOR_PARAMETERS)}],
        remappings=[
            ('image', LaunchConfiguration('image')),
            ('image/compressed', [LaunchConfiguration('image'), '/compressed']),
        ],
    )
    managed = IfCondition(LaunchConfiguration('lifecycle')).evaluate(context)
    pose = Node(
        package='p4pfr_ros',
        executable='lifecycle_pose_node' if managed else 'pose_node',
        name='pose_node',
        namespace=LaunchConfiguration('namespace'),
        parameters=[*given, {**board_file, **_told(context, POSE_PARAMETERS)}],
        remappings=[('camera_info', LaunchConfiguration('camera_info'))],
    )
    return [detector, pose]


def _told(context, parameters):
    """Return those of the parameters that are told by arguments."""
    return {
        name: ParameterValue(LaunchConfiguration(argument), value_type=kind)
        for argument, name, kind, _ in parameters
        if LaunchConfiguration(argument).perform(context)
    }


def _rviz():
    config = PathJoinSubstitution([FindPackageShare('p4pfr_ros'), 'config', 'p4pfr.rviz'])
    return Node(
        package='rviz2',
        executable='rviz2',
        namespace=LaunchConfiguration('namespace'),
        arguments=['-d', config, '-f', LaunchConfiguration('camera_frame')],
        condition=IfCondition(LaunchConfiguration('rviz')),
    )
