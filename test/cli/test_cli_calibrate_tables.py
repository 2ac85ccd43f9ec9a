# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What ``p4pfr calibrate`` prints of many views."""

import numpy as np
from p4pfr_ros import CameraEstimate, DivisionCamera, EstimateOptions, Verdict
from p4pfr_ros.cli.calibration_report import print_misses, print_views
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.report.calibration_run import Miss, PictureCalibration, Sighting
import pytest
from rendered import CHESSBOARD

HELD_CENTER = CameraEstimate(
    DivisionCamera(500.0, (319.5, 239.5), -0.2), np.diag([4.0, 0.0, 0.0, 1e-4, 0.0, 0.0]), 0.2, 3
)


def table_of(verdicts, capsys):
    """Print a view for each verdict; give the lines."""
    pictures = PictureCalibration(load_board(CHESSBOARD), EstimateOptions())
    pictures.sightings = [
        Sighting(n, f'view{n}', 54, 53, 0.25, verdict, HELD_CENTER)
        for n, verdict in enumerate(verdicts, 1)
    ]
    print_views(pictures)
    return capsys.readouterr().out.splitlines()


def test_a_row_says_everything_of_a_view(capsys):
    *_, row = (line for line in table_of([Verdict.USED], capsys) if 'view1' in line)
    cells = ' '.join(row.split())
    assert cells == '1 view1 54 53 0.250 500.0 ± 2.0 kept'


@pytest.mark.parametrize(('count', 'shown'), [(98, 100), (99, 2)])
def test_of_many_views_those_that_changed_nothing_are_counted(capsys, count, shown):
    lines = table_of([Verdict.USED, *[Verdict.REDUNDANT] * count, Verdict.OUTLIER], capsys)
    assert sum('view' in line and '±' in line for line in lines) == shown
    assert f'{count} known: {Verdict.REDUNDANT.value}' in lines
    assert f'1 outlier: {Verdict.OUTLIER.value}' in lines


def test_misses_are_named_or_counted(capsys):
    misses = [Miss(1, 'a.png', 'dark'), Miss(2, 'b.png', 'no board'), Miss(4, 'c.png', 'no board')]
    print_misses(misses, None)
    assert capsys.readouterr().err.splitlines() == [
        'p4pfr: a.png: dark',
        'p4pfr: b.png: no board',
        'p4pfr: c.png: no board',
    ]
    print_misses(misses, 'bag /image')
    assert capsys.readouterr().err.splitlines() == [
        'p4pfr: bag /image: 2 pictures: no board',
        'p4pfr: bag /image: 1 picture: dark',
    ]
