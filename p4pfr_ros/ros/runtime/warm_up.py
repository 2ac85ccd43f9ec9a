# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compiles the kernels before there is anything to answer."""

from __future__ import annotations

import gc

import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, Pose, SelfCalibration
from p4pfr_ros.core.geometry import Array

_CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2)
_SIZE = (640, 480)
_FACING = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.05, -0.03, 0.5]))
# Well tilted; so little that the focal length is in doubt; not at all.
_TILTS = ((0.5, 0.3, 0.1), (0.1, 0.06, 0.1), (0.0, 0.0, 0.0))
_TURN = (-0.3, 0.5, 0.8)
_NOISE_PX = 0.3


def warm_up() -> None:
    """
    Solve views of a board and of a marker that tell much and little; calibrate by some.

    The first time that takes some tens of seconds, and says so.
    """
    side = np.linspace(-0.1, 0.1, 4)
    board = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    views = [_seen(board, _FACING @ _turned(tilt)) for tilt in _TILTS]
    marker = [0, 3, 15, 12]
    for image, points in [(view, board) for view in views] + [(views[0][marker], board[marker])]:
        estimate_pose(image, points, image_size=_SIZE)
        estimate_pose(image, points, camera=_CAMERA)
    calibration = SelfCalibration(_SIZE)
    another = _seen(board, _FACING @ _turned(_TILTS[0]) @ _turned(_TURN))
    for image in (views[0], views[0], another):
        calibration.update(image, board)
    # What there is now stays to the end. Python need not go through all of it again and again in
    # search of rubbish, which takes a tenth of a second: a hundred messages, at worst.
    gc.collect()
    gc.freeze()


def _turned(rotation_rad: tuple[float, float, float]) -> Pose:
    return Pose.from_rotation_vector(rotation_rad, np.zeros(3))


def _seen(points: Array, pose: Pose) -> Array:
    noise_px = np.random.default_rng(0).normal(0.0, _NOISE_PX, points.shape)
    seen: Array = _CAMERA.project(pose.transform(np.pad(points, ((0, 0), (0, 1))))) + noise_px
    return seen
