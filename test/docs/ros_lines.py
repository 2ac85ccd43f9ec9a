# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Checks ``ros2 ...`` lines against the package: executables, launch arguments, parameters, topics.

``ros2`` and ``launch`` are not on PyPI. The tables on the pages of the nodes have the names of
topics and services, and config/ the parameters; `test_node_pages` compares both with the nodes.
"""

from __future__ import annotations

from pathlib import Path
import re

from blocks import ROOT
from launch_stand_in import Run
from p4pfr_ros.ros.parameters.declare import replaced
from p4pfr_ros.ros.parameters.image_node_options import CameraSimulatorOptions, DetectorNodeOptions
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
import yaml

# Their ranges and choices are checked, too.
OPTIONS = {
    'pose_node': PoseNodeOptions(),
    'lifecycle_pose_node': PoseNodeOptions(),
    'detector_node': DetectorNodeOptions(),
    'camera_simulator': CameraSimulatorOptions(),
}
# Executables of other packages that the pages mention; of their arguments, our topics are
# checked.
FOREIGN = {
    'apriltag_ros': {'apriltag_node'},
    'camera_calibration': {'cameracalibrator'},
    'image_proc': {'rectify_node'},
    'tf2_ros': {'static_transform_publisher', 'tf2_echo'},
    'v4l2_camera': {'v4l2_camera_node'},
}
_ROW = re.compile(r'^\| `([^`]+)` \| (\w+/\w+) \|', re.MULTILINE)


def nodes():
    """Return the names of the nodes: those with a parameter file, and the managed one."""
    return [*(path.stem for path in (ROOT / 'config').glob('*.yaml')), 'lifecycle_pose_node']


def interface_of(node):
    """Return the topics and services of a node with their types, from its page."""
    page = node.removeprefix('lifecycle_')
    return dict(_ROW.findall((ROOT / 'docs' / f'{page}.md').read_text(encoding='utf-8')))


def defaults_of(node):
    """Return the parameters of a node and their default values, from its parameter file."""
    text = (ROOT / 'config' / f'{node.removeprefix("lifecycle_")}.yaml').read_text()
    [content] = yaml.safe_load(text).values()
    return dict(_flat(content['ros__parameters'], ''))


def check_ros2(words):
    """Check the words of a line after ``ros2``."""
    verb, *rest = words
    checks = {
        'run': lambda: _check_run(*rest),
        'launch': lambda: _check_launch(*rest),
        'topic': lambda: _check_topic(*rest),
        'service': lambda: _check_service(*rest),
        'param': lambda: _check_param(*rest),
        'lifecycle': lambda: _check_lifecycle(*rest),
    }
    checks[verb]()


def check_ros_arguments(node, words):
    """Check remaps and parameters after ``--ros-args``."""
    assert words[0] == '--ros-args', words
    flags = iter(words[1:])
    for flag in flags:
        if flag == '...':
            continue
        name, _, value = next(flags).partition(':=')
        if flag == '-p':
            if not name.startswith('qos_overrides.'):
                check_parameters(node, {name: yaml.safe_load(value)})
        else:
            assert flag == '-r', flag
            check_remap(node, name)


def check_remap(node, name):
    """Check that a node has the topic or service that is remapped."""
    assert name in {*interface_of(node), '__ns', '__node', '/tf'}, f'{node} has no {name}'


def check_parameters(node, values):
    """Check that a node has the parameters, and accepts these values at its start."""
    check_types(node, values)
    if node in OPTIONS:
        replaced(OPTIONS[node], values)


def check_types(node, values):
    """Check that a node has the parameters, with the types of the values."""
    defaults = defaults_of(node)
    for name, value in values.items():
        assert name in defaults, f'{node} has no parameter {name}'
        assert type(value) is type(defaults[name]), f'{name}: {value!r}'


def check_parameter_file(content):
    """Check the content of a parameter file: {'/**/pose_node': {'ros__parameters': {...}}}."""
    for key, value in content.items():
        check_parameters(key.rpartition('/')[2], dict(_flat(value['ros__parameters'], '')))


def check_launch_file(path, arguments):
    """Check the nodes that a launch file starts."""
    for node in Run(path, ROOT, **arguments).nodes:
        if node.package == 'p4pfr_ros':
            assert (ROOT / 'scripts' / node.executable).exists(), node.executable
            check_parameters(node.executable, node.parameters[-1] if node.parameters else {})
            for name, _ in node.remappings:
                check_remap(node.executable, name)


def _check_run(package, executable, *rest):
    if package != 'p4pfr_ros':
        assert executable in FOREIGN.get(package, ()), f'{package} {executable}'
        for word in rest:
            # A topic of ours that the other node is to use.
            name = word.partition(':=')[2]
            if name.startswith(tuple(f'/{node}/' for node in nodes())):
                _check_name(name)
        return
    assert (ROOT / 'scripts' / executable).exists(), executable
    if rest:
        check_ros_arguments(executable, rest)


def _check_launch(first, *rest):
    if first == 'p4pfr_ros':
        path, rest = ROOT / 'launch' / rest[0], rest[1:]
    else:
        path = Path(first)
    check_launch_file(path, dict(word.split(':=', 1) for word in rest))


def _check_topic(verb, *rest):
    assert verb in {'echo', 'hz', 'info'}, verb
    _check_name(next(word for word in rest if not word.startswith('-')))


def _check_service(verb, name, kind):
    assert verb == 'call'
    package, _, message = kind.partition('/srv/')
    assert _check_name(name) == f'{package}/{message}', kind


def _check_param(verb, node, name, *value):
    node = node.rpartition('/')[2]
    assert verb in {'set', 'get'}, verb
    if value:
        check_types(node, {name: yaml.safe_load(value[0])})
    else:
        assert name in defaults_of(node), name


def _check_lifecycle(verb, node, transition):
    assert (verb, node) == ('set', '/lifecycle_pose_node')
    assert transition in {'configure', 'activate', 'deactivate', 'cleanup', 'shutdown'}


def _check_name(name):
    """Return the type of a topic or service by its full name, in any namespace."""
    for node in nodes():
        for known, kind in interface_of(node).items():
            full = known.replace('~', f'/{node}') if known[0] in '~/' else f'/{known}'
            # With several boards: /pose_node/NAME/pose.
            board = full.replace(f'/{node}/', rf'/{node}/(\w+/)?') if known[0] == '~' else full
            if re.fullmatch(rf'(/\w+)*{board}', name):
                return kind
    raise AssertionError(f'no node has {name}')


def _flat(tree, prefix):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield prefix + key, value
