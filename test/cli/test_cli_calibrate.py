# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr calibrate`` on rendered pictures."""

import json

import numpy as np
from p4pfr_ros.cli import main
from p4pfr_ros.files.calibration import load_calibration
from p4pfr_ros.files.images import read_image
from p4pfr_ros.report.numbers import plus_minus
import pytest
from rendered import CHESSBOARD, FOCAL_PX, K, write_empty, write_scene, write_views

COUNT = 10
TRUTH = (FOCAL_PX, 319.5, 239.5)


@pytest.fixture(scope='module')
def views(tmp_path_factory):
    """Give a folder with enough views for a calibration, and with nothing else."""
    folder = tmp_path_factory.mktemp('views')
    write_views(folder, COUNT)
    return folder


@pytest.fixture
def output(tmp_path):
    """Give a place for the calibration."""
    return tmp_path / 'camera.yaml'


def calibrate(*arguments):
    """Run the command."""
    return main(['calibrate', '--board', CHESSBOARD, *map(str, arguments)])


def printed(capsys):
    """Give what was printed, and the complaints (that kernels are compiled is none)."""
    out, err = capsys.readouterr()
    return out, [line for line in err.splitlines() if not line.startswith('p4pfr_ros: ')]


def test_folder_gives_the_true_camera_in_a_file(views, output, capsys):
    assert calibrate(views, '-o', output, '--name', 'left') == 0
    out, err = printed(capsys)
    assert err == []
    calibration = load_calibration(output)
    assert calibration.camera_name == 'left'
    assert calibration.image_size == (640, 480)
    camera, estimate = calibration.estimate.camera, calibration.estimate
    found = np.array([camera.focal_px, *camera.center_px])
    sigmas = np.array([estimate.focal_sigma_px, *estimate.center_sigma_px])
    assert (np.abs(found - TRUTH) < np.minimum(4.0 * sigmas, 1.0)).all()
    assert camera.k == pytest.approx(K, abs=min(4.0 * estimate.k_sigma, 0.005))
    rows = [line.split() for line in out.splitlines() if '.png' in line]
    assert [row[0] for row in rows] == [str(n) for n in range(1, COUNT + 1)]
    assert [row[1] for row in rows] == [str(path) for path in sorted(views.iterdir())]
    focal, x, y = map(plus_minus, found, sigmas)
    assert f'focal length {focal} px' in out
    assert f'centre       {x}, {y} px' in out
    assert f'CameraInfo   {calibration.model.distortion_model}, ' in out
    assert out.endswith(f'{output}: written\n')


def test_json_tells_each_view_and_the_camera(views, output, capsys):
    write_empty(views.parent / 'empty.png')
    assert calibrate(views.parent / 'empty.png', views, '-o', output, '--json') == 0
    out, err = printed(capsys)
    assert err == []
    *lines, last = (json.loads(line) for line in out.splitlines())
    assert [line['picture'] for line in lines] == list(range(1, COUNT + 2))
    assert lines[0]['reason'] == 'no 9x6 chessboard found'
    assert all(line['points'] == line['inliers'] == 54 for line in lines[1:])
    assert all(line['rms_px'] < 0.3 for line in lines[1:])
    calibration = last['calibration']
    assert calibration['state'] == 'calibrated'
    assert calibration['image_size'] == [640, 480]
    camera = lines[-1]['camera']
    assert camera.items() <= calibration.items()
    assert [camera['focal_px'], *camera['center_px']] == pytest.approx(TRUTH, abs=1.0)
    assert camera['k'][0] == pytest.approx(K, abs=0.005)
    assert 0.0 < camera['sigma']['focal_px'] < 1.0
    assert 0.4 < calibration['coverage'] < 1.0
    model = load_calibration(output).model
    assert calibration['camera_info']['d'] == pytest.approx(list(model.coefficients))
    assert calibration['camera_info']['residual_px'] < 0.1


def test_pictures_that_are_no_use_are_named_and_cost_only_themselves(views, tmp_path, capsys):
    empty, other, none = (tmp_path / name for name in ('empty.png', 'other.png', 'none.png'))
    write_empty(empty)
    write_scene(other, CHESSBOARD, size=(800, 600))
    output = tmp_path / 'camera.yaml'
    assert calibrate(empty, views, other, none, '-o', output) == 0
    _, lines = printed(capsys)
    assert lines[0] == f'p4pfr: {empty}: no 9x6 chessboard found'
    assert lines[1] == (
        f'p4pfr: {other}: expected 640x480 px like the pictures before, got 800x600'
    )
    assert lines[2].startswith(f'p4pfr: {none}: expected a readable picture')
    assert len(lines) == 3
    assert load_calibration(output).image_size == (640, 480)


def test_too_few_views_write_nothing_but_the_report(views, output, capsys):
    one = min(views.iterdir())
    report = output.with_name('report.png')
    assert calibrate(one, '-o', output, '--plot', report) == 1
    out, [line] = printed(capsys)
    assert 'focal length' in out
    assert line.startswith(f'p4pfr: {output}: not written: ')
    assert not output.exists()
    assert read_image(report).shape == (960, 1440, 3)


def test_force_writes_what_there_is(views, output, capsys):
    one = min(views.iterdir())
    assert calibrate(one, '-o', output, '--force') == 0
    assert printed(capsys)[1] == []
    assert load_calibration(output).estimate.views == 1


@pytest.mark.parametrize('force', [[], ['--force']])
def test_no_board_is_no_camera(tmp_path, output, capsys, force):
    write_empty(tmp_path / 'empty.png')
    report = tmp_path / 'report.png'
    asked = [tmp_path / 'empty.png', '-o', output, '--plot', report, *force]
    assert calibrate(*asked) == 1
    out, err = printed(capsys)
    assert out == ''
    assert err == [
        f'p4pfr: {tmp_path / "empty.png"}: no 9x6 chessboard found',
        f'p4pfr: {output}: not written: no picture shows the board',
    ]
    assert not output.exists()
    assert not report.exists()
    assert calibrate(*asked, '--json') == 1
    assert json.loads(capsys.readouterr().out.splitlines()[-1]) == {'calibration': None}


def test_every_second_is_half_of_them(views, output, capsys):
    calibrate(views, '-o', output, '--every', 2, '--force', '--json')
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line['name'] for line in lines[:-1]] == list(map(str, sorted(views.iterdir())[::2]))


def test_places_that_cannot_be_written_to_show_before_the_work(tmp_path, output, capsys):
    # Before the pictures, which do not exist.
    wrong = tmp_path / 'no' / 'camera.yaml'
    assert calibrate('none.png', '-o', wrong) == 1
    assert capsys.readouterr().err == (
        f'p4pfr: {wrong}: expected a place to write to: No such file or directory\n'
    )
    assert calibrate('none.png', '-o', output, '--plot', tmp_path / 'report.gif') == 1
    assert capsys.readouterr().err == (
        f'p4pfr: {tmp_path}/report.gif: expected a name that ends in .pdf, .png, .svg\n'
    )


@pytest.mark.parametrize(
    ('wrong', 'named'),
    [
        ([], 'one of the two'),
        (['a.png', '--bag', 'bag'], 'one of the two'),
        (['a.png', '--topic', '/image'], '--topic'),
        (['a.png', '--every', '0'], '--every'),
        (['a.png', '--threshold', '-1'], '--threshold'),
    ],
)
def test_wrong_usage_is_named(wrong, named, output, capsys):
    with pytest.raises(SystemExit) as exit_:
        calibrate(*wrong, '-o', output)
    assert exit_.value.code == 2
    assert named in capsys.readouterr().err
