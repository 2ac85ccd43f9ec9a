# SPDX-License-Identifier: Apache-2.0
"""Launch files, read as text: `launch` itself is not on every machine that tests this."""

import ast
from pathlib import Path

from p4pfr_ros.ros.options import CameraSimulatorOptions, DetectorNodeOptions, PoseNodeOptions
from p4pfr_ros.ros.parameters import flattened
import pytest

ROOT = Path(__file__).resolve().parents[2]
NODES = {
    'pose_node': PoseNodeOptions(),
    'detector_node': DetectorNodeOptions(),
    'camera_simulator': CameraSimulatorOptions(),
}
FILES = sorted((ROOT / 'launch').glob('*.launch.py'))


def _calls(tree, name):
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == name:
            yield node


def _texts(tree):
    return {n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)}


def test_there_are_launch_files():
    """The next test has something to look at."""
    assert {path.name for path in FILES} >= {'p4pfr.launch.py', 'demo.launch.py'}


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_a_launch_file_names_what_there_is(path):
    """Its nodes have launchers, its configurations are declared, its parameters exist."""
    tree = ast.parse(path.read_text())
    compile(tree, str(path), 'exec')
    assert any(getattr(n, 'name', '') == 'generate_launch_description' for n in tree.body)
    started = set()
    for node in _calls(tree, 'Node'):
        words = {k.arg: k.value for k in node.keywords}
        assert words['package'].value == 'p4pfr_ros'
        started.add(words['executable'].value)
    assert started
    assert started <= {launcher.name for launcher in (ROOT / 'scripts').iterdir()}
    declared = {call.args[0].value for call in _calls(tree, 'DeclareLaunchArgument')}
    used = {call.args[0].value for call in _calls(tree, 'LaunchConfiguration')}
    assert used == declared
    known = {name for options in NODES.values() for name, _, _ in flattened(options)}
    keys = {k.value for d in ast.walk(tree) if isinstance(d, ast.Dict) for k in d.keys}
    assert keys <= known


def test_the_demo_has_a_board_of_its_own():
    """The file that it takes by default is installed with the others."""
    texts = _texts(ast.parse((ROOT / 'launch/demo.launch.py').read_text()))
    boards = {path.name for path in (ROOT / 'config/boards').iterdir()}
    assert len(texts & boards) == 1
    assert texts >= {'config', 'boards'}
