# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compiles all kernels before the first message."""

from __future__ import annotations

import gc

import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, Pose, SelfCalibration
from p4pfr_ros.boards import Chessboard, Marker
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect
from p4pfr_ros.detection.aruco import marker_cells

_CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2)
_SIZE = (640, 480)
_FACING = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.05, -0.03, 0.5]))
# Rotation vectors: strongly tilted; so little that f is uncertain; parallel to the image plane.
_TILTS = ((0.5, 0.3, 0.1), (0.1, 0.06, 0.1), (0.0, 0.0, 0.0))
_TURN = (-0.3, 0.5, 0.8)
_NOISE_PX = 0.3
_IDEAL = EstimateOptions.ideal()


def warm_up() -> None:
    """
    Estimate views of a board and a marker with much and little information, and calibrate.

    The first run on a machine compiles for some tens of seconds and prints a line about it.
    """
    side = np.linspace(-0.1, 0.1, 4)
    board = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    views = [_projected(board, _FACING @ _rotated(tilt)) for tilt in _TILTS]
    marker = [0, 3, 15, 12]
    for image, points in [(view, board) for view in views] + [(views[0][marker], board[marker])]:
        estimate_pose(image, points, image_size=_SIZE)
        estimate_pose(image, points, camera=_CAMERA)
        # A world without deviations has kernels of its own.
        estimate_pose(image, points, image_size=_SIZE, options=_IDEAL)
    calibration = SelfCalibration(_SIZE)
    another = _projected(board, _FACING @ _rotated(_TILTS[0]) @ _rotated(_TURN))
    for image in (views[0], views[0], another):
        calibration.update(image, board)
    # All objects that exist now live until the process ends. Without freeze(), each full garbage
    # collection would visit them, which takes 0.1 s: up to a hundred messages.
    gc.collect()
    gc.freeze()


def warm_up_detection() -> None:
    """Detect a small chessboard and a marker, drawn pixel by pixel."""
    squares = np.indices((7, 6)).sum(axis=0) % 2 == 0
    marker = Marker(id=0, size_m=0.1, dictionary='DICT_4X4_50')
    for black, board in (
        (squares, Chessboard(columns=5, rows=6, square_m=0.02)),
        (marker_cells(marker.dictionary, marker.id), marker),
    ):
        image = np.where(np.kron(black, np.ones((12, 12), dtype=bool)), 30, 220).astype(np.uint8)
        detect(np.pad(image, 24, constant_values=220), board)


def _rotated(rotation_rad: tuple[float, float, float]) -> Pose:
    return Pose.from_rotation_vector(rotation_rad, np.zeros(3))


def _projected(points: Array, pose: Pose) -> Array:
    noise_px = np.random.default_rng(0).normal(0.0, _NOISE_PX, points.shape)
    pixels: Array = _CAMERA.project(pose.transform(np.pad(points, ((0, 0), (0, 1))))) + noise_px
    return pixels
