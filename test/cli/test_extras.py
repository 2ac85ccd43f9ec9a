# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Without its optional dependencies, each command works or names the extra to install."""

import json
import subprocess
import sys

from p4pfr_ros.files.dependencies import EXTRAS, install_command
import pytest
from rendered import CHESSBOARD, write_scene

# As if the module were not installed: importing it raises ModuleNotFoundError.
RUN = """
import sys
sys.modules.update(dict.fromkeys({missing!r}))
from p4pfr_ros.cli import main
sys.exit(main({arguments!r}))
"""
TABLES = f'p4pfr: tables need rich: {install_command(EXTRAS["rich"])}\n'
PLOTS = (
    f'p4pfr: plots and printed boards need matplotlib: {install_command(EXTRAS["matplotlib"])}\n'
)
PAGES = f'p4pfr: web pages need aiohttp: {install_command(EXTRAS["aiohttp"])}\n'


@pytest.fixture
def image(tmp_path):
    """Return the path of an image of the chessboard."""
    write_scene(tmp_path / 'view.png', CHESSBOARD)
    return str(tmp_path / 'view.png')


def run_without(missing, *arguments):
    """Run the command in a process that lacks some modules."""
    code = RUN.format(missing=missing, arguments=list(map(str, arguments)))
    return subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)


def test_estimate_prints_json_without_extras(image, tmp_path):
    arguments = ['estimate', '--board', CHESSBOARD, image, '--draw', tmp_path / 'drawn']
    run = run_without(['rich', 'matplotlib'], *arguments, '--json')
    assert run.returncode == 0, run.stderr
    assert [json.loads(line)['image'] for line in run.stdout.splitlines()] == [image]


def test_calibrate_prints_json_without_extras(image, tmp_path):
    arguments = ['calibrate', '--board', CHESSBOARD, image, '-o', tmp_path / 'camera.yaml']
    run = run_without(['rich', 'matplotlib'], *arguments, '--json', '--force')
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout.splitlines()[-1])['calibration']['views'] == 1
    assert (tmp_path / 'camera.yaml').exists()


@pytest.mark.parametrize('command', ['estimate', 'calibrate'])
def test_tables_need_rich(tmp_path, command):
    """Reported before the images are read."""
    output = ['-o', tmp_path / 'camera.yaml'] if command == 'calibrate' else []
    run = run_without(['rich'], command, '--board', CHESSBOARD, 'none.png', *output)
    assert (run.returncode, run.stdout, run.stderr) == (1, '', TABLES)


def test_plots_need_matplotlib(tmp_path):
    output = ['-o', tmp_path / 'camera.yaml', '--plot', tmp_path / 'report.png']
    run = run_without(['matplotlib'], 'calibrate', '--board', CHESSBOARD, 'none.png', *output)
    assert (run.returncode, run.stdout, run.stderr) == (1, '', PLOTS)


def test_printed_boards_need_matplotlib(tmp_path):
    output = tmp_path / 'board.pdf'
    run = run_without(['matplotlib'], 'board', CHESSBOARD, '-o', output)
    assert (run.returncode, run.stdout, run.stderr) == (1, '', PLOTS)
    assert run_without(['rich'], 'board', CHESSBOARD, '-o', output).returncode == 0
    assert output.exists()


def test_a_batch_needs_distributed(tmp_path):
    run = run_without(['distributed'], 'batch', tmp_path, '--board', CHESSBOARD, '-o', tmp_path)
    command = install_command(EXTRAS['distributed'])
    message = f'p4pfr: batches of recordings need distributed: {command}\n'
    assert (run.returncode, run.stdout, run.stderr) == (1, '', message)


def test_the_demo_needs_rich():
    run = run_without(['rich'], 'demo')
    assert (run.returncode, run.stdout, run.stderr) == (1, '', TABLES)


def test_web_pages_need_aiohttp():
    run = run_without(['aiohttp'], 'live', '0', '--board', CHESSBOARD)
    assert (run.returncode, run.stdout, run.stderr) == (1, '', PAGES)


def test_the_html_report_needs_no_extra(image, tmp_path):
    arguments = ['calibrate', '--board', CHESSBOARD, image, '-o', tmp_path / 'camera.yaml']
    arguments += ['--report', tmp_path / 'report.html', '--json', '--force']
    run = run_without(['rich', 'matplotlib', 'aiohttp'], *arguments)
    assert run.returncode == 0, run.stderr
    assert '<title>Calibration of camera</title>' in (tmp_path / 'report.html').read_text()


def test_help_needs_no_extra():
    run = run_without(['rich', 'matplotlib', 'rosbags'], '--help')
    assert run.returncode == 0
    assert run.stdout.startswith('usage: p4pfr')
