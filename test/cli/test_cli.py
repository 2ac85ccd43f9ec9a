# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command ``p4pfr`` as a process; ``p4pfr board`` and ``p4pfr demo``."""

import json
import math
import os
import pty
import signal
import subprocess
import sys

import cv2
import numpy as np
from p4pfr_ros.cli import main
from p4pfr_ros.detection import detect
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.dependencies import how_to_get_ros
from p4pfr_ros.files.images import read_image
import pytest
from rendered import CHESSBOARD, write_empty

COMMAND = [sys.executable, '-m', 'p4pfr_ros', 'estimate', '--board', CHESSBOARD, '--json']


@pytest.fixture
def empty(tmp_path):
    """Return the path of an image without a board."""
    write_empty(tmp_path / 'empty.png')
    return str(tmp_path / 'empty.png')


def test_printed_board_is_detected(tmp_path, capsys):
    path = tmp_path / 'board.png'
    assert main(['board', CHESSBOARD, '-o', str(path), '--dpi', '100']) == 0
    assert capsys.readouterr().out.startswith(f'{path}: board: chessboard 9x6')
    image = read_image(path)
    assert image.shape[1] == math.ceil(275.0 / 25.4 * 100.0)  # eleven squares of 25 mm
    found, _ = cv2.findChessboardCorners(image, (9, 6))
    assert found


def test_board_rejects_other_formats(tmp_path, capsys):
    assert main(['board', CHESSBOARD, '-o', str(tmp_path / 'board.gif')]) == 1
    err = capsys.readouterr().err
    assert err == f'p4pfr: {tmp_path}/board.gif: expected a name that ends in .pdf or .png\n'


@pytest.mark.parametrize('dpi', ['2', '0.001'])
def test_board_rejects_low_resolutions(tmp_path, capsys, dpi):
    path = tmp_path / 'board.png'
    assert main(['board', CHESSBOARD, '-o', str(path), '--dpi', dpi]) == 1
    assert capsys.readouterr().err == f'p4pfr: {path}: expected at least 20 dpi, got {dpi}\n'
    assert not path.exists()
    assert main(['board', CHESSBOARD, '-o', str(path), '--dpi', '20']) == 0


def test_closed_pipe_ends_quietly(empty):
    with many_images(empty, 200) as process:
        process.stdout.readline()
        process.stdout.close()
        err = process.stderr.read()
    assert process.returncode == 128 + signal.SIGPIPE
    assert err == ''


def test_pipe_closed_before_the_last_flush_ends_quietly(tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    board = [sys.executable, '-m', 'p4pfr_ros', 'board', CHESSBOARD, '-o', tmp_path / 'board.png']
    # Buffered, the default for a pipe, so that the flush at the end fails.
    buffered = {key: value for key, value in os.environ.items() if key != 'PYTHONUNBUFFERED'}
    run = subprocess.run(board, stdout=writer, stderr=subprocess.PIPE, text=True, env=buffered)
    os.close(writer)
    assert run.returncode == 128 + signal.SIGPIPE
    assert run.stderr == ''


def test_interrupt_ends_quietly(empty):
    with many_images(empty, 2000) as process:
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate()
    assert process.returncode == 128 + signal.SIGINT
    assert err == ''


def many_images(empty, count):
    """Start the command on many images."""
    pipe = subprocess.PIPE
    return subprocess.Popen([*COMMAND, *[empty] * count], stdout=pipe, stderr=pipe, text=True)


def test_bar_is_on_stderr_and_results_are_on_stdout(empty):
    terminal, device = pty.openpty()
    run = subprocess.run(
        [*COMMAND, empty, empty],
        stdout=subprocess.PIPE,
        stderr=device,
        text=True,
        env={**os.environ, 'TERM': 'xterm'},
    )
    os.close(device)
    on_terminal = os.read(terminal, 100_000).decode()
    os.close(terminal)
    assert len([json.loads(line) for line in run.stdout.splitlines()]) == 2
    assert 'images' in on_terminal
    assert '%' in on_terminal


def test_demo_without_ros_names_the_extra():
    code = (
        "import sys; sys.modules['rclpy'] = None; from p4pfr_ros.cli import main; main(['demo'])"
    )
    err = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True).stderr
    assert err == (f'p4pfr: the demo requires ROS 2 (rclpy is missing): {how_to_get_ros()}\n')


@pytest.mark.parametrize('arguments', [[], ['fly'], ['estimate', 'a.png'], ['board', 'b.yaml']])
def test_wrong_usage_is_status_2(arguments, capsys):
    with pytest.raises(SystemExit) as exit_:
        main(arguments)
    assert exit_.value.code == 2
    assert capsys.readouterr().err.startswith('usage: p4pfr')


def test_a_symmetric_board_is_printed_with_a_note(tmp_path, capsys):
    board = tmp_path / 'board.yaml'
    for columns, lines in ((7, 2), (8, 1)):
        text = f'type: chessboard, columns: {columns}, rows: 5, square_m: 0.03'
        board.write_text(f'boards: {{wall: {{{text}}}}}')
        assert main(['board', str(board), '-o', str(tmp_path / 'b.png'), '--dpi', '50']) == 0
        out = capsys.readouterr().out
        assert len(out.splitlines()) == lines
        assert ('wall: the board looks the same after a turn of 180 degrees' in out) == (
            lines == 2
        )


def test_a_board_on_paper_of_a_size_is_detected(tmp_path, capsys):
    """Ruler and name are on the page, and the pattern is to scale in its middle."""
    path = tmp_path / 'board.png'
    arguments = ['board', CHESSBOARD, '-o', str(path), '--dpi', '100']
    assert main([*arguments, '--paper', 'A4']) == 0
    image = read_image(path)
    assert image.shape[:2] == (math.ceil(210.0 / 0.254), math.ceil(297.0 / 0.254))
    board = load_board(CHESSBOARD)
    points = detect(image, board)
    middle = 0.5 * np.array(image.shape[1::-1]) - 0.5
    truth = middle + 100.0 / 0.0254 * board.points * [1.0, -1.0]
    np.testing.assert_allclose(points.image_points, truth, atol=0.2)
    capsys.readouterr()
    large = tmp_path / 'large.yaml'
    large.write_text('boards: {b: {type: chessboard, columns: 9, rows: 6, square_m: 0.03}}')
    arguments[1] = str(large)
    assert main([*arguments, '--paper', 'A4']) == 1
    assert capsys.readouterr().err == (
        'p4pfr: b: expected a board that fits on A4 (297 x 210 mm) with margins of 5 mm, '
        'got a pattern of 300 x 210 mm\n'
    )
    assert main([*arguments, '--paper', 'A3']) == 0


@pytest.mark.parametrize(
    ('length', 'size'), [('square_m: 25', '275 x 200 m'), ('square_mm: 0.025', '0.275 x 0.2 mm')]
)
def test_a_length_that_is_likely_in_the_wrong_unit_is_warned_of(
    tmp_path, empty, capsys, length, size
):
    board = tmp_path / 'board.yaml'
    board.write_text(f'boards: {{wall: {{type: chessboard, columns: 9, rows: 6, {length}}}}}')
    assert main(['estimate', '--board', str(board), empty]) == 1
    first, _ = capsys.readouterr().err.splitlines()
    unit = 'metres' if ' m' in size and 'mm' not in size else 'millimetres'
    assert first.startswith(
        f'p4pfr: {board}: warning: wall: {size} is an unlikely size of a board'
    )
    assert first.endswith(f'are {unit}')
    main(['estimate', '--board', CHESSBOARD, empty])
    assert 'warning' not in capsys.readouterr().err
