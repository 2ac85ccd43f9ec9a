# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The demo: output, exit status, and that it leaves no process running."""

from dataclasses import replace
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import cv2
from geometry_msgs.msg import PoseStamped
from namespaces import why_not
import numpy as np
from p4pfr_ros import Pose, Solution
from p4pfr_ros.files.writing import check_writable
from p4pfr_ros.ros import demo
from p4pfr_ros.ros.conversions import Correspondences, image_msg
from p4pfr_ros.ros.demo.children import Children
from p4pfr_ros.ros.demo.monitor import Monitor
from p4pfr_ros.ros.demo.views import DemoView, Errors, median_errors, Record
import pytest
import rclpy
from rich.console import Console
import scenes
from sensor_msgs.msg import Image

GOOD = Errors(position=0.001, rotation_deg=0.01, focal=0.001, k=0.001, rms_px=0.05, latency_s=0.03)
POINTS = Correspondences(scenes.project(scenes.GRID), scenes.GRID, np.arange(len(scenes.GRID)))
# The limits of the demo, except for the latency, which depends on the load of the machine.
SCRIPT = """
from dataclasses import replace
import sys
from p4pfr_ros.ros.demo import LIMITS, main
sys.exit(main({duration_s}, replace(LIMITS, latency_s=60.0), min_views=1))
"""


class _Demo:
    """The demo as a process, with its output."""

    def __init__(self, folder, duration_s):
        script = SCRIPT.format(duration_s=duration_s)
        self.process = subprocess.Popen(
            [sys.executable, '-c', script],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.output = ''

    def until(self, words):
        while words not in self.output:
            line = self.process.stdout.readline()
            assert line, self.output
            self.output += line

    def children(self):
        pid = self.process.pid
        return [int(p) for p in Path(f'/proc/{pid}/task/{pid}/children').read_text().split()]

    def wait(self):
        self.output += self.process.communicate(timeout=200)[0]
        return self.process.returncode


@pytest.mark.dds
def test_the_demo_stays_within_its_limits_and_writes_an_image(tmp_path):
    """Three processes, which have exited in the end; an older image is replaced."""
    (tmp_path / 'demo.png').write_text('old')
    run = _Demo(tmp_path, 5.0)
    run.until('started')
    children = run.children()
    assert len(children) == 3
    assert run.wait() == 0, run.output
    assert 'median errors of' in run.output
    assert 'wrote demo.png (replaces the previous one): ' in run.output
    assert not any(_is_alive(pid) for pid in children)
    image = cv2.imread(str(tmp_path / 'demo.png'))
    assert image.shape == (480 + 51, 1280, 3)
    assert (np.ptp(image[480:], axis=(0, 2)) > 100).sum() > 400  # captions
    annotated, undistorted = np.hsplit(image[:480], 2)
    assert np.ptp(annotated, axis=2).max() > 100  # colours on the grey image
    assert np.ptp(undistorted, axis=2).max() == 0


@pytest.mark.dds
def test_the_demo_fails_if_a_node_dies(tmp_path):
    """It names the node, and stops the others."""
    run = _Demo(tmp_path, 60.0)
    run.until('view ')
    children = run.children()
    detector = next(pid for pid in children if b'detector_node' in _command(pid))
    os.kill(detector, signal.SIGKILL)
    assert run.wait() == 1
    assert 'demo failed: detector_node exited with status -9' in run.output
    assert not any(_is_alive(pid) for pid in children)


@pytest.mark.dds
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_an_interrupted_demo_stops_its_nodes(tmp_path, number):
    """By Ctrl-C or SIGTERM."""
    run = _Demo(tmp_path, 60.0)
    run.until('started')
    children = run.children()
    run.process.send_signal(number)
    assert run.wait() == 130
    assert 'Traceback' not in run.output
    assert not any(_is_alive(pid) for pid in children)


def _command(pid):
    return Path(f'/proc/{pid}/cmdline').read_bytes()


def _is_alive(pid):
    return Path(f'/proc/{pid}').exists()


@pytest.mark.parametrize('name', Errors.__slots__)
def test_an_error_beyond_its_limit_is_named(name):
    """Each error has its own limit; NaN exceeds any."""
    console = Console(quiet=True)
    assert demo._check(console, [GOOD], demo.LIMITS, 1) == []
    for value in (1.5 * getattr(demo.LIMITS, name), float('nan')):
        problems = demo._check(console, [replace(GOOD, **{name: value})], demo.LIMITS, 1)
        assert len(problems) == 1
        assert name in problems[0]


def test_too_few_views_are_a_failure():
    """The line names their number."""
    problems = demo._check(Console(quiet=True), [GOOD] * 4, demo.LIMITS, 5)
    assert len(problems) == 1
    assert problems[0].startswith('4 views')


def test_errors_of_a_view():
    """1 % of the distance, a rotation by 0.1 rad, 5 % of f, 0.05 of k, 3 px."""
    true = scenes.FACING
    rotation = true.rotation @ Pose.from_rotation_vector([0.1, 0, 0], np.zeros(3)).rotation
    error_m = 0.01 * np.linalg.norm(true.translation) * np.array([0.0, 1.0, 0.0])
    camera = replace(scenes.CAMERA, focal_px=1.05 * scenes.CAMERA.focal_px, k=-0.25)
    estimate = Solution(
        camera=camera, camera_from_board=Pose(rotation, true.translation + error_m)
    )
    image_points = scenes.project(scenes.GRID, estimate.camera_from_board, camera) + np.array(
        [3.0, 0.0]
    )
    points = replace(POINTS, image_points=image_points)
    view = DemoView(np.zeros((480, 640), np.uint8), points, estimate, true, 0.02)
    expected = Errors(0.01, np.degrees(0.1), 0.05, 0.05, 3.0, 0.02)
    errors = Errors.of(view, scenes.CAMERA)
    for name in Errors.__slots__:
        assert getattr(errors, name) == pytest.approx(getattr(expected, name), rel=1e-6), name
    assert median_errors([errors, errors, GOOD]) == errors


def test_rotations_by_180_degrees_are_errors():
    """About any axis: in the board's plane, and to its back."""
    view = DemoView(np.zeros((480, 640), np.uint8), POINTS, None, scenes.CAMERA_FROM_BOARD, 0.02)
    for axis in np.eye(3):
        rotated = scenes.CAMERA_FROM_BOARD @ Pose.from_rotation_vector(np.pi * axis, np.zeros(3))
        estimate = Solution(camera=scenes.CAMERA, camera_from_board=rotated)
        errors = Errors.of(replace(view, estimate=estimate), scenes.CAMERA)
        assert errors.rotation_deg == pytest.approx(180.0)


@pytest.mark.dds
def test_an_invalid_message_is_logged_and_skipped(dds, capfd):
    """A pose with a zero quaternion; later messages are received."""
    record = Record(scenes.CAMERA)
    monitor, sender = Monitor(record), rclpy.create_node('sender')
    wrong = PoseStamped(header=scenes.header(1))
    wrong.pose.orientation.w = 0.0
    image = image_msg(scenes.header(1), np.zeros((4, 4), np.uint8))
    publishers = [
        (sender.create_publisher(PoseStamped, 'pose_node/pose', 10), wrong),
        (sender.create_publisher(Image, 'image', 10), image),
    ]
    try:
        output, ends_s = '', time.monotonic() + 40.0
        while monitor.image_count == 0 or 'quaternion' not in output:
            assert time.monotonic() < ends_s, output
            for publisher, msg in publishers:
                publisher.publish(msg)
            rclpy.spin_once(monitor, timeout_sec=0.05)
            output += capfd.readouterr().err
    finally:
        monitor.destroy_node()
        sender.destroy_node()
    assert record.errors == []


def test_a_path_that_cannot_be_written_fails_before_the_start(tmp_path):
    """demo.png is a folder: one line."""
    (tmp_path / 'demo.png').mkdir()
    run = _Demo(tmp_path, 60.0)
    assert run.wait() == 1
    reason = 'expected the path of a regular file, got a directory'
    assert run.output == f'demo failed: demo.png: {reason}\n'


@pytest.mark.skipif(bool(why_not()), reason='needs network namespaces')
def test_without_a_loopback_interface_it_fails_before_the_start(tmp_path):
    """One line says how to set it up."""
    command = ['unshare', '--user', '--map-root-user', '--net', sys.executable, '-c']
    command.append(SCRIPT.format(duration_s=60.0))
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    reason = 'no connection to 127.0.0.1 (Network is unreachable), which DDS needs'
    assert (done.returncode, done.stderr) == (1, '')
    assert done.stdout == f'demo failed: {reason}: ip link set lo up\n'


def test_checking_a_path_does_not_change_files(tmp_path):
    """It neither creates a file nor changes an existing one."""
    check_writable(tmp_path / 'demo.png')
    assert list(tmp_path.iterdir()) == []
    (tmp_path / 'demo.png').write_text('old')
    check_writable(tmp_path / 'demo.png')
    assert (tmp_path / 'demo.png').read_text() == 'old'


STUBBORN = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print('ignores signals', flush=True)
time.sleep(600)
"""


def test_a_child_that_ignores_signals_is_killed(tmp_path, monkeypatch):
    """SIGINT, SIGTERM and finally SIGKILL."""
    monkeypatch.setattr(
        'p4pfr_ros.ros.demo.children._STOP_SIGNALS',
        ((signal.SIGINT, 0.1), (signal.SIGTERM, 0.1), (signal.SIGKILL, 5.0)),
    )
    before = signal.getsignal(signal.SIGINT)
    with Children(tmp_path) as children:
        children.launch('stubborn', [sys.executable, '-c', STUBBORN])
        while 'ignores signals' not in children.output():
            assert children.dead() is None
            time.sleep(0.01)
    assert children.dead().startswith('stubborn exited with status -9')
    assert signal.getsignal(signal.SIGINT) is before
