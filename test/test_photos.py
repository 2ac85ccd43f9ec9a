# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands on thirteen photographs of a chessboard, in the directory P4PFR_DATA."""

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
    'P4PFR_DATA' not in os.environ,
    reason='P4PFR_DATA is not set to the directory of the photographs',
)


@pytest.fixture
def photos():
    """Return the paths of the photographs, in the order of their names."""
    paths = sorted(Path(os.environ['P4PFR_DATA']).glob('left*.jpg'))
    assert len(paths) == 13
    return list(map(str, paths))


def test_each_single_photograph_gives_the_focal_length(photos, capsys):
    assert main(['estimate', *photos, '--board', str(BOARD), '--json']) == 0
    estimates = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [estimate['image'] for estimate in estimates] == photos
    assert [estimate['focal_px'] for estimate in estimates] == pytest.approx(
        [FOCAL_PX] * 13, rel=0.06
    )
    assert max(estimate['rms_px'] for estimate in estimates) < 0.6
    assert all(estimate['inliers'] == 54 for estimate in estimates)


def test_the_photographs_calibrate_the_camera(photos, tmp_path, capsys):
    output, report = tmp_path / 'left.yaml', tmp_path / 'report.png'
    outputs = ['-o', str(output), '--plot', str(report), '--json']
    assert main(['calibrate', *photos, '--board', str(BOARD), *outputs]) == 0
    *views, last = map(json.loads, capsys.readouterr().out.splitlines())
    assert [view['name'] for view in views] == photos
    assert all(view['inliers'] == 54 for view in views)
    camera = last['calibration']
    assert camera['focal_px'] == pytest.approx(FOCAL_PX, rel=0.003)
    assert camera['center_px'] == pytest.approx(CENTER_PX, abs=2.0)
    assert camera['rms_px'] <= 0.21
    assert load_calibration(output).estimate.camera.focal_px == camera['focal_px']
    assert report.exists()


def test_convergence_is_plotted_beside_the_calibration_of_opencv(photos, tmp_path, capsys):
    assert convergence.main(['--output', str(tmp_path / 'convergence.png')]) == 0
    table = capsys.readouterr().out.splitlines()
    assert [row.split()[0] for row in table[1:14]] == [Path(photo).name for photo in photos]
    for row in table[14:16]:
        focal_px, *center_px = map(float, row.split()[-3:])
        assert row.startswith('OpenCV, ')
        assert focal_px == pytest.approx(FOCAL_PX, abs=0.5)
        assert center_px == pytest.approx(CENTER_PX, abs=0.3)
    assert (tmp_path / 'convergence.png').exists()
