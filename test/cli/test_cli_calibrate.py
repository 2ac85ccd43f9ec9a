# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr calibrate`` on rendered images."""

import json

import numpy as np
from p4pfr_ros.cli import main
from p4pfr_ros.files.calibration import load_calibration
from p4pfr_ros.files.images import read_image
from p4pfr_ros.report.number_format import plus_minus, shape_text
import pytest
from rendered import CHESSBOARD, FOCAL_PX, K, write_empty, write_scene, write_views

COUNT = 10
TRUTH = (FOCAL_PX, 319.5, 239.5)


@pytest.fixture(scope='module')
def views(tmp_path_factory):
    """Return a folder that contains enough views for a calibration, and nothing else."""
    folder = tmp_path_factory.mktemp('views')
    write_views(folder, COUNT)
    return folder


@pytest.fixture
def output(tmp_path):
    """Return the path of the output file."""
    return tmp_path / 'camera.yaml'


def calibrate(*arguments):
    """Run the command."""
    return main(['calibrate', '--board', CHESSBOARD, *map(str, arguments)])


def printed(capsys):
    """Return stdout, and the lines of stderr but those on the compilation of kernels."""
    out, err = capsys.readouterr()
    return out, [line for line in err.splitlines() if not line.startswith('p4pfr_ros: ')]


def test_folder_of_views_gives_the_true_camera(views, output, capsys):
    assert calibrate(views, '-o', output, '--name', 'left') == 0
    out, err = printed(capsys)
    assert err == []
    calibration = load_calibration(output)
    assert calibration.camera_name == 'left'
    assert calibration.image_size == (640, 480)
    camera, estimate = calibration.estimate.camera, calibration.estimate
    values = np.array([camera.focal_px, *camera.center_px])
    sigmas = np.array([estimate.focal_sigma_px, *estimate.center_sigma_px])
    assert (np.abs(values - TRUTH) < np.minimum(4.0 * sigmas, 1.0)).all()
    assert camera.k == pytest.approx(K, abs=min(4.0 * estimate.k_sigma, 0.005))
    rows = [line.split() for line in out.splitlines() if '.png' in line]
    assert [row[0] for row in rows] == [str(n) for n in range(1, COUNT + 1)]
    assert [row[1] for row in rows] == [str(path) for path in sorted(views.iterdir())]
    focal, x, y = map(plus_minus, values, sigmas)
    assert f'focal length {focal} px' in out
    assert f'centre       {x}, {y} px' in out
    assert f'CameraInfo   {calibration.model.distortion_model}, ' in out
    assert f'projection   {estimate.projection_sigma_px:.2g} px at most where seen' in out
    assert f'board        board: {shape_text(estimate.board_shape("board"))}' in out
    assert 'flat within' in out
    assert 'missing' not in out
    assert out.endswith(f'{output}: written\n')


def test_json_has_each_image_and_the_camera(views, output, capsys):
    write_empty(views.parent / 'empty.png')
    assert calibrate(views.parent / 'empty.png', views, '-o', output, '--json') == 0
    out, err = printed(capsys)
    assert err == []
    *lines, last = (json.loads(line) for line in out.splitlines())
    assert [line['image'] for line in lines] == list(range(1, COUNT + 2))
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
    assert calibration['camera_info']['residual_outside_px'] >= 0.0
    assert (calibration['aspect'], calibration['p1'], calibration['p2']) == (1.0, 0.0, 0.0)
    assert 0.0 < calibration['sigma']['aspect'] < 0.01
    assert calibration['scatter'] >= 1.0
    assert 0.0 < calibration['projection_sigma_px'] < 2.0
    assert calibration['boards']['board']['bow_m'] < 5e-4
    assert lines[1]['camera'] is None or calibration['missing'] == []


def test_rejected_images_are_reported_and_do_not_affect_the_others(views, tmp_path, capsys):
    empty, other, none = (tmp_path / name for name in ('empty.png', 'other.png', 'none.png'))
    write_empty(empty)
    write_scene(other, CHESSBOARD, size=(800, 600))
    output = tmp_path / 'camera.yaml'
    assert calibrate(empty, views, other, none, '-o', output) == 0
    _, lines = printed(capsys)
    assert lines[0] == f'p4pfr: {empty}: no 9x6 chessboard found'
    assert lines[1] == (
        f'p4pfr: {other}: expected 640x480 px like the previous images, got 800x600'
    )
    assert lines[2].startswith(f'p4pfr: {none}: expected a readable image')
    assert len(lines) == 3
    assert load_calibration(output).image_size == (640, 480)


def test_too_few_views_write_only_the_report(views, output, capsys):
    one = min(views.iterdir())
    report = output.with_name('report.png')
    assert calibrate(one, '-o', output, '--plot', report) == 1
    out, [line] = printed(capsys)
    assert 'focal length' in out
    assert line.startswith(f'p4pfr: {output}: not written: ')
    assert '4 more different views' in line
    assert 'missing      4 more different views' in out
    assert not output.exists()
    assert read_image(report).shape == (1512, 1440, 3)


def test_force_writes_an_uncalibrated_camera(views, output, capsys):
    one = min(views.iterdir())
    assert calibrate(one, '-o', output, '--force') == 0
    assert printed(capsys)[1] == []
    assert load_calibration(output).estimate.views == 1


@pytest.mark.parametrize('force', [[], ['--force']])
def test_images_without_board_write_nothing(tmp_path, output, capsys, force):
    write_empty(tmp_path / 'empty.png')
    report = tmp_path / 'report.png'
    arguments = [tmp_path / 'empty.png', '-o', output, '--plot', report, *force]
    assert calibrate(*arguments) == 1
    out, err = printed(capsys)
    assert out == ''
    assert err == [
        f'p4pfr: {tmp_path / "empty.png"}: no 9x6 chessboard found',
        f'p4pfr: {output}: not written: the board was not detected in any image',
    ]
    assert not output.exists()
    assert not report.exists()
    assert calibrate(*arguments, '--json') == 1
    assert json.loads(capsys.readouterr().out.splitlines()[-1]) == {'calibration': None}


def test_every_second_image_is_used(views, output, capsys):
    calibrate(views, '-o', output, '--every', 2, '--force', '--json')
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line['name'] for line in lines[:-1]] == list(map(str, sorted(views.iterdir())[::2]))


def test_unwritable_paths_are_reported_before_the_work(tmp_path, output, capsys):
    # Before the missing image.
    wrong = tmp_path / 'no' / 'camera.yaml'
    assert calibrate('none.png', '-o', wrong) == 1
    assert capsys.readouterr().err == (
        f'p4pfr: {wrong}: expected a writable path: No such file or directory\n'
    )
    assert calibrate('none.png', '-o', output, '--plot', tmp_path / 'report.gif') == 1
    assert capsys.readouterr().err == (
        f'p4pfr: {tmp_path}/report.gif: expected a file name ending in .pdf, .png, .svg\n'
    )


@pytest.mark.parametrize(
    ('wrong', 'message'),
    [
        ([], 'either images or --bag'),
        (['a.png', '--bag', 'bag'], 'either images or --bag'),
        (['a.png', '--topic', '/image'], '--topic requires --bag'),
        (['a.png', '--every', '0'], '--every'),
        (['a.png', '--threshold', '-1'], '--threshold'),
    ],
)
def test_wrong_usage_is_reported(wrong, message, output, capsys):
    with pytest.raises(SystemExit) as exit_:
        calibrate(*wrong, '-o', output)
    assert exit_.value.code == 2
    assert message in capsys.readouterr().err
