# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Videos, standard input and bags as sources; CSV and trajectories as output."""

import csv
import io
import json
import subprocess
import sys

import cv2
import numpy as np
from p4pfr_ros import Pose
from p4pfr_ros.cli import main
from p4pfr_ros.files.images import read_image
import pytest
import recorded
from rendered import CHESSBOARD, write_empty, write_views

COUNT = 6
FPS = 20.0


@pytest.fixture(scope='module')
def views(tmp_path_factory):
    """Return a folder with views, and a video of them without loss."""
    folder = tmp_path_factory.mktemp('views')
    paths = write_views(folder, COUNT)
    video = cv2.VideoWriter(
        str(folder / 'walk.avi'), cv2.VideoWriter_fourcc(*'FFV1'), FPS, (640, 480)
    )
    assert video.isOpened()
    for path in paths:
        video.write(cv2.imread(str(path)))
    video.release()
    return folder


@pytest.fixture(scope='module')
def camera(views):
    """Return the calibration from the views."""
    path = views / 'camera.yaml'
    arguments = ['--board', CHESSBOARD, '-o', str(path), '--force', '--json']
    assert main(['calibrate', str(views / 'walk.avi'), *arguments]) == 0
    return path


def estimate(capsys, *arguments):
    """Run the command; return its output."""
    assert main(['estimate', '--board', CHESSBOARD, *map(str, arguments)]) == 0
    out, err = capsys.readouterr()
    assert err == ''
    return out


def from_stdin(data, *arguments):
    """Run the command with data as its standard input."""
    command = [sys.executable, '-m', 'p4pfr_ros', 'estimate', '-', '--board', CHESSBOARD]
    return subprocess.run([*command, *arguments], input=data, capture_output=True)


def numbers(text):
    """Return the estimates of JSON lines without what names the images."""
    lines = [json.loads(line) for line in text.splitlines()]
    return [{k: v for k, v in line.items() if k not in ('image', 'stamp_s')} for line in lines]


def test_a_video_gives_the_estimates_of_its_frames(views, capsys):
    text = estimate(capsys, views / 'walk.avi', '--json')
    assert numbers(text) == numbers(estimate(capsys, views, '--json'))
    lines = [json.loads(line) for line in text.splitlines()]
    assert [line['image'] for line in lines] == [f'{views}/walk.avi#{n}' for n in range(COUNT)]
    assert [line['stamp_s'] for line in lines] == pytest.approx(np.arange(COUNT) / FPS)


def test_every_second_frame_is_used_and_drawn(views, tmp_path, capsys):
    text = estimate(capsys, views / 'walk.avi', '--json', '--every', 2, '--draw', tmp_path / 'd')
    assert [json.loads(line)['image'][-2:] for line in text.splitlines()] == ['#0', '#2', '#4']
    names = sorted(path.name for path in (tmp_path / 'd').iterdir())
    assert names == [f'walk_{n:06}_pose.png' for n in (0, 2, 4)]


def test_a_video_gives_the_camera_of_its_frames(views, camera, tmp_path):
    output = tmp_path / 'camera.yaml'
    images = [str(path) for path in sorted(views.glob('*.png'))]
    arguments = ['--board', CHESSBOARD, '-o', str(output), '--force', '--json']
    assert main(['calibrate', *images, *arguments]) == 0
    assert output.read_text() == camera.read_text()


def test_standard_input_is_images_or_a_video(views, capsys):
    expected = numbers(estimate(capsys, views, '--json'))
    images = b''.join(path.read_bytes() for path in sorted(views.glob('*.png')))
    for data in (images, (views / 'walk.avi').read_bytes()):
        run = from_stdin(data, '--json')
        assert run.stderr == b''
        assert numbers(run.stdout.decode()) == expected


@pytest.mark.parametrize(
    ('data', 'reason'),
    [
        (b'', 'standard input: expected images or a video, got nothing'),
        (
            b'hello\n' * 2000,
            'standard input: expected a video that OpenCV reads, got another format',
        ),
    ],
)
def test_wrong_standard_input_is_reported_in_one_line(data, reason):
    run = from_stdin(data, '--json')
    assert (run.returncode, run.stdout) == (1, b'')
    assert run.stderr.decode() == f'p4pfr: {reason}\n'


def test_wrong_videos_are_reported_in_one_line(tmp_path, capfd):
    text = tmp_path / 'text.mp4'
    text.write_text('hello')
    reasons = {
        text: 'expected a video that OpenCV reads, got another format',
        tmp_path / 'none.mp4': 'expected a video: no such file',
    }
    for path, reason in reasons.items():
        assert main(['estimate', '--board', CHESSBOARD, str(path)]) == 1
        assert capfd.readouterr().err == f'p4pfr: {path}: {reason}\n'


def test_csv_has_the_numbers_of_json_and_the_reasons(views, tmp_path, capsys):
    write_empty(tmp_path / 'empty.png')
    images = [views / 'view00.png', tmp_path / 'empty.png']
    assert main(['estimate', '--board', CHESSBOARD, '--csv', *map(str, images)]) == 1
    first, second = csv.DictReader(io.StringIO(capsys.readouterr().out))
    [line] = (json.loads(text) for text in estimate(capsys, images[0], '--json').splitlines())
    assert [float(first[key]) for key in ('x_m', 'y_m', 'z_m')] == line['position_m']
    assert [float(first[key]) for key in ('qx', 'qy', 'qz', 'qw')] == line['quaternion_xyzw']
    for key in ('tilt_deg', 'distance_m', 'focal_px', 'k', 'rms_px'):
        assert float(first[key]) == line[key]
    assert float(first['sigma_focal_px']) == line['sigma']['focal_px']
    assert (first['points'], first['inliers'], first['candidates']) == ('54', '54', '1')
    assert (first['status'], first['reason']) == ('confident', '')
    assert (second['reason'], second['x_m']) == ('no 9x6 chessboard found', '')


def test_a_trajectory_has_the_pose_of_what_moves(views, camera, capsys):
    json_lines = estimate(capsys, views / 'walk.avi', '--json', '--camera', camera).splitlines()
    tracks = {}
    for moving, name in (('camera', 'board_from_camera'), ('board', 'camera_from_board')):
        arguments = (views / 'walk.avi', '--tum', '--moving', moving, '--camera', camera)
        heading, *lines = estimate(capsys, *arguments).splitlines()
        assert heading == f'# {name}: timestamp tx ty tz qx qy qz qw'
        tracks[moving] = np.array([line.split() for line in lines], dtype=float)
        assert tracks[moving][:, 0] == pytest.approx(np.arange(COUNT) / FPS)
    for line, board, camera_row in zip(json_lines, tracks['board'], tracks['camera'], strict=True):
        expected = json.loads(line)
        assert board[1:4].tolist() == pytest.approx(expected['position_m'], abs=1e-8)
        pose, inverse = (
            Pose.from_quaternion_xyzw(row[4:], row[1:4]) for row in (board, camera_row)
        )
        np.testing.assert_allclose((pose @ inverse).matrix, np.eye(4), atol=1e-7)


def test_image_files_that_are_named_by_stamps_have_them(views, tmp_path, capsys):
    """As in the data sets of ETH (nanoseconds) and TUM (seconds)."""
    for name in ('1403636579763555584', '1305031102.1753'):
        (tmp_path / f'{name}.png').write_bytes((views / 'view01.png').read_bytes())
    _, *lines = estimate(capsys, tmp_path, '--tum').splitlines()
    assert [line.split()[0] for line in lines] == ['1305031102.175300000', '1403636579.763555584']
    # Others are numbered.
    _, *lines = estimate(capsys, views, '--tum', '--every', 3).splitlines()
    assert [line.split()[0] for line in lines] == ['0', '1']


def test_a_bag_is_a_source_too(views, tmp_path, capsys):
    images = [read_image(path) for path in sorted(views.glob('*.png'))]
    messages = [recorded.image_message(image, second) for second, image in enumerate(images)]
    bag = recorded.write_bag(tmp_path / 'bag', 'mcap', {'/image': messages})
    expected = numbers(estimate(capsys, views, '--json'))
    for arguments in (['--bag', bag], [bag], [bag, '--topic', '/image']):
        assert numbers(estimate(capsys, *arguments, '--json')) == expected
    _, *lines = estimate(capsys, bag, '--tum').splitlines()
    stamps = [f'{recorded.FIRST_STAMP_S + second}.025000000' for second in range(COUNT)]
    assert [line.split()[0] for line in lines] == stamps


def test_frames_without_the_board_are_counted_and_no_failure(views, tmp_path, capsys):
    images = [read_image(views / 'view00.png'), *[np.full((480, 640), 99, np.uint8)] * 3]
    messages = [recorded.image_message(image, second) for second, image in enumerate(images)]
    bag = recorded.write_bag(tmp_path / 'bag', 'mcap', {'/image': messages, '/b': messages[1:]})
    assert main(['estimate', '--board', CHESSBOARD, bag, '--topic', '/image', '--csv']) == 0
    out, err = capsys.readouterr()
    assert len(out.splitlines()) == 5
    assert err == f'p4pfr: {bag} /image: 3 images: no 9x6 chessboard found\n'
    assert main(['estimate', '--board', CHESSBOARD, bag, '--topic', '/b', '--csv']) == 1
