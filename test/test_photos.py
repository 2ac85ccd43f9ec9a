# SPDX-License-Identifier: Apache-2.0
"""Thirteen photographs of a real chessboard, through a real lens; P4PFR_DATA says where."""

import json
import os
from pathlib import Path

from p4pfr_ros.cli import main
import pytest

BOARD = Path(__file__).parent.parent / 'config/boards/chessboard_9x6_25mm.yaml'
# From OpenCV's calibration of all thirteen together.
FOCAL_PX = 533.0

pytestmark = pytest.mark.skipif(
    'P4PFR_DATA' not in os.environ, reason='P4PFR_DATA does not say where the photographs are'
)


def test_each_photograph_gives_the_focal_length_by_itself(capsys):
    photos = sorted(Path(os.environ['P4PFR_DATA']).glob('left*.jpg'))
    assert len(photos) == 13
    assert main(['estimate', *map(str, photos), '--board', str(BOARD), '--json']) == 0
    answers = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [answer['image'] for answer in answers] == [str(photo) for photo in photos]
    assert [a['focal_px'] for a in answers] == pytest.approx([FOCAL_PX] * 13, rel=0.06)
    assert max(answer['rms_px'] for answer in answers) < 0.6
    assert all(answer['inliers'] == 54 for answer in answers)
