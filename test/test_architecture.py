# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rules that keep the code readable: layers, licence lines, sizes."""

import ast
import graphlib
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).parent.parent
MODULES = sorted((ROOT / 'p4pfr_ros').rglob('*.py'))
SOURCES = sorted(
    path
    for folder in ('p4pfr_ros', 'test', 'launch', 'benchmarks', 'docs')
    for path in (ROOT / folder).rglob('*.py')
)

# As in this file; .ci/ament asks the linter of ROS whether it is right.
LICENCE = Path(__file__).read_text().partition('\n\n')[0] + '\n\n'

MAX_FILE_LINES = 250  # without the licence
MAX_FUNCTION_LINES = 40  # without the docstring

# What stands in no room of its own lies between: boards, files, detection, rendering and so on.
BOTTOM, MIDDLE, TOP = 0, 1, 2
ROOMS = {'core': BOTTOM, 'ros': TOP, 'cli': TOP}

ROS = {'ament_index_python', 'builtin_interfaces', 'launch', 'launch_ros', 'rclpy', 'tf2_ros'}
IMPORTS = (ast.Import, ast.ImportFrom)


def name_of(path):
    """Give a file's dotted name: p4pfr_ros/core/__init__.py is p4pfr_ros.core."""
    parts = path.relative_to(ROOT).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


NAMES = {name_of(path) for path in MODULES}
over_modules = pytest.mark.parametrize('path', MODULES, ids=name_of)
over_sources = pytest.mark.parametrize('path', SOURCES, ids=lambda p: str(p.relative_to(ROOT)))


def imports_of(path, tree=None):
    """Yield the dotted names of all modules that a file imports, wherever in it."""
    package = name_of(path).split('.')[: None if path.name == '__init__.py' else -1]
    for node in ast.walk(tree or ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            module = '.'.join([*above, *([node.module] if node.module else [])])
            inside = {f'{module}.{alias.name}' for alias in node.names}
            yield from (inside & NAMES) or {module}


def room_of(module):
    """Give the layer of one of our modules; None for the package's front door."""
    parts = module.split('.')
    return ROOMS.get(parts[1], MIDDLE) if len(parts) > 1 else None


@over_modules
def test_imports_go_downward_only(path):
    here = room_of(name_of(path))
    if here is None or path.name == '__main__.py':
        return
    room = name_of(path).split('.')[1]
    for module in imports_of(path):
        if not module.startswith('p4pfr_ros'):
            continue
        there = room_of(module)
        if there is None:
            assert here > BOTTOM, f'core imports the front door, which is made of it: {module}'
        elif module.split('.')[1] != room:
            opens_the_demo = name_of(path) == 'p4pfr_ros.cli.demo'
            assert there <= here, f'imports upward: {module}'
            assert there < TOP or opens_the_demo, f'imports the other top room: {module}'


def test_no_module_imports_itself_in_a_circle():
    graph = {
        name_of(path): {m for m in imports_of(path) if m in NAMES and m != name_of(path)}
        for path in MODULES
    }
    made_of = {'camera_info_fit', 'camera_info_model', 'geometry'}
    assert graph['p4pfr_ros.core.cameras.division'] == {
        f'p4pfr_ros.core.{name}' for name in made_of
    }
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError


@pytest.mark.parametrize('path', sorted((ROOT / 'p4pfr_ros/core').glob('*.py')), ids=name_of)
def test_core_imports_numpy_and_numba_alone(path):
    tops = {module.split('.')[0] for module in imports_of(path)}
    assert tops <= {'p4pfr_ros', 'numpy', 'numba', *sys.stdlib_module_names}


@over_modules
def test_ros_stays_in_its_room(path):
    if name_of(path).startswith('p4pfr_ros.ros'):
        return
    tops = {module.split('.')[0] for module in imports_of(path)}
    assert not {
        top for top in tops if top in ROS or top.endswith(('_msgs', '_srvs', '_interfaces'))
    }
    # The command opens the demo's room when it is asked to, and not before.
    at_once = ast.Module(
        [n for n in ast.parse(path.read_text()).body if isinstance(n, IMPORTS)], []
    )
    assert not [m for m in imports_of(path, at_once) if m.startswith('p4pfr_ros.ros')]


@pytest.mark.parametrize(
    ('module', 'heavy'),
    [
        ('p4pfr_ros', {'rclpy', 'cv2', 'matplotlib', 'rich'}),
        ('p4pfr_ros.cli', {'rclpy', 'matplotlib', 'rich'}),
    ],
)
def test_import_is_light(module, heavy):
    code = f'import sys, {module}; print(*sys.modules)'
    loaded = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split()
    assert module in loaded
    needless = heavy.intersection(loaded)
    assert not needless


@over_sources
def test_licence_comes_first(path):
    assert path.read_text().startswith(LICENCE)


@over_sources
def test_file_is_small(path):
    assert len(path.read_text().removeprefix(LICENCE).splitlines()) <= MAX_FILE_LINES


@over_sources
def test_functions_are_small(path):
    functions = [
        node
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
    ]
    too_long = {f.name: lines_of(f) for f in functions if lines_of(f) > MAX_FUNCTION_LINES}
    assert not too_long


def lines_of(function):
    """Count a function's lines, its docstring left out."""
    first = function.body[0]
    has_docstring = ast.get_docstring(function, clean=False) is not None
    docstring = first.end_lineno - first.lineno + 1 if has_docstring else 0
    return function.end_lineno - function.lineno + 1 - docstring
