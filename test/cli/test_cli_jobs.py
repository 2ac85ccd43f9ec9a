# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Several processes give the results of one, and end with the command."""

import os
import signal
import subprocess
import sys

from p4pfr_ros.cli import main, workers
from p4pfr_ros.files.yaml_fields import ConfigError
from processes import end, has_ended, own_lines, wait_until
import pytest
from rendered import CHESSBOARD, write_empty, write_views


@pytest.fixture(scope='module')
def views(tmp_path_factory):
    """Return a folder with views, and an image without the board among them."""
    folder = tmp_path_factory.mktemp('views')
    write_views(folder, 11)
    write_empty(folder / 'view05b.png')
    return folder


@pytest.fixture
def eager(monkeypatch):
    """Start processes for however few images."""
    monkeypatch.setattr(workers, 'WORTH_S', 0.0)


def outputs(capsys, *arguments):
    """Run a command with one job and with two; return what each printed."""
    printed = []
    for jobs in ('1', '2'):
        main([*map(str, arguments), '--board', CHESSBOARD, '--jobs', jobs])
        printed.append(capsys.readouterr())
    return printed


def test_estimates_are_the_same_bit_for_bit(eager, views, capsys):
    one, two = outputs(capsys, 'estimate', views, '--json')
    assert one.out == two.out
    assert one.err == two.err
    assert len(one.out.splitlines()) == 12


def test_a_calibration_is_the_same_bit_for_bit(eager, views, tmp_path, capsys):
    path = tmp_path / 'camera.yaml'
    files = []
    for jobs in ('1', '2'):
        arguments = ['calibrate', str(views), '-o', str(path), '--jobs', jobs, '--json']
        assert main([*arguments, '--board', CHESSBOARD]) == 0
        files.append((path.read_text(), capsys.readouterr().out))
    assert files[0] == files[1]


def test_few_images_start_no_process(views, capsys, monkeypatch):
    monkeypatch.setattr(workers, 'WORTH_S', 1e9)
    monkeypatch.setattr(workers, 'ProcessPoolExecutor', None)
    _, two = outputs(capsys, 'estimate', views, '--json')
    assert len(two.out.splitlines()) == 12


def process_id(item):
    """Return the item and the process that has it."""
    return item, os.getpid()


def crash(item):
    """End the process, unless it is the one that tests run in."""
    if item > 6:
        os._exit(3)
    return item


@pytest.mark.parametrize(('total', 'here'), [(40, 5 + 35 // 3), (None, 5)])
def test_results_are_in_order_from_other_processes(eager, total, here):
    """While the others start, this process goes on, unless each item may have to be awaited."""
    results = list(workers.in_order(process_id, iter(range(40)), total, 2))
    assert [item for item, _ in results] == list(range(40))
    assert {process for _, process in results[:here]} == {os.getpid()}
    assert os.getpid() not in {process for _, process in results[here:]}


def test_a_crashed_worker_is_one_line(eager):
    with pytest.raises(ConfigError, match='a worker process ended unexpectedly') as error:
        list(workers.in_order(crash, range(12), 12, 2))
    assert '\n' not in str(error.value)


@pytest.fixture
def running(tmp_path):
    """Start the command on many images, in a group of its own, until workers have results."""
    write_empty(tmp_path / 'empty.png')
    images = [str(tmp_path / 'empty.png')] * 20_000
    arguments = ['estimate', *images, '--board', CHESSBOARD, '--json', '--jobs', '2']
    process = subprocess.Popen(
        [sys.executable, '-m', 'p4pfr_ros', *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    for _ in range(50):
        assert process.stdout.readline().startswith('{')
    yield process
    end(process)


def test_an_interrupt_from_the_terminal_ends_all_quietly(running):
    """It reaches all processes of the group."""
    os.killpg(running.pid, signal.SIGINT)
    _, err = running.communicate()
    assert running.returncode == 128 + signal.SIGINT
    assert own_lines(err) == []
    wait_until(lambda: has_ended(running.pid))


def test_workers_end_with_a_command_that_is_killed(running):
    running.kill()
    running.wait()
    wait_until(lambda: has_ended(running.pid))
