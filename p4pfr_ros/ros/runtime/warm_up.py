# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compiles all kernels before the first message."""

from __future__ import annotations

import gc

import cv2
import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, EstimateOptions, Pose, SelfCalibration
from p4pfr_ros.boards import Chessboard, Marker
from p4pfr_ros.core.geometry import Array, Mask
from p4pfr_ros.detection import detect
from p4pfr_ros.detection.aruco import marker_cells
from p4pfr_ros.files.images import ImageArray

_CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2)
_SIZE = (640, 480)
_FACING = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.05, -0.03, 0.5]))
# Rotation vectors: strongly tilted; so little that f is uncertain; parallel to the image plane.
_TILTS = ((0.5, 0.3, 0.1), (0.1, 0.06, 0.1), (0.0, 0.0, 0.0))
_TURN = (-0.3, 0.5, 0.8)
_NOISE_PX = 0.3
_IDEAL = EstimateOptions.ideal()
_DICTIONARY = 'DICT_4X4_50'


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
    _freeze()


def warm_up_detection() -> None:
    """Detect a chessboard and markers: the kernels of all kinds of boards."""
    row, column = np.indices((8, 9))
    chessboard = _image((row + column) % 2 == 0, 30)
    detect(chessboard, Chessboard(columns=8, rows=7, square_m=1.0))
    for side_px in (20, 3):  # the edges of small and of large markers
        marker = Marker(id=0, size_m=1.0, dictionary=_DICTIONARY)
        detect(_image(marker_cells(_DICTIONARY, 0), side_px), marker)
    _freeze()


def _image(black: Mask, side_px: int) -> ImageArray:
    """Draw cells with a white margin, slightly blurred."""
    cells = np.where(np.pad(black, 2), 25, 220).astype(np.uint8)
    image = np.kron(cells, np.ones((side_px, side_px), dtype=np.uint8))
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.7), dtype=np.uint8)


def _freeze() -> None:
    # All objects that exist now live until the process ends. Without freeze(), each full garbage
    # collection would visit them, which takes 0.1 s: up to a hundred messages.
    gc.collect()
    gc.freeze()


def _rotated(rotation_rad: tuple[float, float, float]) -> Pose:
    return Pose.from_rotation_vector(rotation_rad, np.zeros(3))


def _projected(points: Array, pose: Pose) -> Array:
    noise_px = np.random.default_rng(0).normal(0.0, _NOISE_PX, points.shape)
    pixels: Array = _CAMERA.project(pose.transform(np.pad(points, ((0, 0), (0, 1))))) + noise_px
    return pixels
