# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Launch files: the nodes that they start, with a replacement for `launch`."""

from pathlib import Path

from launch_stand_in import Run, SHARE
from p4pfr_ros.ros.parameters.declare import flattened, replaced
from p4pfr_ros.ros.parameters.image_node_options import CameraSimulatorOptions, DetectorNodeOptions
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
import pytest
import rclpy
from rclpy.node import Node

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = {
    'pose_node': PoseNodeOptions(),
    'lifecycle_pose_node': PoseNodeOptions(),
    'detector_node': DetectorNodeOptions(),
    'camera_simulator': CameraSimulatorOptions(),
}
FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
REQUIRED = {
    'demo.launch.py': {},
    'p4pfr.launch.py': {'board_file': 'b.yaml'},
    'multi_camera.launch.py': {'board_file': 'b.yaml', 'cameras': 'left,right'},
}


def run(name, **arguments):
    """Return the nodes that a launch file starts."""
    return Run(ROOT / 'launch' / name, ROOT, **REQUIRED[name], **arguments).nodes


def one(nodes, executable):
    (node,) = (n for n in nodes if n.executable == executable)
    return node


def given(node):
    """Return the parameters of a node, except those of files."""
    return node.parameters[-1]


def test_there_are_launch_files():
    """All of them are tested."""
    assert {path.name for path in FILES} == set(REQUIRED)


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_nodes_and_parameters_of_launch_files_exist(path):
    """The values of the parameters are valid."""
    nodes = run(path.name, publish_tf='true') if 'demo' not in path.name else run(path.name)
    assert len(nodes) >= 2
    for node in nodes:
        assert node.package == 'p4pfr_ros'
        assert (ROOT / 'scripts' / node.executable).exists()
        options = OPTIONS[node.executable]
        types = {name: type(value) for name, value, _ in flattened(options)}
        assert {name: type(value) for name, value in given(node).items()}.items() <= types.items()
        replaced(options, given(node))


@pytest.mark.parametrize('name', REQUIRED)
def test_required_arguments_have_no_default(name):
    """They must be given."""
    for argument in REQUIRED[name]:
        others = {k: v for k, v in REQUIRED[name].items() if k != argument}
        with pytest.raises(AssertionError, match=f'{argument} is missing'):
            Run(ROOT / 'launch' / name, ROOT, **others)


def test_the_demo_has_a_default_board():
    """The same for all three nodes; its file is installed."""
    boards = {given(node)['board_file'] for node in run('demo.launch.py')}
    (board,) = boards
    assert (ROOT / board.removeprefix(f'{SHARE}/p4pfr_ros/')).exists()


@pytest.mark.parametrize('name', [*REQUIRED, 'p4pfr.rviz', 'p4pfr_foxglove.json'])
def test_launch_files_and_layouts_are_documented(name):
    """In the README or on a page."""
    pages = [ROOT / 'README.md', *(ROOT / 'docs').glob('*.md')]
    assert any(name in page.read_text() for page in pages)


def test_topics_and_namespace_are_the_cameras():
    nodes = run('p4pfr.launch.py', image='/a/image_raw', camera_info='/a/info', namespace='a')
    detector, pose = one(nodes, 'detector_node'), one(nodes, 'pose_node')
    assert detector.remappings == [
        ('image', '/a/image_raw'),
        ('image/compressed', '/a/image_raw/compressed'),
    ]
    assert pose.remappings == [('camera_info', '/a/info')]
    assert detector.namespace == pose.namespace == 'a'
    assert given(detector)['board_file'] == given(pose)['board_file'] == 'b.yaml'


def test_arguments_that_are_not_given_do_not_override_the_parameter_file():
    """Without a parameter file none is passed."""
    nodes = run('p4pfr.launch.py', params_file='p.yaml')
    assert all(node.parameters[0] == 'p.yaml' for node in nodes)
    assert all(set(given(node)) == {'board_file'} for node in nodes)
    for node in run('multi_camera.launch.py', params_file='p.yaml'):
        ours = {'board_frame', 'camera_name', 'publish_tf'}
        expected = ours if node.executable == 'pose_node' else set()
        assert set(given(node)) == {'board_file', *expected}
    assert all(len(node.parameters) == 1 for node in run('p4pfr.launch.py'))
    parameters = given(
        one(run('p4pfr.launch.py', board_frame='b', publish_tf='true'), 'pose_node')
    )
    assert parameters == {'board_file': 'b.yaml', 'board_frame': 'b', 'publish_tf': True}
    parameters = given(one(run('p4pfr.launch.py', transport='compressed'), 'detector_node'))
    assert parameters == {'board_file': 'b.yaml', 'image.transport': 'compressed'}


@pytest.mark.parametrize('namespace', ['/', '/left/front'])
@pytest.mark.parametrize('name', ['pose_node', 'detector_node', 'camera_simulator'])
def test_each_node_reads_its_own_parameters_from_the_config_files(name, namespace):
    """Below /**/NODE, in any namespace; it does not get those of other nodes."""
    context, arguments = rclpy.Context(), ['--ros-args', '-r', f'__ns:={namespace}']
    for path in sorted((ROOT / 'config').glob('*.yaml')):
        arguments += ['--params-file', str(path)]
    rclpy.init(args=arguments, context=context)
    node = Node(name, context=context)
    names = {name for name, _, _ in flattened(OPTIONS[name])}
    assert set(node._parameter_overrides) == names
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_a_managed_node_is_optional():
    """Another executable with the same node name, so that topics and parameters stay."""
    plain, managed = (
        run('p4pfr.launch.py', lifecycle=lifecycle)[1] for lifecycle in ('false', 'true')
    )
    assert plain.executable == 'pose_node'
    assert managed.executable == 'lifecycle_pose_node'
    assert (ROOT / 'scripts' / managed.executable).exists()
    assert plain.name == managed.name == 'pose_node'
    assert given(plain) == given(managed)


@pytest.mark.parametrize('name', ['p4pfr.launch.py', 'demo.launch.py'])
def test_rviz_is_optional(name):
    """With our configuration."""
    assert 'rviz2' not in {node.executable for node in run(name)}
    rviz = one(run(name, rviz='true'), 'rviz2')
    assert rviz.package == 'rviz2'
    config = rviz.arguments[rviz.arguments.index('-d') + 1]
    assert (ROOT / config.removeprefix(f'{SHARE}/p4pfr_ros/')).exists()


def test_the_fixed_frame_of_rviz_is_the_camera_frame():
    nodes = run('p4pfr.launch.py', rviz='true', camera_frame='front', namespace='a')
    rviz = one(nodes, 'rviz2')
    assert rviz.namespace == 'a'
    assert rviz.arguments[-2:] == ['-f', 'front']


def test_each_camera_has_its_own_nodes_and_names():
    """Its own board frame and calibration file."""
    nodes = run('multi_camera.launch.py')
    assert [(node.namespace, node.executable) for node in nodes] == [
        ('left', 'detector_node'),
        ('left', 'pose_node'),
        ('right', 'detector_node'),
        ('right', 'pose_node'),
    ]
    assert [given(node) for node in nodes if node.executable == 'pose_node'] == [
        {
            'board_file': 'b.yaml',
            'board_frame': f'{name}/board',
            'camera_name': name,
            'publish_tf': True,
        }
        for name in ('left', 'right')
    ]
    assert {node.remappings[0] for node in nodes} == {
        ('image', 'image_raw'),
        ('camera_info', 'camera_info'),
    }
