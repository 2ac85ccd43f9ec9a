# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Launch files: what they would start, with a stand-in for the `launch` that starts it."""

from pathlib import Path

from launch_stand_in import Run, SHARE
from p4pfr_ros.ros.parameters.declare import flattened, replaced
from p4pfr_ros.ros.parameters.image_node_options import (
    CameraSimulatorOptions,
    DetectorNodeOptions,
    PoseNodeOptions,
)
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
NEEDED = {
    'demo.launch.py': {},
    'p4pfr.launch.py': {'board_file': 'b.yaml'},
    'multi_camera.launch.py': {'board_file': 'b.yaml', 'cameras': 'left,right'},
}


def run(name, **arguments):
    """Return what a launch file starts."""
    return Run(ROOT / 'launch' / name, ROOT, **NEEDED[name], **arguments).nodes


def one(nodes, executable):
    (node,) = (n for n in nodes if n.executable == executable)
    return node


def given(node):
    """Return the parameters that a node is told one by one."""
    return node.parameters[-1]


def test_there_are_launch_files():
    """The next test has something to look at."""
    assert {path.name for path in FILES} == set(NEEDED)


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_a_launch_file_names_what_there_is(path):
    """Its nodes have launchers, and their parameters exist and take these values."""
    nodes = run(path.name, publish_tf='true') if 'demo' not in path.name else run(path.name)
    assert len(nodes) >= 2
    for node in nodes:
        assert node.package == 'p4pfr_ros'
        assert (ROOT / 'scripts' / node.executable).exists()
        options = OPTIONS[node.executable]
        types = {name: type(value) for name, value, _ in flattened(options)}
        assert {name: type(value) for name, value in given(node).items()}.items() <= types.items()
        replaced(options, given(node))


@pytest.mark.parametrize('name', NEEDED)
def test_what_a_launch_file_needs_it_asks_for(name):
    """An argument without a default has to be given."""
    for argument in NEEDED[name]:
        others = {k: v for k, v in NEEDED[name].items() if k != argument}
        with pytest.raises(AssertionError, match=f'{argument} is missing'):
            Run(ROOT / 'launch' / name, ROOT, **others)


def test_the_demo_has_a_board_of_its_own():
    """All three are told of the same, and its file is installed with the others."""
    boards = {given(node)['board_file'] for node in run('demo.launch.py')}
    (board,) = boards
    assert (ROOT / board.removeprefix(f'{SHARE}/p4pfr_ros/')).exists()


@pytest.mark.parametrize('name', [*NEEDED, 'p4pfr.rviz', 'p4pfr_foxglove.json'])
def test_people_are_told_of_what_there_is(name):
    """A launch file, or a view, that no page names is found by nobody."""
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


def test_a_file_of_parameters_is_not_contradicted():
    """What the arguments do not say is left to it, and without one none is named."""
    nodes = run('p4pfr.launch.py', params_file='p.yaml')
    assert all(node.parameters[0] == 'p.yaml' for node in nodes)
    assert all(set(given(node)) == {'board_file'} for node in nodes)
    for node in run('multi_camera.launch.py', params_file='p.yaml'):
        ours = {'board_frame', 'camera_name', 'publish_tf'}
        told = ours if node.executable == 'pose_node' else set()
        assert set(given(node)) == {'board_file', *told}
    assert all(len(node.parameters) == 1 for node in run('p4pfr.launch.py'))
    told = given(one(run('p4pfr.launch.py', board_frame='b', publish_tf='true'), 'pose_node'))
    assert told == {'board_file': 'b.yaml', 'board_frame': 'b', 'publish_tf': True}
    told = given(one(run('p4pfr.launch.py', transport='compressed'), 'detector_node'))
    assert told == {'board_file': 'b.yaml', 'image.transport': 'compressed'}


@pytest.mark.parametrize('namespace', ['/', '/left/front'])
@pytest.mark.parametrize('name', ['pose_node', 'detector_node', 'camera_simulator'])
def test_a_file_of_parameters_for_all_is_read_by_each_as_its_own(name, namespace):
    """Below /**/NODE, whatever the namespace; of the others' parameters it hears nothing."""
    context, arguments = rclpy.Context(), ['--ros-args', '-r', f'__ns:={namespace}']
    for path in sorted((ROOT / 'config').glob('*.yaml')):
        arguments += ['--params-file', str(path)]
    rclpy.init(args=arguments, context=context)
    node = Node(name, context=context)
    names = {name for name, _, _ in flattened(OPTIONS[name])}
    assert set(node._parameter_overrides) == names
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_a_lifecycle_comes_on_request():
    """The other launcher, but the same name: topics and the file of parameters stay."""
    plain, managed = (
        run('p4pfr.launch.py', lifecycle=lifecycle)[1] for lifecycle in ('false', 'true')
    )
    assert plain.executable == 'pose_node'
    assert managed.executable == 'lifecycle_pose_node'
    assert (ROOT / 'scripts' / managed.executable).exists()
    assert plain.name == managed.name == 'pose_node'
    assert given(plain) == given(managed)


@pytest.mark.parametrize('name', ['p4pfr.launch.py', 'demo.launch.py'])
def test_rviz_comes_on_request(name):
    """With our view, in the nodes' namespace."""
    assert 'rviz2' not in {node.executable for node in run(name)}
    rviz = one(run(name, rviz='true'), 'rviz2')
    assert rviz.package == 'rviz2'
    view = rviz.arguments[rviz.arguments.index('-d') + 1]
    assert (ROOT / view.removeprefix(f'{SHARE}/p4pfr_ros/')).exists()


def test_rviz_looks_from_the_camera():
    nodes = run('p4pfr.launch.py', rviz='true', camera_frame='front', namespace='a')
    rviz = one(nodes, 'rviz2')
    assert rviz.namespace == 'a'
    assert rviz.arguments[-2:] == ['-f', 'front']


def test_each_camera_has_nodes_and_names_of_its_own():
    """No two publish the same frame, or save to the same file."""
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
