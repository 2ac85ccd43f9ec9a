# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes' pages in docs/ are in step with the nodes, their parameters, and config/."""

import ast
from pathlib import Path
import re
import subprocess
import sys

from p4pfr_ros.core.one_view.results import Status
from p4pfr_ros.ros.parameters.declare import flattened
from p4pfr_ros.ros.parameters.image_node_options import (
    CameraSimulatorOptions,
    DetectorNodeOptions,
    PoseNodeOptions,
)
from p4pfr_ros.ros.pose.health import Health
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
NODES = {
    'pose_node': PoseNodeOptions(),
    'detector_node': DetectorNodeOptions(),
    'camera_simulator': CameraSimulatorOptions(),
}
ROS_SOURCES = {p for p in (ROOT / 'p4pfr_ros' / 'ros').rglob('*.py') if p.parent.name != 'demo'}
PICTURES = {
    ROOT / 'p4pfr_ros' / 'ros' / 'detector_node.py',
    ROOT / 'p4pfr_ros' / 'files' / 'pixel_formats.py',
}
SIMULATOR = {ROOT / 'p4pfr_ros' / 'ros' / 'camera_simulator.py'}
# Why an estimate has no model.
NO_MODEL = {Status.COLLINEAR, Status.NO_SOLUTION, Status.NO_CONSENSUS}
SOURCES = {
    'pose_node': ROS_SOURCES - PICTURES - SIMULATOR,
    'detector_node': PICTURES,
    'camera_simulator': SIMULATOR,
}
every_node = pytest.mark.parametrize('node', NODES)


@pytest.fixture
def scripts(monkeypatch):
    """Let scripts of docs/ be imported."""
    monkeypatch.syspath_prepend(DOCS)


@pytest.mark.dds
def test_the_tables_are_what_live_nodes_have():
    """Names, types and QoS of topics and services, and all parameters: nothing is forgotten."""
    command = [sys.executable, DOCS / 'write_node_pages.py', '--check']
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, ''), run.stderr


def test_what_is_written_by_hand_is_kept(scripts):
    """Only what stands between the marks is replaced; a page must have each part once."""
    from write_node_pages import filled

    page = 'above\n<!-- made: one -->\nold\n<!-- end of one -->\nbelow\n'
    new = filled(page, {'one': r'| \1 |'})
    assert new == 'above\n<!-- made: one -->\n\n| \\1 |\n\n<!-- end of one -->\nbelow\n'
    assert filled(new, {'one': r'| \1 |'}) == new
    for parts in ({}, {'two': ''}, {'one': '', 'two': ''}):
        with pytest.raises(ValueError, match='expected the parts'):
            filled(page, parts)
    with pytest.raises(ValueError, match='got one, one'):
        filled(page + page, {'one': ''})


def test_a_topic_without_words_is_an_error(scripts):
    """And so are words without a topic."""
    from node_pages.interfaces import Endpoint, Role
    from node_pages.tables import interface

    seen = Endpoint(Role.IN, 'seen', 'a_msgs/A', 'reliable')
    table = interface('a_node', [seen], {'seen': 'What is a | b.'})
    assert table.splitlines()[-1] == r'| `seen` | a_msgs/A | reliable | What is a \| b. |'
    for words in ({}, {'seen': '', 'hidden': ''}):
        with pytest.raises(ValueError, match=r'a_node and its words differ in (seen|hidden)$'):
            interface('a_node', [seen], words)


@every_node
def test_every_cause_is_explained(node):
    """The page has each cause for which a message is rejected or remarked upon, and no other."""
    causes = {cause for path in SOURCES[node] for cause in _causes(path)}
    if node == 'pose_node':
        causes |= {stop.name.lower() for stop in NO_MODEL}
    assert _first_cells(node, '| cause |') == causes


def test_every_value_on_diagnostics_is_explained():
    """By its name; those of causes are explained as causes."""
    values = Health(0.0).status(0.0).values
    assert _first_cells('pose_node', '| value |') == set(values)


@every_node
def test_examples_are_of_parameters_that_there_are(node):
    """Of the right type, as ROS is strict about."""
    known = {name: value for name, value, _ in flattened(NODES[node])}
    examples = re.findall(r'```yaml\n(.*?)```', _page(node), re.DOTALL)
    assert examples
    for example in examples:
        [(name, content)] = yaml.safe_load(example).items()
        assert name == f'/**/{node}'
        for parameter, value in _flat(content['ros__parameters'], ''):
            assert type(value) is type(known[parameter]), parameter


@every_node
def test_links_lead_somewhere(node):
    """To files of ours, and to headings of the page."""
    page = _page(node)
    headings = re.findall(r'^#+ (.*)$', page, re.MULTILINE)
    anchors = {re.sub(r'[^\w\- ]', '', heading).lower().replace(' ', '-') for heading in headings}
    for link in re.findall(r'\]\(([^)]+)\)', page):
        assert link[1:] in anchors if link.startswith('#') else (DOCS / link).exists(), link


@every_node
def test_config_files_say_what_is_allowed(node, scripts):
    """As the page does, after the description: range or choices, and whether it is read-only."""
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
    """Return what stands in backticks in the first column of a table."""
    table = _page(node).partition(f'\n{head}')[2].partition('\n\n')[0]
    cells = [line.split('|')[1] for line in table.splitlines()[2:]]
    return {name for cell in cells for name in re.findall(r'`(\w+)`', cell)}


def _causes(path):
    """Yield the causes that a file gives."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            cause = node.args[0] if node.args else None
            named = node.func.id in ('Rejected', 'Unreadable') and isinstance(cause, ast.Constant)
            if named:
                yield cause.value


def _flat(tree, prefix):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield prefix + key, value
