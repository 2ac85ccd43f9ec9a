# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr undistort`` and ``p4pfr info`` on rendered images."""

import json

import numpy as np
from p4pfr_ros import CameraInfoModel, detect, DivisionCamera, estimate_pose, load_calibration
from p4pfr_ros.cli import main
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.calibration import Calibration, save_calibration
from p4pfr_ros.files.images import read_image
import pytest
from rendered import CHESSBOARD, FOCAL_PX, K, write_scene

CENTER = (319.5, 239.5)
SIZE = (640, 480)


@pytest.fixture(scope='module')
def scene(tmp_path_factory):
    """Return a folder with an image, one of another size, and calibrations of the camera."""
    folder = tmp_path_factory.mktemp('scene')
    (folder / 'images').mkdir()
    write_scene(folder / 'images/a.png', CHESSBOARD)
    write_scene(folder / 'large.png', CHESSBOARD, size=(800, 600))
    model = DivisionCamera(FOCAL_PX, CENTER, K).to_camera_info_model(SIZE)
    calibration = Calibration(image_size=SIZE, camera_name='left', model=model)
    save_calibration(folder / 'camera.yaml', calibration)
    return folder


def undistort(scene, *arguments):
    """Run the command."""
    return main(['undistort', '--camera', f'{scene}/camera.yaml', *map(str, arguments)])


def test_undistorted_images_are_those_of_the_pinhole_camera(scene, tmp_path, capsys):
    """Its calibration explains them, and the board is where it was."""
    assert undistort(scene, scene / 'images', '-o', tmp_path / 'out') == 0
    out, err = capsys.readouterr()
    assert (out, err) == (f'{tmp_path / "out"}: 1 image and camera.yaml written\n', '')
    pinhole = load_calibration(tmp_path / 'out/camera.yaml')
    assert (pinhole.image_size, pinhole.camera_name) == (SIZE, 'left')
    assert set(pinhole.model.coefficients) == {0.0}
    poses = []
    cameras = (DivisionCamera(FOCAL_PX, CENTER, K), pinhole.model)
    for folder, camera in zip((scene / 'images', tmp_path / 'out'), cameras, strict=True):
        points = detect(read_image(folder / 'a.png'), load_board(CHESSBOARD))
        found = estimate_pose(points.image_points, points.board_points, camera=camera)
        assert found.rms_px < 0.1
        poses.append(found.model.camera_from_board.matrix)
    np.testing.assert_allclose(*poses, atol=2e-3)


def test_a_smaller_field_of_view_magnifies(scene, tmp_path):
    assert undistort(scene, scene / 'images', '-o', tmp_path, '--max-fov', 60) == 0
    narrow = load_calibration(tmp_path / 'camera.yaml').model
    half_diagonal_px = 0.5 * np.hypot(639.0, 479.0)
    assert narrow.focal_px[0] == pytest.approx(half_diagonal_px / np.tan(np.radians(30.0)))


def test_images_of_another_size_are_reported_and_the_others_written(scene, tmp_path, capsys):
    images = [scene / 'large.png', scene / 'images/a.png', scene / 'none.png']
    assert undistort(scene, *images, '-o', tmp_path / 'out') == 1
    first, second = capsys.readouterr().err.splitlines()
    assert first == f'p4pfr: {images[0]}: expected 640x480 px as calibrated, got 800x600'
    assert second.startswith(f'p4pfr: {images[2]}: expected a readable image')
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {'a.png', 'camera.yaml'}


def test_without_any_image_nothing_is_written(scene, tmp_path, capsys):
    assert undistort(scene, scene / 'large.png', '-o', tmp_path) == 1
    assert capsys.readouterr().err.splitlines()[-1] == (
        f'p4pfr: {tmp_path}: not written: no image was undistorted'
    )
    assert not list(tmp_path.iterdir())


def test_no_image_is_overwritten(scene, tmp_path, capsys):
    before = (scene / 'images/a.png').read_bytes()
    assert undistort(scene, scene / 'images', '-o', scene / 'images') == 1
    assert 'expected another folder' in capsys.readouterr().err
    assert (scene / 'images/a.png').read_bytes() == before
    twins = [scene / 'images/a.png', tmp_path / 'a.png']
    assert undistort(scene, *twins, '-o', tmp_path / 'out') == 1
    assert 'would be written to the same file' in capsys.readouterr().err


def info(capsys, path, *arguments):
    """Run the command; return its output."""
    assert main(['info', str(path), *arguments]) == 0
    return capsys.readouterr().out


def test_info_of_a_file_by_another_program(tmp_path, capsys):
    model = CameraInfoModel('plumb_bob', (-0.1, 0, 0, 0, 0), (400.0, 402.0), (320, 240), 0.0, SIZE)
    path = tmp_path / 'camera.yaml'
    save_calibration(path, Calibration(image_size=SIZE, camera_name='left', model=model))
    lines = info(capsys, path).splitlines()
    assert lines[0].split() == ['camera', 'left,', '640x480', 'px']
    assert '  K          fx 400.000, fy 402.000, cx 320.000, cy 240.000 px' in lines
    tree = json.loads(info(capsys, path, '--json'))
    assert tree['camera_info']['focal_px'] == [400.0, 402.0]
    assert tree['division'] is None


def test_info_has_the_fields_of_view(scene, capsys):
    fields = json.loads(info(capsys, scene / 'camera.yaml', '--json'))['field_of_view_deg']
    camera = DivisionCamera(FOCAL_PX, CENTER, K)
    pairs = {'horizontal': (0.0, 239.5), 'vertical': (319.5, 0.0), 'diagonal': (0.0, 0.0)}
    for name, corner in pairs.items():
        x, y, z = camera.unproject(np.array(corner))
        half = np.degrees(np.arctan2(np.hypot(x, y), z))
        assert fields[name] == pytest.approx(2.0 * half, abs=0.02)


def test_info_of_a_self_calibrated_camera(scene, tmp_path, capsys):
    path = tmp_path / 'camera.yaml'
    arguments = ['--board', CHESSBOARD, '-o', str(path), '--force', '--json']
    assert main(['calibrate', str(scene / 'images'), *arguments]) == 0
    last = json.loads(capsys.readouterr().out.splitlines()[-1])['calibration']
    division = json.loads(info(capsys, path, '--json'))['division']
    assert division.items() <= last.items()
    text = info(capsys, path)
    assert 'division     1 views' in text
    assert 'board        board: flat within' in text
    assert '#' in text.split('coverage')[1]


def test_a_damaged_file_is_reported_in_one_line(tmp_path, capsys):
    (tmp_path / 'camera.yaml').write_text('image_width: 640')
    assert main(['info', str(tmp_path / 'camera.yaml')]) == 1
    assert capsys.readouterr().err.startswith(f'p4pfr: {tmp_path}/camera.yaml: ')
