# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr live``: errors in one line, and a clean end. What the page shows is tested in live/."""

import re
import signal
import socket
import subprocess
import sys
import urllib.request

import pytest
from rendered import CHESSBOARD, write_empty, write_views

COMMAND = [sys.executable, '-m', 'p4pfr_ros', 'live', '--board', CHESSBOARD]


def run(*arguments, cwd):
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)


def last_line(text):
    return text.splitlines()[-1]


@pytest.mark.parametrize('arguments', [(), ('0', '--topic', '/image')])
def test_one_source_is_needed(arguments, tmp_path):
    ended = run(*arguments, cwd=tmp_path)
    assert ended.returncode == 2
    assert last_line(ended.stderr).endswith('error: expected either SOURCE or --topic')


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['none.mp4'], 'none.mp4: expected a video: no such file'),
        (['.', '-o', '/proc/no/camera.yaml'], '/proc/no/camera.yaml: expected a writable path'),
        (['.', '--host', 'no-such-host.invalid'], 'cannot listen on no-such-host.invalid:0: '),
        (['.', '--board', 'none.yaml'], 'none.yaml: expected a readable file'),
    ],
)
def test_errors_are_one_line(arguments, reason, tmp_path):
    ended = run(*arguments, '--port', 0, cwd=tmp_path)
    assert ended.returncode == 1
    [line] = ended.stderr.splitlines()
    assert line.startswith(f'p4pfr: {reason}')


def test_a_port_that_is_taken_is_one_line(tmp_path):
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        ended = run('.', '--port', port, cwd=tmp_path)
    assert (ended.returncode, ended.stdout) == (1, '')
    expected = f'p4pfr: cannot listen on 127.0.0.1:{port}: Address already in use\n'
    assert ended.stderr == expected


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_a_signal_ends_it_and_what_is_lost_is_said(number, tmp_path):
    """After the end of the images as well; the exit status is 0."""
    write_views(tmp_path, 3)
    write_empty(tmp_path / 'empty.png')
    command = [*COMMAND, str(tmp_path), '--port', '0', '-o', str(tmp_path / 'camera.yaml')]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        address = re.search(
            r'open (http://localhost:\d+/) \(Ctrl-C ends\)', process.stdout.readline()
        )
        assert address
        assert process.stdout.readline() == f'{tmp_path}: end of the images; the page stays\n'
        with urllib.request.urlopen(address.group(1)) as page:
            assert b'<title>Camera calibration</title>' in page.read()
        process.send_signal(number)
        assert process.wait(30.0) == 0
        assert process.stderr.read() == 'p4pfr: the camera was not saved\n'
    finally:
        process.kill()
        process.communicate()


def test_a_token_is_printed_with_an_address_for_others(tmp_path):
    write_empty(tmp_path / 'empty.png')
    command = [*COMMAND, str(tmp_path / 'empty.png'), '--host', '0.0.0.0', '--port', '0']
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    try:
        assert re.search(r'http://[\w.-]+:\d+/\?token=[\w-]{20,} ', process.stdout.readline())
        process.terminate()
        assert process.wait(30.0) == 0
    finally:
        process.kill()
        process.communicate()
