# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Thirteen photographs of a real chessboard, through a real lens; P4PFR_DATA says where."""

import json
import os
from pathlib import Path

from benchmarks import convergence
from p4pfr_ros.cli import main
from p4pfr_ros.files.calibration import load_calibration
import pytest

BOARD = Path(__file__).parent.parent / 'config/boards/chessboard_9x6_25mm.yaml'
# From OpenCV's calibration of all thirteen together.
FOCAL_PX = 533.0
CENTER_PX = (342.3, 233.9)

pytestmark = pytest.mark.skipif(
    'P4PFR_DATA' not in os.environ, reason='P4PFR_DATA does not say where the photographs are'
)


@pytest.fixture
def photos():
    """Give the paths of the photographs, in the order of their names."""
    found = sorted(Path(os.environ['P4PFR_DATA']).glob('left*.jpg'))
    assert len(found) == 13
    return list(map(str, found))


def test_each_photograph_gives_the_focal_length_by_itself(photos, capsys):
    assert main(['estimate', *photos, '--board', str(BOARD), '--json']) == 0
    answers = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [answer['image'] for answer in answers] == photos
    assert [a['focal_px'] for a in answers] == pytest.approx([FOCAL_PX] * 13, rel=0.06)
    assert max(answer['rms_px'] for answer in answers) < 0.6
    assert all(answer['inliers'] == 54 for answer in answers)


def test_the_photographs_calibrate_the_camera_one_after_another(photos, tmp_path, capsys):
    output, report = tmp_path / 'left.yaml', tmp_path / 'report.png'
    asked = [*photos, '--board', str(BOARD), '-o', str(output), '--plot', str(report), '--json']
    assert main(['calibrate', *asked]) == 0
    *views, last = map(json.loads, capsys.readouterr().out.splitlines())
    assert [view['name'] for view in views] == photos
    assert all(view['inliers'] == 54 for view in views)
    camera = last['calibration']
    assert camera['focal_px'] == pytest.approx(FOCAL_PX, rel=0.003)
    assert camera['center_px'] == pytest.approx(CENTER_PX, abs=2.0)
    assert camera['rms_px'] <= 0.21
    assert load_calibration(output).estimate.camera.focal_px == camera['focal_px']
    assert report.exists()


def test_convergence_is_drawn_beside_what_opencv_finds(photos, tmp_path, capsys):
    assert convergence.main(['--output', str(tmp_path / 'convergence.png')]) == 0
    table = capsys.readouterr().out.splitlines()
    assert [row.split()[0] for row in table[1:14]] == [Path(photo).name for photo in photos]
    for row in table[14:16]:
        focal_px, *center_px = map(float, row.split()[-3:])
        assert row.startswith('OpenCV, ')
        assert focal_px == pytest.approx(FOCAL_PX, abs=0.5)
        assert center_px == pytest.approx(CENTER_PX, abs=0.3)
    assert (tmp_path / 'convergence.png').exists()
