# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr estimate`` with priors on the camera."""

import json

import numpy as np
from p4pfr_ros.cli import main
import pytest
from rendered import CHESSBOARD, FOCAL_PX, K, write_scene


def test_priors_determine_what_a_head_on_view_does_not(tmp_path, capsys):
    pose = write_scene(tmp_path / 'flat.png', CHESSBOARD, turn_rad=np.zeros(3))
    priors = ['--prior-focal', str(FOCAL_PX), '4', '--prior-k', str(K), '0.01', '--sigma', '0.1']
    arguments = ['estimate', '--board', CHESSBOARD, str(tmp_path / 'flat.png'), '--json', *priors]
    assert main(arguments) == 0
    line = json.loads(capsys.readouterr().out)
    assert line['not_observable'] == []
    assert line['distance_m'] == pytest.approx(np.linalg.norm(pose.translation), rel=0.02)
    assert line['sigma']['focal_px'] == pytest.approx(4.0, rel=0.3)


def test_a_wrong_standard_deviation_is_reported(tmp_path, capsys):
    image = tmp_path / 'flat.png'
    write_scene(image, CHESSBOARD)
    arguments = ['estimate', '--board', CHESSBOARD, str(image), '--prior-focal', '500', '-1']
    assert main(arguments) == 1
    assert 'prior_focal_sigma_px must be from 1e-06 to 1e+06, got -1' in capsys.readouterr().err
