# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The programs in examples/ and the notebook; test/ros/test_examples_over_dds.py has the node."""

import json
import runpy
import sys

from blocks import ROOT
from launch_stand_in import Run
from p4pfr_ros import load_calibration
import pytest
import rendered
from ros_lines import check_launch_file

EXAMPLES = ROOT / 'examples'


@pytest.fixture
def run(monkeypatch, capsys):
    """Run an example as a program; return its exit status and what it prints."""

    def run(name, *arguments):
        monkeypatch.setattr(sys, 'argv', [name, *arguments])
        with pytest.raises(SystemExit) as end:
            runpy.run_path(str(EXAMPLES / name), run_name='__main__')
        return end.value.code, capsys.readouterr().out

    return run


def test_one_marker_prints_the_pose_and_its_uncertainty(run, tmp_path):
    pose = rendered.write_scene(tmp_path / 'marker.png', rendered.MARKER)
    status, printed = run('one_marker.py', str(tmp_path / 'marker.png'))
    assert status == 0
    for axis, true_m in zip('xyz', pose.translation, strict=True):
        [line] = (line for line in printed.splitlines() if line.startswith(f'{axis} '))
        _, value, _, sigma, _ = line.split()
        assert abs(float(value) - true_m) < 4.0 * float(sigma) + 0.001
    assert 'tilt' in printed


def test_one_marker_prints_why_there_is_no_pose(run, tmp_path):
    rendered.write_empty(tmp_path / 'empty.png')
    status, printed = run('one_marker.py', str(tmp_path / 'empty.png'))
    assert status == 1
    assert 'no marker' in printed


def test_photographs_calibrate_a_camera(run, folder):
    """The file has the camera that the images were rendered with."""
    photographs = [str(path) for path in sorted(folder.glob('left*.jpg'))]
    options = ['--board', 'board.yaml', '--output', 'own.yaml']
    status, printed = run('calibrate_photographs.py', *photographs, *options)
    assert status == 0, printed
    camera = load_calibration('own.yaml').estimate.camera
    assert camera.focal_px == pytest.approx(534.0, rel=0.01)
    assert printed.count('the camera was estimated again') > 4


def test_too_few_photographs_calibrate_no_camera(run, folder):
    """What is missing is printed, and no file is written."""
    status, printed = run('calibrate_photographs.py', 'left01.jpg', '--output', 'none.yaml')
    assert status == 1
    assert 'no camera' in printed or 'not calibrated yet' in printed
    assert not (folder / 'none.yaml').exists()


def test_apriltag_ros_and_pose_node_share_their_topics():
    """The raw image goes to apriltag_ros, its detections to pose_node."""
    path = EXAMPLES / 'apriltag_topics.launch.py'
    check_launch_file(path, {'board_file': 'tag.yaml'})
    detector, pose = Run(path, ROOT, board_file='tag.yaml', image='/a/raw').nodes
    assert (detector.package, detector.executable) == ('apriltag_ros', 'apriltag_node')
    assert dict(detector.remappings)['image_rect'] == '/a/raw'
    # Neither remaps `detections`, on which one publishes and the other subscribes.
    names = {name for node in (detector, pose) for name, _ in node.remappings}
    assert 'detections' not in names
    assert dict(pose.remappings)['camera_info'] == dict(detector.remappings)['camera_info']


def test_the_notebook_runs(folder):
    """Its cells as one program; `make docs` runs it in a kernel of Jupyter, too."""
    notebook = json.loads((ROOT / 'notebooks' / 'quickstart.ipynb').read_text(encoding='utf-8'))
    cells = [cell for cell in notebook['cells'] if cell['cell_type'] == 'code']
    assert len(cells) >= 5
    assert not any(cell['outputs'] for cell in cells), 'clear the outputs before a commit'
    namespace = {}
    for cell in cells:
        exec(''.join(cell['source']), namespace)
    assert namespace['calibration'].state.name == 'CALIBRATED'
