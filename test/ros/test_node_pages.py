# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pages of the nodes in docs/ agree with the nodes, their parameters and config/."""

import ast
from pathlib import Path
import re
import subprocess
import sys

from p4pfr_ros import Status
from p4pfr_ros.ros.parameters.dashboard_options import DashboardNodeOptions
from p4pfr_ros.ros.parameters.declare import flattened
from p4pfr_ros.ros.parameters.image_node_options import CameraSimulatorOptions, DetectorNodeOptions
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
from p4pfr_ros.ros.pose.health import Health
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
NODES = {
    'pose_node': PoseNodeOptions(),
    'detector_node': DetectorNodeOptions(),
    'camera_simulator': CameraSimulatorOptions(),
    'dashboard_node': DashboardNodeOptions(),
}
ROS_SOURCES = {p for p in (ROOT / 'p4pfr_ros' / 'ros').rglob('*.py') if p.parent.name != 'demo'}
IMAGES = {
    ROOT / 'p4pfr_ros' / 'ros' / 'runtime' / 'image_stream.py',
    ROOT / 'p4pfr_ros' / 'files' / 'pixel_formats.py',
}
DETECTOR = {ROOT / 'p4pfr_ros' / 'ros' / 'detector_node.py', *IMAGES}
SIMULATOR = {ROOT / 'p4pfr_ros' / 'ros' / 'camera_simulator.py'}
DASHBOARD = {ROOT / 'p4pfr_ros' / 'ros' / 'dashboard_node.py', *IMAGES}
# The status of an estimate without a model.
NO_MODEL = {
    Status.COLLINEAR,
    Status.NO_SOLUTION,
    Status.NO_CONSENSUS,
    Status.MISFIT,
    Status.SEEN_FROM_BEHIND,
}
SOURCES = {
    'pose_node': ROS_SOURCES - DETECTOR - SIMULATOR - DASHBOARD,
    'detector_node': DETECTOR,
    'camera_simulator': SIMULATOR,
    'dashboard_node': DASHBOARD,
}
every_node = pytest.mark.parametrize('node', NODES)


@pytest.fixture
def scripts(monkeypatch):
    """Make the scripts of docs/ importable."""
    monkeypatch.syspath_prepend(DOCS)


@pytest.mark.dds
def test_the_tables_agree_with_running_nodes():
    """Names, types and QoS of topics and services, and all parameters."""
    command = [sys.executable, DOCS / 'write_node_pages.py', '--check']
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, ''), run.stderr


def test_only_generated_parts_are_replaced(scripts):
    """A page must have each part once."""
    from write_node_pages import filled

    page = 'above\n<!-- generated: one -->\nold\n<!-- end: one -->\nbelow\n'
    new = filled(page, {'one': r'| \1 |'})
    assert new == 'above\n<!-- generated: one -->\n\n| \\1 |\n\n<!-- end: one -->\nbelow\n'
    assert filled(new, {'one': r'| \1 |'}) == new
    for parts in ({}, {'two': ''}, {'one': '', 'two': ''}):
        with pytest.raises(ValueError, match='expected the parts'):
            filled(page, parts)
    with pytest.raises(ValueError, match='got one, one'):
        filled(page + page, {'one': ''})


def test_a_topic_without_a_description_is_an_error(scripts):
    """So is a description without a topic."""
    from node_pages.interfaces import Endpoint, Role
    from node_pages.tables import interface

    topic = Endpoint(Role.IN, 'points', 'a_msgs/A', 'reliable')
    table = interface('a_node', [topic], {'points': 'Either a | b.'})
    assert table.splitlines()[-1] == r'| `points` | a_msgs/A | reliable | Either a \| b. |'
    for given in ({}, {'points': '', 'other': ''}):
        with pytest.raises(ValueError, match=r'descriptions differ in (points|other)$'):
            interface('a_node', [topic], given)


@every_node
def test_every_cause_is_explained(node):
    """The page lists each cause of a rejection or a notice, and no other."""
    causes = {cause for path in SOURCES[node] for cause in _causes(path)}
    if node == 'pose_node':
        causes |= {status.name.lower() for status in NO_MODEL}
    assert _first_cells(node, '| cause |') == causes


def test_every_value_on_diagnostics_is_explained():
    """Except the counts of rejections, which are explained by cause."""
    values = Health(0.0).status(0.0).values
    assert _first_cells('pose_node', '| value |') == set(values)


@every_node
def test_parameters_in_examples_exist(node):
    """With values of the right type."""
    defaults = {name: value for name, value, _ in flattened(NODES[node])}
    examples = re.findall(r'```yaml\n(.*?)```', _page(node), re.DOTALL)
    assert examples
    for example in examples:
        [(name, content)] = yaml.safe_load(example).items()
        assert name == f'/**/{node}'
        for parameter, value in _flat(content['ros__parameters'], ''):
            assert type(value) is type(defaults[parameter]), parameter


@every_node
def test_links_are_valid(node):
    """To files, and to headings of the page."""
    page = _page(node)
    headings = re.findall(r'^#+ (.*)$', page, re.MULTILINE)
    anchors = {re.sub(r'[^\w\- ]', '', heading).lower().replace(' ', '-') for heading in headings}
    for link in re.findall(r'\]\(([^)]+)\)', page):
        assert link[1:] in anchors if link.startswith('#') else (DOCS / link).exists(), link


@every_node
def test_config_files_list_the_valid_values(node, scripts):
    """As the page, after the description: range or choices, and whether it is read-only."""
    from node_pages.tables import allowed

    lines = (ROOT / 'config' / f'{node}.yaml').read_text().splitlines()
    flowing = ' '.join(line.strip().removeprefix('# ') for line in lines)
    for name, value, spec in flattened(NODES[node]):
        what, may = 'One of' if spec.choices else 'Range:', allowed(value, spec)
        notes = [f' {what} {may}.'] * bool(may) + [' Read-only.'] * spec.read_only
        key = f' {name.rpartition(".")[2]}: '
        assert spec.description + ''.join(notes) + key in flowing, name


def _page(node):
    return (DOCS / f'{node}.md').read_text()


def _first_cells(node, head):
    """Return the names in backticks in the first column of a table."""
    table = _page(node).partition(f'\n{head}')[2].partition('\n\n')[0]
    cells = [line.split('|')[1] for line in table.splitlines()[2:]]
    return {name for cell in cells for name in re.findall(r'`(\w+)`', cell)}


def _causes(path):
    """Yield the causes in a file."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            cause = node.args[0] if node.args else None
            named = node.func.id in ('Rejected', 'Notice', 'Unreadable') and isinstance(
                cause, ast.Constant
            )
            if named:
                yield cause.value


def _flat(tree, prefix):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield prefix + key, value
