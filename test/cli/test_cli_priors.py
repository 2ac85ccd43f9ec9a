# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr estimate`` with something known of the camera beforehand."""

import json

import numpy as np
from p4pfr_ros.cli import main
import pytest
from rendered import CHESSBOARD, FOCAL_PX, K, write_scene


def test_what_is_known_tells_what_a_head_on_view_does_not(tmp_path, capsys):
    pose = write_scene(tmp_path / 'flat.png', CHESSBOARD, turn_rad=np.zeros(3))
    known = ['--prior-focal', str(FOCAL_PX), '4', '--prior-k', str(K), '0.01', '--sigma', '0.1']
    asked = ['estimate', '--board', CHESSBOARD, str(tmp_path / 'flat.png'), '--json', *known]
    assert main(asked) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer['not_observable'] == []
    assert answer['distance_m'] == pytest.approx(np.linalg.norm(pose.translation), rel=0.02)
    assert answer['sigma']['focal_px'] == pytest.approx(4.0, rel=0.3)


def test_a_sigma_that_is_none_is_named(tmp_path, capsys):
    picture = tmp_path / 'flat.png'
    write_scene(picture, CHESSBOARD)
    asked = ['estimate', '--board', CHESSBOARD, str(picture), '--prior-focal', '500', '-1']
    assert main(asked) == 1
    assert 'prior_focal_sigma_px must be at least 1e-06' in capsys.readouterr().err
