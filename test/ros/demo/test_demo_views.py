# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""config/p4pfr.rviz and config/p4pfr_foxglove.json: well formed, with existing topics."""

import ast
import json
from pathlib import Path
import re

from p4pfr_ros.ros.parameters.image_node_options import CameraSimulatorOptions
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[3]
RVIZ = yaml.safe_load((ROOT / 'config/p4pfr.rviz').read_text())['Visualization Manager']
FOXGLOVE = json.loads((ROOT / 'config/p4pfr_foxglove.json').read_text())
FRAME = CameraSimulatorOptions().camera.frame_id
DISPLAYS = {display['Class'].split('/')[-1]: display for display in RVIZ['Displays']}


def published():
    """Yield the topics in the sources of our nodes: '~/markers', or the end of an f-string."""
    for path in (ROOT / 'p4pfr_ros/ros').rglob('*.py'):
        node = path.stem if path.stem in ('detector_node', 'camera_simulator') else 'pose_node'
        for constant in ast.walk(ast.parse(path.read_text())):
            text = getattr(constant, 'value', None)
            if isinstance(text, str) and re.fullmatch(r'~?/\w+', text):
                yield f'{node}/{text.split("/")[1]}'


PUBLISHED = set(published())


def panels(layout):
    """Yield the names of the panels in a layout."""
    if isinstance(layout, str):
        yield layout
    else:
        assert layout['direction'] in ('row', 'column')
        yield from panels(layout['first'])
        yield from panels(layout['second'])


@pytest.mark.parametrize(
    ('display', 'topic'),
    [
        ('Image', 'detector_node/image_annotated'),
        ('MarkerArray', 'pose_node/markers'),
        ('PoseWithCovariance', 'pose_node/pose_with_covariance'),
    ],
)
def test_rviz_shows_published_topics(display, topic):
    """Relative ones, for namespaces and remappings."""
    assert topic in PUBLISHED
    assert DISPLAYS[display]['Topic']['Value'] == topic
    assert DISPLAYS[display]['Enabled'] is True


def test_the_fixed_frame_of_rviz_is_that_of_the_simulator():
    """The launch file sets another one."""
    assert DISPLAYS['TF']['Enabled'] is True
    assert RVIZ['Global Options']['Fixed Frame'] == FRAME
    assert RVIZ['Views']['Current']['Target Frame'] == '<Fixed Frame>'


def test_the_foxglove_layout_shows_each_panel_once():
    """Panels are named kind!name."""
    shown = list(panels(FOXGLOVE['layout']))
    assert sorted(shown) == sorted(FOXGLOVE['configById'])
    assert {name.split('!')[0] for name in shown} == {
        '3D',
        'DiagnosticStatusPanel',
        'DiagnosticSummary',
        'Image',
        'Plot',
    }


def test_foxglove_shows_published_topics():
    """Also those of message paths."""
    configs = FOXGLOVE['configById']
    scene = configs['3D!scene']
    assert scene['followTf'] == FRAME
    assert '/pose_node/markers' in scene['topics']
    assert all(topic['visible'] for topic in scene['topics'].values())
    topics = {configs['Image!image']['imageMode']['imageTopic'], *scene['topics']}
    for config in configs.values():
        topics |= {path['value'].split('.')[0] for path in config.get('paths', ())}
        assert config.get('topicToRender', '/diagnostics') == '/diagnostics'
    assert {topic.removeprefix('/') for topic in topics} <= PUBLISHED
