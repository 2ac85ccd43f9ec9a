# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr estimate`` on rendered images."""

from dataclasses import replace
import json

import numpy as np
from p4pfr_ros import (
    BoardShape,
    CameraEstimate,
    CameraInfoModel,
    detect,
    DivisionCamera,
    estimate_pose,
    EstimateOptions,
    Pose,
)
from p4pfr_ros.cli import main
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.calibration import Calibration, save_calibration
from p4pfr_ros.files.images import read_image
import pytest
from rendered import (
    CHESSBOARD,
    FOCAL_PX,
    K,
    MARKER,
    TILT_DEG,
    TURN_RAD,
    write_empty,
    write_scene,
)

TILT = Pose.from_rotation_vector(TURN_RAD, np.zeros(3))


@pytest.fixture(scope='module')
def scenes(tmp_path_factory):
    """Return a folder with a chessboard in two image sizes, and an image without a board."""
    folder = tmp_path_factory.mktemp('scenes')
    write_scene(folder / 'a.png', CHESSBOARD)
    write_scene(folder / 'b[red].png', CHESSBOARD, size=(800, 600))
    write_empty(folder / 'empty.png')
    return folder


def estimate(*arguments, board=CHESSBOARD):
    """Run the command."""
    return main(['estimate', '--board', board, *map(str, arguments)])


def test_json_has_the_true_pose_and_camera(scenes, capsys):
    pose = write_scene(scenes / 'c.png', CHESSBOARD)
    assert estimate(scenes / 'c.png', '--json') == 0
    [text] = capsys.readouterr().out.splitlines()
    line = json.loads(text)
    assert line['image'] == str(scenes / 'c.png')
    assert line['image_size'] == [640, 480]
    assert line['center_px'] == pytest.approx([319.5, 239.5], abs=15.0)
    assert line['tilt_deg'] == pytest.approx(TILT_DEG, abs=0.5)
    assert line['position_m'] == pytest.approx(pose.translation.tolist(), abs=0.01)
    estimated = Pose.from_quaternion_xyzw(line['quaternion_xyzw'], line['position_m'])
    np.testing.assert_allclose(estimated.rotation, pose.rotation, atol=0.02)
    assert line['distance_m'] == pytest.approx(np.linalg.norm(pose.translation), rel=0.02)
    assert line['focal_px'] == pytest.approx(FOCAL_PX, rel=0.02)
    assert line['k'] == pytest.approx(K, abs=0.02)
    assert line['rms_px'] < 0.3
    assert line['inliers'] == line['points'] == 54
    assert line['not_observable'] == line['candidates'] == []
    sigma = line['sigma']
    assert 0.0 < sigma['focal_px'] < 15.0
    assert 0.0 < sigma['k'] < 0.05
    assert 0.0 < sigma['distance_m'] < 0.03


def test_what_limits_the_focal_length_is_said(scenes, capsys):
    assert estimate(scenes / 'a.png') == 0
    out = ' '.join(capsys.readouterr().out.split())
    assert f'{scenes / "a.png"}: focal length limited by ' in out
    assert estimate(scenes / 'a.png', '--json') == 0
    limits = json.loads(capsys.readouterr().out)['focal_limits']
    assert set(limits) == {'center', 'lens', 'others'}
    assert max(limits.values()) >= 0.3
    assert sum(limits.values()) <= 1.0


def test_a_given_camera_and_the_shape_of_its_board_are_used(scenes, tmp_path, capsys):
    """The pose is that of estimate_pose with both; by the board's name."""
    camera = DivisionCamera(FOCAL_PX, (319.5, 239.5), K)
    shape = BoardShape(
        np.zeros(2), np.array([0.1, 0.0625]), [0, 0, 0.01, 0, 0, 0, 0, 0], 1e-10 * np.eye(8)
    )
    covariance = np.diag([0.1, 0.1, 0.1, 1e-6, 0, 0, 0, 0, 0, 0])
    points = detect(read_image(scenes / 'a.png'), load_board(CHESSBOARD))
    for name, used in (('board', shape), ('another', None)):
        estimated = CameraEstimate(camera, covariance, 0.2, 9, board_shapes={name: shape})
        calibration = Calibration.from_estimate(estimated, (640, 480), 'left')
        save_calibration(tmp_path / 'camera.yaml', calibration)
        given = ('--camera', tmp_path / 'camera.yaml')
        assert estimate(scenes / 'a.png', '--json', *given) == 0
        line = json.loads(capsys.readouterr().out)
        expected = estimate_pose(
            points.image_points,
            points.board_points,
            image_size=(640, 480),
            camera=camera,
            board_shape=used,
        ).model.camera_from_board
        assert line['position_m'] == pytest.approx(expected.translation.tolist(), abs=1e-12)
        assert (line['focal_px'], line['sigma']['focal_px']) == (FOCAL_PX, None)
        assert line['uses_board_shape'] is (used is not None)
    assert estimate(scenes / 'a.png', *given) == 0
    assert f'{FOCAL_PX:.1f} (given)' in capsys.readouterr().out
    assert estimate(scenes / 'b[red].png', *given) == 1
    assert 'expected 640x480 px as calibrated, got 800x600' in capsys.readouterr().err
    with pytest.raises(SystemExit):
        estimate(scenes / 'a.png', *given, '--center', 319.5, 239.5)
    assert '--camera excludes --center' in capsys.readouterr().err


def test_a_camera_of_kalibr_is_used(scenes, tmp_path, capsys):
    """Selected by its topic; what the file leaves open is said."""
    left, right = (
        f'{{intrinsics: [{FOCAL_PX}, {FOCAL_PX}, 319.5, {y}], resolution: [640, 480], '
        f'distortion_coeffs: [-0.2, 0.1, 0, 0], rostopic: /{name}/image}}'
        for name, y in (('left', 10.0), ('right', 239.5))
    )
    (tmp_path / 'chain.yaml').write_text(f'cam0: {left}\ncam1: {right}\n')
    given = ('--json', '--camera', tmp_path / 'chain.yaml')
    assert estimate(scenes / 'a.png', *given, '--camera-name', 'right') == 0
    out, err = capsys.readouterr()
    assert 'no distortion_model: taken as plumb_bob' in err
    points = detect(read_image(scenes / 'a.png'), load_board(CHESSBOARD))
    expected = estimate_pose(
        points.image_points,
        points.board_points,
        camera=CameraInfoModel(
            'plumb_bob', (-0.2, 0.1, 0, 0), (FOCAL_PX,) * 2, (319.5, 239.5), 0.0, (640, 480)
        ),
    ).model.camera_from_board
    position_m = json.loads(out)['position_m']
    assert position_m == pytest.approx(expected.translation.tolist(), abs=1e-12)
    assert estimate(scenes / 'a.png', *given) == 1
    assert 'got cam0, cam1: set camera_name' in capsys.readouterr().err


def test_table_has_a_row_for_each_image(scenes, capsys):
    assert estimate(scenes / 'a.png', scenes / 'b[red].png') == 0
    out, err = capsys.readouterr()
    assert err == ''
    rows = [line.split() for line in out.splitlines() if '54/54' in line]
    assert [row[0] for row in rows] == [str(scenes / 'a.png'), str(scenes / 'b[red].png')]
    tilts = [float(row[8]) for row in rows]
    assert tilts == pytest.approx([TILT_DEG, TILT_DEG], abs=0.5)


def test_image_without_board_is_reported_and_does_not_affect_the_others(scenes, capsys):
    assert estimate(scenes / 'empty.png', scenes / 'a.png') == 1
    out, err = capsys.readouterr()
    assert err == f'p4pfr: {scenes / "empty.png"}: no 9x6 chessboard found\n'
    assert '54/54' in out


def test_json_has_the_reason(scenes, capsys):
    assert estimate(scenes / 'empty.png', scenes / 'a.png', '--json') == 1
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert first == {'image': str(scenes / 'empty.png'), 'reason': 'no 9x6 chessboard found'}
    assert 'reason' not in second


def test_missing_and_truncated_images_do_not_affect_the_others(scenes, tmp_path, capsys):
    truncated = tmp_path / 'truncated.png'
    truncated.write_bytes((scenes / 'a.png').read_bytes()[:2000])
    assert estimate(tmp_path / 'none.png', truncated, scenes / 'a.png') == 1
    out, err = capsys.readouterr()
    first, second = err.splitlines()
    assert first.startswith(f'p4pfr: {tmp_path / "none.png"}: expected a readable image')
    assert second == f'p4pfr: {truncated}: expected a complete image, got a truncated file'
    assert '54/54' in out


def test_directory_is_replaced_by_its_images_in_order(tmp_path, capsys):
    for name in ('2.png', '1.PNG', 'notes.txt'):
        (tmp_path / name).write_text('not an image')
    assert estimate(tmp_path) == 1
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith(f'p4pfr: {tmp_path / "1.PNG"}: ')
    assert second.startswith(f'p4pfr: {tmp_path / "2.png"}: ')


def test_directory_without_images_is_an_error(tmp_path, capsys):
    assert estimate(tmp_path) == 1
    expected = f'p4pfr: {tmp_path}: expected a directory with images, got none\n'
    assert capsys.readouterr().err == expected


def test_head_on_view_reports_what_it_does_not_determine(tmp_path, capsys):
    write_scene(tmp_path / 'flat.png', CHESSBOARD, turn_rad=np.zeros(3))
    assert estimate(tmp_path / 'flat.png', '--json') == 0
    line = json.loads(capsys.readouterr().out)
    assert {'distance', 'focal'} <= set(line['not_observable'])
    assert line['focal_px'] is line['distance_m'] is line['position_m'] is None
    assert line['sigma']['focal_px'] is None
    assert line['rms_px'] < 0.3
    assert estimate(tmp_path / 'flat.png') == 0
    out = capsys.readouterr().out
    assert 'flat.png: not determined by this view: distance, focal' in out
    assert ' ? ' in out


def test_ambiguous_view_lists_its_candidates(tmp_path, capsys):
    # A view that fits two cameras equally well.
    write_scene(tmp_path / 'm.png', MARKER, turn_rad=(-0.45, 0.84, 0.28), at_m=(-0.24, 0.11, 0.42))
    assert estimate(tmp_path / 'm.png', '--json', board=MARKER) == 0
    line = json.loads(capsys.readouterr().out)
    assert line['points'] == 4
    assert len(line['candidates']) == 2
    focal_px = [candidate['focal_px'] for candidate in line['candidates']]
    assert min(focal_px, key=lambda f: abs(f - FOCAL_PX)) == pytest.approx(FOCAL_PX, rel=0.15)
    assert estimate(tmp_path / 'm.png', board=MARKER) == 0
    assert 'm.png: 2 solutions fit this view equally well' in capsys.readouterr().out


def test_draw_writes_the_annotated_image(scenes, tmp_path):
    folder = tmp_path / 'new' / 'drawn'
    assert estimate(scenes / 'a.png', '--draw', folder) == 0
    drawn, original = read_image(folder / 'a_pose.png'), read_image(scenes / 'a.png')
    assert drawn.shape == (*original.shape, 3)  # the original is grey
    coloured = np.ptp(drawn.astype(int), axis=2) > 60
    assert 0.005 < coloured.mean() < 0.3


def test_draw_shows_why_there_is_no_estimate(tmp_path, capsys):
    """The reason is written on the image, at the top."""
    write_empty(tmp_path / 'empty.png')
    assert estimate(tmp_path / 'empty.png', '--draw', tmp_path / 'drawn') == 1
    drawn = read_image(tmp_path / 'drawn/empty_pose.png')
    assert drawn[:30].max() > 200
    assert 'no 9x6 chessboard found' in capsys.readouterr().err


def test_large_images_are_rejected_by_their_size(scenes, capsys):
    assert estimate(scenes / 'a.png', '--max-megapixels', '0.3') == 1
    assert 'a.png: expected at most 0.3 megapixels' in capsys.readouterr().err
    assert estimate(scenes / 'a.png', '--max-megapixels', '0.31') == 0


def test_draw_does_not_write_two_images_to_one_file(scenes, tmp_path, capsys):
    twin = tmp_path / 'a.png'
    assert estimate(scenes / 'a.png', twin, '--draw', tmp_path / 'drawn') == 1
    expected = f'p4pfr: --draw: {scenes / "a.png"} and {twin} would be written to the same file\n'
    assert capsys.readouterr().err == expected


def test_wrong_board_file_is_reported_in_one_line(tmp_path, capsys):
    wrong = tmp_path / 'wrong.yaml'
    wrong.write_text('boards: {board: {type: chessboard, columns: 9, rows: 6, square_m: -1}}')
    assert estimate('a.png', board=str(wrong)) == 1
    out, err = capsys.readouterr()
    assert out == ''
    assert err.count('\n') == 1
    assert err.startswith(f'p4pfr: {wrong}: boards.board.square_m: expected ')


@pytest.mark.parametrize(
    'wrong',
    [
        ['--center', 'nan', '0'],
        ['--threshold', '0'],
        ['--threshold', 'nan'],
        ['--sigma', '0'],
        ['--seed', 'x'],
        ['--seed', '-5'],
        ['--seed', '1.5'],
        ['--seed', '99999999999999999999999'],
        ['--unknown'],
    ],
)
def test_wrong_option_is_reported(wrong, capsys):
    with pytest.raises(SystemExit) as exit_:
        estimate('a.png', *wrong)
    assert exit_.value.code == 2
    assert wrong[0] in capsys.readouterr().err


def test_options_have_the_defaults_and_descriptions_of_the_api(capsys):
    with pytest.raises(SystemExit):
        main(['estimate', '--help'])
    text = ' '.join(capsys.readouterr().out.split())
    assert f'are outliers, pixels (default: {EstimateOptions().threshold_px})' in text
    assert f'(default: {EstimateOptions().seed})' in text


def test_center_is_used(scenes, capsys):
    assert estimate(scenes / 'a.png', '--json', '--center', 310, 245) == 0
    assert json.loads(capsys.readouterr().out)['center_px'] == [310.0, 245.0]


def test_a_mirrored_order_is_reported_unless_the_board_is_two_sided(scenes, capsys, monkeypatch):
    def mirrored(image, board):
        detection = detect(image, board)
        return replace(detection, board_points=detection.board_points * [-1.0, 1.0])

    monkeypatch.setattr('p4pfr_ros.cli.estimate.detect', mirrored)
    path = str(scenes / 'a.png')
    reason = 'the board would be seen from behind: is the corner order right?'
    assert estimate(path) == 1
    assert capsys.readouterr().err == f'p4pfr: {path}: {reason}\n'
    assert estimate(path, '--json') == 1
    line = json.loads(capsys.readouterr().out)
    assert line == {'image': path, 'reason': reason, 'status': 'seen_from_behind'}
    assert estimate(path, '--json', '--two-sided') == 0
    line = json.loads(capsys.readouterr().out)
    assert line['status'] == 'confident'
    assert line['tilt_deg'] > 90.0


@pytest.mark.parametrize('roll_deg', [10.0, 170.0])
def test_a_symmetric_board_has_both_poses_as_candidates(tmp_path, capsys, roll_deg):
    board = tmp_path / 'board.yaml'
    board.write_text('boards: {wall: {type: chessboard, columns: 7, rows: 5, square_m: 0.03}}')
    roll = Pose.from_rotation_vector([0.0, 0.0, np.radians(roll_deg)], np.zeros(3))
    pose = write_scene(tmp_path / 'a.png', str(board), turn_rad=(TILT @ roll).rotation_vector)
    assert estimate(tmp_path / 'a.png', '--json', board=str(board)) == 0
    line = json.loads(capsys.readouterr().out)
    rotations = [
        Pose.from_quaternion_xyzw(each['quaternion_xyzw'], [0, 0, 0]).rotation
        for each in line['candidates']
    ]
    turns = rotations[0].T @ rotations
    assert any(np.allclose(turn, np.diag([-1.0, -1.0, 1.0])) for turn in turns)
    assert min(rotation_angle_rad(rotation, pose.rotation) for rotation in rotations) < 0.02
    assert line['quaternion_xyzw'] == line['candidates'][0]['quaternion_xyzw']


def test_a_centre_far_outside_every_image_is_a_wrong_argument(scenes, capsys):
    with pytest.raises(SystemExit) as exit_info:
        estimate(scenes / 'a.png', '--center', '1e300', '0')
    assert exit_info.value.code == 2
    assert 'argument --center: expected a number from -10000000 to 10000000' in (
        capsys.readouterr().err
    )
