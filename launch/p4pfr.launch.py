# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
detector_node and pose_node for a camera, with RViz on request.

    ros2 launch p4pfr_ros p4pfr.launch.py board_file:=/path/to/board.yaml \
        image:=/camera/image_raw camera_info:=/camera/camera_info

All other parameters of both nodes come from a file: params_file:=/path/to/parameters.yaml
Its keys are /**/pose_node: and /**/detector_node: (pose_node: alone is the node without a
namespace, /**: is both nodes). Arguments override the file.

Poses are published on pose_node/pose in the frame of the images; with publish_tf:=true also on
/tf. rviz:=true camera_frame:=FRAME shows them, where FRAME is the frame of the images.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = (
    ('params_file', '', 'YAML file with parameters of both nodes'),
    ('namespace', '', 'namespace of all nodes'),
    ('image', 'image', 'image topic'),
    ('camera_info', 'camera_info', 'topic with the image size; its K may be 0'),
    ('lifecycle', 'false', 'whether pose_node is a managed node (lifecycle_pose_node)'),
    ('rviz', 'false', 'whether to start RViz'),
    ('camera_frame', 'camera_optical_frame', 'frame of the images, the fixed frame of RViz'),
)

# Arguments that set parameters: (argument, parameter, type, description). Empty: not set.
DETECTOR_PARAMETERS = (
    ('transport', 'image.transport', str, 'raw, or compressed for the topic IMAGE/compressed'),
)
POSE_PARAMETERS = (
    ('board_frame', 'board_frame', str, 'frame of the board'),
    ('camera_name', 'camera_name', str, 'name of the camera in the calibration file'),
    ('publish_tf', 'publish_tf', bool, 'whether poses are also published on /tf'),
)


def generate_launch_description():
    """Describe the arguments and the nodes."""
    board_file = DeclareLaunchArgument('board_file', description='board YAML file')
    parameters = (*DETECTOR_PARAMETERS, *POSE_PARAMETERS)
    others = [*ARGUMENTS, *((name, '', text) for name, _, _, text in parameters)]
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in others
    ]
    return LaunchDescription([board_file, *declared, OpaqueFunction(function=_nodes), _rviz()])


def _nodes(context):
    # An empty path would be an error.
    params_file = LaunchConfiguration('params_file').perform(context)
    given = [params_file] if params_file else []
    board_file = {'board_file': LaunchConfiguration('board_file')}
    detector = Node(
        package='p4pfr_ros',
        executable='detector_node',
        namespace=LaunchConfiguration('namespace'),
        parameters=[*given, {**board_file, **_given(context, DETECTOR_PARAMETERS)}],
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
        parameters=[*given, {**board_file, **_given(context, POSE_PARAMETERS)}],
        remappings=[('camera_info', LaunchConfiguration('camera_info'))],
    )
    return [detector, pose]


def _given(context, parameters):
    """Return the parameters that are set by arguments."""
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
