# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""No message waits for the compiler."""

from pathlib import Path
import subprocess
import sys

COMPILED = """
import sys


def compiled():
    kernels = {
        f'{name}.{kernel.__name__}': kernel
        for name, module in sys.modules.items() if name.startswith('p4pfr_ros.ROOM.')
        for kernel in vars(module).values() if hasattr(kernel, 'signatures')
    }
    return {(name, str(s)) for name, kernel in kernels.items() for s in kernel.signatures}

"""

SCRIPT = """
import moving
import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, Pose
from p4pfr_ros.kernels.warm_up import warm_up
from modes import fixed, FREEZE, Modes, options

warm_up()
before = compiled()
modes = Modes()
modes.process_all(moving.views(0, 60))
modes.process_all(moving.views(60, 120, moving.ZOOMED))
modes.process_all(moving.views(0, 120), options('per_frame'))
modes.process_all(moving.views(0, 20), FREEZE)
for focal_px in (260.0, 1040.0):
    wrong = fixed(DivisionCamera(focal_px, (319.5, 239.5)))
    modes.process_all(moving.views(0, 60), wrong)
    assert modes.process(moving.views(60, 61)[0].observation, wrong).estimate.model is None
corners = [0, 8, 53, 45]
for view in moving.views(0, 60):
    points = moving.BOARD.points[corners]
    estimate_pose(view.image_points[corners], points, image_size=moving.SIZE)
facing = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.02, 0.01, 0.5]))
board, rng = moving.BOARD.points, np.random.default_rng(1)
prior = dict(prior_focal_px=700.0, prior_focal_sigma_px=30.0, prior_k_sigma=0.1)
for tilt_rad in np.linspace(0.0, 0.7, 6):
    pose = facing @ Pose.from_rotation_vector(tilt_rad * rng.uniform(-1.0, 1.0, 3), np.zeros(3))
    pixels = moving.CAMERA.project(pose.transform(np.pad(board, ((0, 0), (0, 1)))))
    pixels += rng.normal(0.0, 0.3, pixels.shape)
    pixels[: len(board) // 3] += rng.uniform(-40.0, 40.0, (len(board) // 3, 2))
    for chosen in (slice(None), corners):
        for changes in ({}, prior):
            for options in (EstimateOptions(**changes), EstimateOptions.ideal(**changes)):
                points = pixels[chosen], board[chosen]
                estimate_pose(*points, image_size=moving.SIZE, options=options)
        estimate_pose(*points, camera=moving.CAMERA)
print(len(before), sorted(compiled() - before))
"""


def kernels_and_new(script, room, folder):
    """Run a script; return how many kernels its warm-up left, and what was compiled after."""
    done = subprocess.run(
        [sys.executable, '-c', COMPILED.replace('ROOM', room) + script],
        cwd=folder,
        check=True,
        capture_output=True,
        text=True,
    )
    count, new = done.stdout.strip().split(' ', 1)
    return int(count), new


def test_warm_up_compiles_all_kernels():
    """Boards and markers, all modes, options and a zoom need no other kernel or signature."""
    count, new = kernels_and_new(SCRIPT, 'core', Path(__file__).parents[1] / 'ros')
    assert count > 20
    assert new == '[]'


DETECTION_SCRIPT = """
from board_views import BOARDS, CAMERAS, seen_from, SIZE
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render
from p4pfr_ros.kernels.warm_up import warm_up_detection

warm_up_detection()
before = compiled()
for board in BOARDS.values():
    image = render(board, CAMERAS['strong'], seen_from(0.5, (0.2, 0.1)), SIZE)
    image.flags.writeable = False
    seen = detect(image, board)
    assert not seen.reason
    detect(image, board, near=seen)
    detect(image[:200], board)
print(len(before), sorted(compiled() - before))
"""


def test_warm_up_compiles_all_kernels_of_detection():
    """Boards of all kinds, whole and in part, need no other kernel or signature."""
    count, new = kernels_and_new(DETECTION_SCRIPT, 'detection', Path(__file__).parents[1])
    assert count >= 7  # those that Python calls; from the cache, the others do not count
    assert new == '[]'
