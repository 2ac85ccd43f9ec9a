# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every code block of the README and of the pages is run, or says why not."""

import re
import sys

from blocks import blocks_of, PAGES, ROOT
from p4pfr_ros.files.boards import load_boards
import pytest
from ros_lines import check_launch_file, check_parameter_file
from shell_lines import run_lines
import yaml

PAGES_WITH_CODE = [path for path in PAGES if blocks_of(path)]


@pytest.mark.parametrize('path', PAGES_WITH_CODE, ids=lambda path: str(path.relative_to(ROOT)))
def test_blocks_of_a_page_run_in_order(path, folder):
    """In one folder, and the Python blocks in one session."""
    namespace = {}
    for block in blocks_of(path):
        if block.reason:
            continue
        try:
            _run(block, folder, namespace)
        except Exception as error:
            raise AssertionError(f'{block.place}: {error!r}\n{block.text}') from error


@pytest.mark.parametrize(
    ('language', 'text', 'message'),
    [
        ('sh', 'rm -rf /', 'cannot run rm'),
        ('sh', 'make nothing', 'make has no nothing'),
        ('sh', "pip install '.[nothing]'", 'nothing'),
        ('sh', 'p4pfr board missing.yaml -o b.pdf', 'exit status 1'),
        ('sh', 'python -m benchmarks.minimal --nothing', 'has no --nothing'),
        ('sh', 'ros2 run p4pfr_ros nothing', 'nothing'),
        ('sh', 'ros2 run other node', 'other node'),
        ('sh', 'ros2 run image_proc rectify_node --ros-args -r a:=/pose_node/b', '/pose_node/b'),
        ('sh', 'export A=$(ros2 pkg prefix --share p4pfr_ros)/config/nothing', 'nothing'),
        ('sh', 'ros2 run p4pfr_ros pose_node --ros-args -p nothing:=1', 'no parameter nothing'),
        ('sh', 'ros2 run p4pfr_ros pose_node --ros-args -p publish_tf:=1', 'publish_tf: 1'),
        ('sh', 'ros2 run p4pfr_ros pose_node --ros-args -r nothing:=a', 'has no nothing'),
        ('sh', 'ros2 launch p4pfr_ros p4pfr.launch.py', 'board_file is missing'),
        ('sh', 'ros2 launch p4pfr_ros demo.launch.py nothing:=1', 'not declared'),
        ('sh', 'ros2 topic echo /nothing', 'no node has /nothing'),
        ('sh', 'ros2 service call /pose_node/reset_calibration std_srvs/srv/Empty', 'Empty'),
        ('sh', 'ros2 param set /pose_node robust.seed 1.5', 'robust.seed'),
        ('yaml', 'boards: {a: {type: nothing}}', 'nothing'),
        ('yaml', '/**/pose_node: {ros__parameters: {nothing: 1}}', 'no parameter nothing'),
        ('yaml', 'other: {nothing: 1}', 'ros__parameters'),
        ('python', 'import p4pfr_ros\np4pfr_ros.nothing', 'nothing'),
        ('console', '$ p4pfr --version\nother 1.0', 'other'),
        ('cobol', 'DISPLAY 1', 'cobol'),
    ],
)
def test_wrong_blocks_fail(language, text, message, folder):
    """Each kind of check notices a mistake."""
    path = folder / 'page.md'
    path.write_text(f'```{language}\n{text}\n```\n')
    [block] = blocks_of(path)
    with pytest.raises(Exception, match=re.escape(message)):
        _run(block, folder, {})


def test_unclosed_blocks_are_noticed(tmp_path):
    path = tmp_path / 'page.md'
    path.write_text('```sh\nmake test\n')
    with pytest.raises(AssertionError):
        blocks_of(path)


def _run(block, folder, namespace):
    if block.file_name:
        (folder / block.file_name).write_text(block.text)
    runners = {
        'sh': lambda: run_lines(block.text),
        'console': lambda: _run_console(block.text),
        'python': lambda: _run_python(block, folder, namespace),
        'yaml': lambda: _run_yaml(block.text, folder),
    }
    runners[block.language]()


def _run_python(block, folder, namespace):
    if 'def generate_launch_description' in block.text:
        path = folder / 'snippet.launch.py'
        path.write_text(block.text)
        given = {'board_file': 'board.yaml'} if "'board_file'" in block.text else {}
        check_launch_file(path, given)
        return
    code = compile(block.text, block.place, 'exec')
    sys.stdout.flush()
    exec(code, namespace)


def _run_yaml(text, folder):
    content = yaml.safe_load(text)
    if 'boards' in content or 'target_type' in content:
        path = folder / 'snippet.yaml'
        path.write_text(text)
        load_boards(path)
    else:
        check_parameter_file(content)


def _run_console(text):
    """Run the lines after $; compare what they print, apart from numbers and spaces."""
    commands = re.findall(r'^\$ (.*(?:\\\n.*)*)$', text, re.MULTILINE)
    shown = re.sub(r'^\$ .*(?:\\\n.*)*$\n', '', text, flags=re.MULTILINE)
    printed = [_shape(line) for line in run_lines('\n'.join(commands)).splitlines()]
    for line in shown.splitlines():
        if line.strip() not in ('', '...'):
            assert _shape(line) in printed, f'{line!r} is not printed, but\n' + '\n'.join(printed)


def _shape(line):
    line = re.sub('[.#]{16}', 'CELLS', line)  # a row of a map of coverage
    return re.sub(r'-?\d+(\.\d+)?(e-?\d+)?', '#', ' '.join(line.replace('─', '').split()))
