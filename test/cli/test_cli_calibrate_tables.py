# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The table of views and the list of rejected images of ``p4pfr calibrate``."""

import numpy as np
from p4pfr_ros import CameraEstimate, DivisionCamera, Verdict
from p4pfr_ros.cli.arguments import print_reasons
from p4pfr_ros.cli.calibrate import print_views
from p4pfr_ros.report.calibration_run import ViewRecord
import pytest

HELD_CENTER = CameraEstimate(
    DivisionCamera(500.0, (319.5, 239.5), -0.2), np.diag([4.0, 0.0, 0.0, 1e-4, 0.0, 0.0]), 0.2, 3
)


def table_of(verdicts, capsys):
    """Print a view for each verdict; return the lines."""
    records = [
        ViewRecord(n, f'view{n}', 54, 53, 0.25, verdict, HELD_CENTER)
        for n, verdict in enumerate(verdicts, 1)
    ]
    print_views(records)
    return capsys.readouterr().out.splitlines()


def test_a_row_describes_a_view(capsys):
    *_, row = (line for line in table_of([Verdict.USED], capsys) if 'view1' in line)
    cells = ' '.join(row.split())
    assert cells == '1 view1 54 53 0.250 500.0 ± 2.0 used'


@pytest.mark.parametrize(('count', 'shown'), [(98, 100), (99, 2)])
def test_of_many_views_those_without_effect_are_counted(capsys, count, shown):
    lines = table_of([Verdict.USED, *[Verdict.REDUNDANT] * count, Verdict.OUTLIER], capsys)
    assert sum('view' in line and '±' in line for line in lines) == shown
    assert f'{count} redundant: {Verdict.REDUNDANT.value}' in lines
    assert f'1 outlier: {Verdict.OUTLIER.value}' in lines


def test_rejected_images_are_listed_and_frames_of_a_recording_counted(capsys):
    print_reasons(
        [
            ('a.png', '', 'dark'),
            ('1.5', 'bag /image', 'dark'),
            ('b.png', '', 'no board'),
            ('2.5', 'bag /image', 'no board'),
            ('3.5', 'bag /image', 'no board'),
        ]
    )
    assert capsys.readouterr().err.splitlines() == [
        'p4pfr: a.png: dark',
        'p4pfr: b.png: no board',
        'p4pfr: bag /image: 2 images: no board',
        'p4pfr: bag /image: 1 image: dark',
    ]
