# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rules of the house: layers, sizes, names, headers. Each test lists all offenders."""

import ast
from collections import defaultdict
import graphlib
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = 'p4pfr_ros'
HEADER = '# Copyright 2026 p4pfr_ros maintainers\n# SPDX-License-Identifier: Apache-2.0\n'
MAX_FILE_LINES = 500
MAX_FUNCTION_LINES = 40  # without the docstring

# Each room may import the rooms below it; rooms of one floor may import each other.
FLOORS = (
    {'core'},
    {'boards', 'detection', 'files', 'kernels', 'rendering', 'report', 'scenes'},
    {'cli', 'ros'},
)
CORE_FLOORS = (
    {'geometry', 'jit', 'kernel_cache', 'linalg', 'options'},
    {'cameras'},
    {'minimal'},
    {'model'},
    {'one_view'},
    {'many_views'},
)
ROS_FLOORS = (
    {'parameters', 'conversions', 'runtime'},
    {'pose', 'demo'},
    {'camera_simulator', 'detector_node', 'lifecycle_pose_node', 'pose_node'},
)
ROS_PACKAGES = {'ament_index_python', 'launch', 'launch_ros', 'rclpy', 'tf2_ros'}
ROS_SUFFIXES = ('_msgs', '_srvs', '_interfaces')
# What users start, and the test of a module's importers does not ask for one.
STARTED = {'__init__', '__main__', *ROS_FLOORS[-1]}


class Sources:
    """The modules of the package below a root: their dotted names, trees and imports."""

    def __init__(self, root):
        self.paths = {_name_of(path, root): path for path in sorted(root.rglob('*.py'))}
        self.trees = {name: ast.parse(path.read_text()) for name, path in self.paths.items()}
        self.imports = {
            name: set(self._imports_of(name, tree)) for name, tree in self.trees.items()
        }

    def _imports_of(self, name, tree):
        """Yield the dotted names of all imported modules, wherever in the file."""
        is_package = self.paths[name].name == '__init__.py'
        package = name.split('.') if is_package else name.split('.')[:-1]
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                above = package[: len(package) - node.level + 1] if node.level else []
                module = '.'.join([*above, *([node.module] if node.module else [])])
                inside = {f'{module}.{alias.name}' for alias in node.names}
                yield from (inside & self.paths.keys()) or {module}

    def ours(self, name):
        """Return the modules of the package that a module imports."""
        return {module for module in self.imports[name] if module in self.paths} - {name}


def _name_of(path, root):
    parts = [root.name, *path.relative_to(root).with_suffix('').parts]
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def floor_of(module, floors, depth):
    """Return the floor of a module by the part of its name at a depth; None without one."""
    parts = module.split('.')
    room = parts[depth] if len(parts) > depth else None
    return next((i for i, rooms in enumerate(floors) if room in rooms), None)


def upward_imports(sources, floors, depth, prefix):
    """List the imports that lead to a higher floor among the modules with a prefix."""
    found = []
    for name in sources.paths:
        here = floor_of(name, floors, depth) if name.startswith(prefix) else None
        for module in sources.ours(name) if here is not None else ():
            there = floor_of(module, floors, depth) if module.startswith(prefix) else None
            if there is not None and there > here:
                found.append(f'{name} imports {module}')
    return found


def foreign_imports(sources, room, allowed):
    """List the imports of a room that are neither ours, nor of Python, nor allowed."""
    allowed = {PACKAGE, *allowed, *sys.stdlib_module_names}
    return [
        f'{name} imports {module}'
        for name in sources.paths
        if name.startswith(f'{PACKAGE}.{room}')
        for module in sources.imports[name]
        if module.split('.')[0] not in allowed
    ]


SOURCES = Sources(ROOT / PACKAGE)
ALL_FILES = sorted(
    path
    for folder in (PACKAGE, 'test', 'launch', 'benchmarks', 'docs')
    for path in (ROOT / folder).rglob('*.py')
)


def test_imports_go_downward_only():
    assert not upward_imports(SOURCES, FLOORS, 1, f'{PACKAGE}.')
    assert not upward_imports(SOURCES, CORE_FLOORS, 2, f'{PACKAGE}.core.')
    assert not upward_imports(SOURCES, ROS_FLOORS, 2, f'{PACKAGE}.ros.')


def test_every_module_has_a_floor():
    rooms = {name.split('.')[1] for name in SOURCES.paths if '.' in name} - {'__main__'}
    assert rooms == set().union(*FLOORS)
    for room, floors in (('core', CORE_FLOORS), ('ros', ROS_FLOORS)):
        prefix = f'{PACKAGE}.{room}.'
        parts = {name.split('.')[2] for name in SOURCES.paths if name.startswith(prefix)}
        assert parts == set().union(*floors)


def test_the_two_top_rooms_meet_in_the_demo_alone():
    found = [
        f'{name} imports {module}'
        for name in SOURCES.paths
        for module in SOURCES.ours(name)
        if {room_of(name), room_of(module)} == {'cli', 'ros'} and name != f'{PACKAGE}.cli.demo'
    ]
    assert not found


def room_of(module):
    return module.split('.')[1] if '.' in module else None


def test_core_does_not_import_the_front_door():
    assert not [
        name
        for name in SOURCES.paths
        if name.startswith(f'{PACKAGE}.core') and PACKAGE in SOURCES.imports[name]
    ]


def test_no_module_imports_itself_in_a_circle():
    graph = {name: SOURCES.ours(name) for name in SOURCES.paths}
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError


def test_core_imports_numpy_and_numba_alone():
    assert not foreign_imports(SOURCES, 'core', {'numpy', 'numba'})


def test_a_module_deep_in_core_is_checked_too(tmp_path):
    """The rules see folders inside folders: a planted offender is found by each of them."""
    root = tmp_path / PACKAGE
    for folder in ('core/model', 'core/one_view', 'ros'):
        (root / folder).mkdir(parents=True)
        (root / folder / '__init__.py').touch()
    (root / '__init__.py').touch()
    (root / 'core' / '__init__.py').touch()
    (root / 'core/one_view/deep.py').touch()
    (root / 'core/model/offender.py').write_text('import cv2\nfrom ..one_view import deep\n')
    planted = Sources(root)
    offender = f'{PACKAGE}.core.model.offender'
    assert foreign_imports(planted, 'core', {'numpy'}) == [f'{offender} imports cv2']
    assert upward_imports(planted, CORE_FLOORS, 2, f'{PACKAGE}.core.') == [
        f'{offender} imports {PACKAGE}.core.one_view.deep'
    ]


def test_ros_stays_in_its_room():
    found = []
    for name in SOURCES.paths:
        if name.startswith(f'{PACKAGE}.ros'):
            continue
        tops = {module.split('.')[0] for module in SOURCES.imports[name]}
        found += [
            f'{name} imports {top}'
            for top in tops
            if top in ROS_PACKAGES or top.endswith(ROS_SUFFIXES)
        ]
    assert not found


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
    assert not heavy.intersection(loaded)


def test_a_module_with_a_single_importer_says_why_it_stands_alone():
    importers = defaultdict(set)
    for name in SOURCES.paths:
        for module in SOURCES.ours(name):
            importers[module].add(name)
    found = [
        f'{name}, imported by {", ".join(importers[name]) or "none"}'
        for name, path in SOURCES.paths.items()
        # Users start the commands of p4pfr, and import what the front door offers.
        if path.stem not in STARTED and importers[name] not in ({f'{PACKAGE}.cli'}, {PACKAGE})
        if len(importers[name]) < 2
        if 'stands alone' not in ' '.join((ast.get_docstring(SOURCES.trees[name]) or '').split())
    ]
    assert not found


def test_a_class_name_is_used_once():
    places = defaultdict(list)
    for name, tree in SOURCES.trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(name)
    assert not {name: where for name, where in places.items() if len(where) > 1}


def test_every_file_begins_with_its_licence():
    assert not [path for path in ALL_FILES if not path.read_text().startswith(HEADER)]


def test_files_are_small():
    lines = {path: len(path.read_text().splitlines()) for path in ALL_FILES}
    assert not {path: count for path, count in lines.items() if count > MAX_FILE_LINES}


def test_functions_are_small():
    found = {}
    for path in ALL_FILES:
        for node in ast.walk(ast.parse(path.read_text())):
            is_function = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
            if is_function and lines_of(node) > MAX_FUNCTION_LINES:
                found[f'{path.relative_to(ROOT)}: {node.name}'] = lines_of(node)
    assert not found


def lines_of(function):
    """Count a function's lines without its docstring."""
    first = function.body[0]
    has_docstring = ast.get_docstring(function, clean=False) is not None
    docstring = first.end_lineno - first.lineno + 1 if has_docstring else 0
    return function.end_lineno - function.lineno + 1 - docstring


def test_the_layers_are_printed_where_people_look():
    """CONTRIBUTING.md and core's docstring name every room."""
    contributing = (ROOT / 'CONTRIBUTING.md').read_text()
    missing = [room for rooms in FLOORS for room in rooms if f'{room}' not in contributing]
    core = ast.get_docstring(SOURCES.trees[f'{PACKAGE}.core'])
    words = set(re.findall(r'\w+', core))
    missing += [room for rooms in CORE_FLOORS for room in rooms if room not in words]
    assert not missing
