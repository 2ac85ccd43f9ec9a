# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr batch`` on folders and bags, on this machine and with a scheduler."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys

from p4pfr_ros import load_calibration
from p4pfr_ros.cli import batch, main
from p4pfr_ros.files.images import read_image
from processes import end, has_ended, listening_addresses, own_lines, wait_until
import pytest
import recorded
from rendered import CHESSBOARD, write_views

distributed = pytest.importorskip('distributed')

COUNT = 6
LOOPBACK = '0100007F'  # 127.0.0.1, as in /proc/net
FILES = {'camera.yaml', 'done.json', 'poses.csv', 'poses.tum', 'report.png'}


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    """Return the paths of recordings: three folders, a bag, and a damaged bag."""
    root = tmp_path_factory.mktemp('recordings')
    (root / 'a').mkdir()
    paths = write_views(root / 'a', COUNT)
    for name in 'bc':
        shutil.copytree(root / 'a', root / name)
    messages = [recorded.image_message(read_image(path), i) for i, path in enumerate(paths)]
    recorded.write_bag(root / 'bag', 'mcap', {'/image': messages})
    (root / 'damaged.mcap').write_bytes((root / 'bag/bag.mcap').read_bytes()[:5000])
    return root


def command(output, *arguments):
    """Return the command, which writes uncalibrated cameras as well."""
    options = ['--board', CHESSBOARD, '-o', str(output), '--force']
    return [sys.executable, '-m', 'p4pfr_ros', 'batch', *map(str, arguments), *options]


def start(*arguments):
    """Start a process in a group of its own."""
    pipe = subprocess.PIPE
    return subprocess.Popen(arguments, stdout=pipe, stderr=pipe, text=True, start_new_session=True)


def summary(output):
    """Return the rows of the summary by the name of the recording."""
    with (output / 'summary.csv').open() as file:
        return {row['recording'].rpartition('/')[2]: row for row in csv.DictReader(file)}


def times(output):
    """Return when each recording was done."""
    return {path.parent.name: path.stat().st_mtime_ns for path in output.glob('*/done.json')}


def test_recordings_have_the_results_of_the_other_commands(recordings, tmp_path, capsys):
    """A damaged bag costs its own row; what is done is skipped, unless options change."""
    output = tmp_path / 'out'
    given = [recordings / name for name in ('a', 'bag', 'damaged.mcap')]
    run = subprocess.run(command(output, *given), capture_output=True, text=True)
    assert run.returncode == 1
    [line] = own_lines(run.stderr)
    assert line.startswith(f'p4pfr: {given[2]}: expected an intact rosbag2 (')
    rows = summary(output)
    assert [rows[name]['state'] for name in rows] == [rows['a']['state']] * 2 + ['']
    assert rows['damaged.mcap']['error'].startswith('expected an intact rosbag2')
    assert rows['bag']['poses'] == rows['a']['images'] == str(COUNT)
    for name in ('a', 'bag'):
        assert {path.name for path in (output / name).iterdir()} == FILES
    check_camera_and_poses(output / 'bag', recordings / 'bag', tmp_path, capsys)
    before = times(output)
    again = subprocess.run(command(output, *given), capture_output=True, text=True)
    assert '2 of 3 recordings are done: skipped' in again.stdout
    assert (own_lines(again.stderr), times(output)) == ([line], before)
    other = [*command(output, *given[:2]), '--every', '2']
    assert subprocess.run(other, capture_output=True).returncode == 0
    assert summary(output)['a']['images'] == str(COUNT // 2)


def check_camera_and_poses(folder, recording, tmp_path, capsys):
    """Compare the results of a recording with those of calibrate and estimate."""
    camera = tmp_path / 'camera.yaml'
    arguments = ['--board', CHESSBOARD, '-o', str(camera), '--name', 'bag', '--json']
    assert main(['calibrate', str(recording), *arguments]) == 0
    assert (folder / 'camera.yaml').read_text() == camera.read_text()
    for option, name in (('--csv', 'poses.csv'), ('--tum', 'poses.tum')):
        capsys.readouterr()
        arguments = ['--board', CHESSBOARD, '--camera', str(camera), option]
        assert main(['estimate', str(recording), *arguments]) == 0
        assert (folder / name).read_text() == capsys.readouterr().out


@pytest.fixture
def cluster():
    """Start a scheduler and two workers on this machine; return the scheduler's address."""
    python = [sys.executable, '-m']
    local = ['--host', '127.0.0.1', '--no-dashboard']
    scheduler = start(*python, 'distributed.cli.dask_scheduler', *local, '--port', '0')
    processes = [scheduler]
    try:
        address = ''
        while not address:
            line = scheduler.stderr.readline()
            assert line, 'the scheduler has ended'
            address = line.split()[-1] if 'Scheduler at:' in line else ''
        worker = [*python, 'distributed.cli.dask_worker', address, *local, '--no-nanny']
        for _ in range(2):
            processes.append(
                subprocess.Popen(
                    [*worker, '--nthreads', '1'],
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                )
            )
        yield address
    finally:
        for process in processes:
            end(process)


@pytest.mark.exhaustive
def test_a_worker_that_is_killed_loses_nothing(recordings, tmp_path, cluster):
    """The other worker does what it was doing."""
    output = tmp_path / 'out'
    names = ('a', 'b', 'c', 'bag')
    with distributed.Client(cluster) as client:
        client.wait_for_workers(2, timeout=300)
        process_of = client.run(os.getpid)
        running = start(*command(output, *(recordings / n for n in names)), '--scheduler', cluster)

        def busy():
            return [worker for worker, tasks in client.processing().items() if tasks]

        victim = process_of[wait_until(busy)[0]]
        os.kill(victim, signal.SIGKILL)
        _, err = running.communicate(timeout=300)
        assert (running.returncode, own_lines(err)) == (0, [])
        assert len(client.scheduler_info()['workers']) == 1
    assert times(output).keys() == set(names)
    a, b = (load_calibration(output / name / 'camera.yaml') for name in 'ab')
    assert a.model == b.model


@pytest.mark.exhaustive
def test_an_interrupted_batch_ends_quietly_and_goes_on_later(recordings, tmp_path):
    output = tmp_path / 'out'
    given = [recordings / name for name in 'abc']
    running = start(*command(output, *given), '--jobs', '1')
    try:
        wait_until(lambda: times(output))
        assert listening_addresses(running.pid) == {LOOPBACK}
        os.killpg(running.pid, signal.SIGINT)
        _, err = running.communicate(timeout=300)
        assert (running.returncode, own_lines(err)) == (128 + signal.SIGINT, [])
        wait_until(lambda: has_ended(running.pid))
    finally:
        end(running)
    before = times(output)
    assert 1 <= len(before) < 3
    done = subprocess.run(command(output, *given), capture_output=True, text=True)
    assert (done.returncode, own_lines(done.stderr)) == (0, [])
    assert before.items() <= times(output).items()
    assert times(output).keys() == set('abc')


def test_a_scheduler_that_is_not_there_is_one_line(recordings, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(batch, '_CONNECTION_TIMEOUT_S', 0.5)
    for address in ('tcp://127.0.0.1:1', 'nonsense://x'):
        arguments = command(tmp_path, recordings / 'a', '--scheduler', address)[3:]
        assert main(arguments) == 1
        err = capsys.readouterr().err
        assert err.startswith(f'p4pfr: --scheduler {address}: expected a scheduler: ')
        assert err.count('\n') == 1


def test_recordings_with_one_name_have_different_folders(tmp_path, capsys):
    one, two = tmp_path / 'monday/left', tmp_path / 'tuesday/left'
    assert batch._distinct_names([one, two, tmp_path / 'c']) == [
        'monday_left',
        'tuesday_left',
        'c',
    ]
    assert main(command(tmp_path, one, one)[3:]) == 1
    assert capsys.readouterr().err == f'p4pfr: {one}: expected each recording once\n'


def test_a_truncated_marker_means_that_a_recording_is_not_done(recordings, tmp_path):
    task = batch.RecordingTask(path=recordings / 'a', board=None, options=None)
    recording = batch.Recording(task, tmp_path / 'a', batch._key(task))
    (tmp_path / 'a').mkdir()
    marker = {'key': recording.key, 'files': [], 'summary': {'images': 1}}
    text = json.dumps(marker)
    for content, expected in ((text, {'images': 1}), (text[:-3], None), ('[]', None)):
        (tmp_path / 'a/done.json').write_text(content)
        assert batch._done_before(recording) == expected
    (tmp_path / 'a/done.json').write_text(json.dumps({**marker, 'files': ['poses.csv']}))
    assert batch._done_before(recording) is None
