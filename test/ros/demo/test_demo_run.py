# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The demo: it shows what it should, fails when it does not, and leaves nothing running."""

from dataclasses import replace
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import cv2
from geometry_msgs.msg import PoseStamped
import numpy as np
from p4pfr_ros import Pose, Solution
from p4pfr_ros.files.writing import check_writable
from p4pfr_ros.ros import demo
from p4pfr_ros.ros.conversions import Correspondences, image_msg
from p4pfr_ros.ros.demo.children import Children
from p4pfr_ros.ros.demo.monitor import Monitor
from p4pfr_ros.ros.demo.views import Errors, median_errors, tilt_deg, View
import pytest
import rclpy
from rich.console import Console
import scenes
from sensor_msgs.msg import Image

GOOD = Errors(position=0.001, rotation_deg=0.01, focal=0.001, k=0.001, rms_px=0.05, latency_s=0.03)


POINTS = Correspondences(scenes.seen(scenes.GRID), scenes.GRID, np.arange(len(scenes.GRID)))
# Bounds as the demo has them, but for how fast this machine is at the moment.
SCRIPT = """
from dataclasses import replace
import sys
from p4pfr_ros.ros.demo import BOUNDS, main
sys.exit(main({duration_s}, replace(BOUNDS, latency_s=60.0), fewest_views=1))
"""


class _Demo:
    """The demo as a process, a short one."""

    def __init__(self, folder, duration_s):
        script = SCRIPT.format(duration_s=duration_s)
        self.process = subprocess.Popen(
            [sys.executable, '-c', script],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.said = ''

    def until(self, words):
        while words not in self.said:
            line = self.process.stdout.readline()
            assert line, self.said
            self.said += line

    def children(self):
        pid = self.process.pid
        return [int(p) for p in Path(f'/proc/{pid}/task/{pid}/children').read_text().split()]

    def end(self):
        self.said += self.process.communicate(timeout=60)[0]
        return self.process.returncode


@pytest.mark.dds
def test_the_demo_finds_the_truth_and_draws_it(tmp_path):
    """Three processes, bounds kept, demo.png written, nothing left running."""
    run = _Demo(tmp_path, 5.0)
    run.until('started')
    children = run.children()
    assert len(children) == 3
    assert run.end() == 0, run.said
    assert 'median errors of' in run.said
    assert not any(_is_alive(pid) for pid in children)
    picture = cv2.imread(str(tmp_path / 'demo.png'))
    assert picture.shape == (480, 1280, 3)
    seen, straight = np.hsplit(picture, 2)
    assert np.ptp(seen, axis=2).max() > 100  # colours are drawn into the grey picture
    assert np.ptp(straight, axis=2).max() == 0


@pytest.mark.dds
def test_the_demo_fails_when_a_node_dies(tmp_path):
    """It says which, with what it said, and ends the others."""
    run = _Demo(tmp_path, 60.0)
    run.until('view ')
    children = run.children()
    detector = next(pid for pid in children if b'detector_node' in _command(pid))
    os.kill(detector, signal.SIGKILL)
    assert run.end() == 1
    assert 'demo failed: detector_node ended with status -9' in run.said
    assert not any(_is_alive(pid) for pid in children)


@pytest.mark.dds
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_an_interrupted_demo_ends_its_nodes(tmp_path, number):
    """Ctrl-C leaves nothing behind."""
    run = _Demo(tmp_path, 60.0)
    run.until('started')
    children = run.children()
    run.process.send_signal(number)
    assert run.end() == 130
    assert 'Traceback' not in run.said
    assert not any(_is_alive(pid) for pid in children)


def _command(pid):
    return Path(f'/proc/{pid}/cmdline').read_bytes()


def _is_alive(pid):
    return Path(f'/proc/{pid}').exists()


@pytest.mark.parametrize('name', Errors.__slots__)
def test_an_error_out_of_bounds_is_named(name):
    """Each bound is held by itself; a NaN is out of all bounds."""
    console = Console(quiet=True)
    assert demo._judge(console, [GOOD], demo.BOUNDS, 1) == []
    for value in (1.5 * getattr(demo.BOUNDS, name), float('nan')):
        problems = demo._judge(console, [replace(GOOD, **{name: value})], demo.BOUNDS, 1)
        assert len(problems) == 1
        assert name in problems[0]


def test_too_few_views_are_a_failure():
    """A demo that shows next to nothing is none."""
    problems = demo._judge(Console(quiet=True), [GOOD] * 4, demo.BOUNDS, 5)
    assert len(problems) == 1
    assert 'views came' in problems[0]


def test_errors_are_those_of_the_view():
    """Each number by hand: 1 % of the distance, a turn of 0.1 rad, 5 % of f, 0.05 of k, 3 px."""
    true = scenes.FACING
    turned = true.rotation @ Pose.from_rotation_vector([0.1, 0, 0], np.zeros(3)).rotation
    away = 0.01 * np.linalg.norm(true.translation) * np.array([0.0, 1.0, 0.0])
    camera = replace(scenes.CAMERA, focal_px=1.05 * scenes.CAMERA.focal_px, k=-0.25)
    estimate = Solution(camera=camera, camera_from_board=Pose(turned, true.translation + away))
    image = scenes.seen(scenes.GRID, estimate.camera_from_board, camera) + np.array([3.0, 0.0])
    points = replace(POINTS, image_points=image)
    view = View(np.zeros((480, 640), np.uint8), points, estimate, true, 0.02)
    expected = Errors(0.01, np.degrees(0.1), 0.05, 0.05, 3.0, 0.02)
    errors = Errors.of(view, scenes.CAMERA)
    for name in Errors.__slots__:
        assert getattr(errors, name) == pytest.approx(getattr(expected, name), rel=1e-6), name
    assert median_errors([errors, errors, GOOD]) == errors


def test_no_turn_goes_unnoticed():
    """Neither a half turn in the board's plane, nor the board seen from behind."""
    view = View(np.zeros((480, 640), np.uint8), POINTS, None, scenes.CAMERA_FROM_BOARD, 0.02)
    for axis in np.eye(3):
        turned = scenes.CAMERA_FROM_BOARD @ Pose.from_rotation_vector(np.pi * axis, np.zeros(3))
        estimate = Solution(camera=scenes.CAMERA, camera_from_board=turned)
        errors = Errors.of(replace(view, estimate=estimate), scenes.CAMERA)
        assert errors.rotation_deg == pytest.approx(180.0)
    assert tilt_deg(scenes.FACING) == pytest.approx(0.0)
    behind = scenes.FACING @ Pose.from_rotation_vector([np.pi - 0.1, 0, 0], np.zeros(3))
    assert tilt_deg(behind) == pytest.approx(180.0 - np.degrees(0.1))


@pytest.mark.dds
def test_a_message_that_makes_no_sense_is_passed_over(dds, capfd):
    """A pose whose quaternion is zeros is said; what comes next is heard."""
    seen = []
    monitor, mouth = Monitor(seen.append), rclpy.create_node('mouth')
    wrong = PoseStamped(header=scenes.header(1))
    wrong.pose.orientation.w = 0.0
    picture = image_msg(scenes.header(1), np.zeros((4, 4), np.uint8))
    publishers = [
        (mouth.create_publisher(PoseStamped, 'pose_node/pose', 10), wrong),
        (mouth.create_publisher(Image, 'image', 10), picture),
    ]
    try:
        said, ends_s = '', time.monotonic() + 40.0
        while monitor.pictures == 0 or 'quaternion' not in said:
            assert time.monotonic() < ends_s, said
            for publisher, msg in publishers:
                publisher.publish(msg)
            rclpy.spin_once(monitor, timeout_sec=0.05)
            said += capfd.readouterr().err
    finally:
        monitor.destroy_node()
        mouth.destroy_node()
    assert seen == []


def test_a_demo_that_cannot_draw_says_so_before_it_starts(tmp_path):
    """demo.png is a folder: one line, and nothing is waited for."""
    (tmp_path / 'demo.png').mkdir()
    run = _Demo(tmp_path, 60.0)
    assert run.end() == 1
    assert run.said == ('demo failed: demo.png: expected a writable path: Is a directory\n')


def test_looking_for_a_place_leaves_nothing_behind(tmp_path):
    """Neither a new file, nor a change to an old one."""
    check_writable(tmp_path / 'demo.png')
    assert list(tmp_path.iterdir()) == []
    (tmp_path / 'demo.png').write_text('old')
    check_writable(tmp_path / 'demo.png')
    assert (tmp_path / 'demo.png').read_text() == 'old'


STUBBORN = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print('deaf', flush=True)
time.sleep(600)
"""


def test_a_child_that_does_not_listen_is_killed(tmp_path, monkeypatch):
    """SIGINT, SIGTERM and, as the last resort, SIGKILL."""
    monkeypatch.setattr(
        'p4pfr_ros.ros.demo.children._LAST_WORDS',
        ((signal.SIGINT, 0.1), (signal.SIGTERM, 0.1), (signal.SIGKILL, 5.0)),
    )
    before = signal.getsignal(signal.SIGINT)
    with Children(tmp_path) as children:
        children.launch('stubborn', [sys.executable, '-c', STUBBORN])
        while 'deaf' not in children.words():
            assert children.dead() is None
            time.sleep(0.01)
    assert children.dead().startswith('stubborn ended with status -9')
    assert signal.getsignal(signal.SIGINT) is before
