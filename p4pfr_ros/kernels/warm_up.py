# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calls all kernels before the first message, which compiles or loads them."""

from __future__ import annotations

from collections.abc import Callable
import gc

import numpy as np
from p4pfr_ros import (
    DivisionCamera,
    estimate_pose,
    EstimateOptions,
    Pose,
    SelfCalibration,
    solve_p4pfr,
    solve_p4pfr_batch,
)
from p4pfr_ros.boards import Chessboard, Marker
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.detection import detect
from p4pfr_ros.detection.aruco import marker_cells
from p4pfr_ros.rendering import render

_CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2)
_SIZE = (640, 480)
_FACING = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.05, -0.03, 0.5]))
# Rotation vectors: strongly tilted; so little that f is uncertain; parallel to the image plane.
_TILTS = ((0.5, 0.3, 0.1), (0.1, 0.06, 0.1), (0.0, 0.0, 0.0))
_TURN = (-0.3, 0.5, 0.8)
_NOISE_PX = 0.3
# A world without deviations has kernels of its own, and so have priors.
_IDEAL = EstimateOptions.ideal()
_PRIOR = EstimateOptions.ideal(prior_focal_px=500.0, prior_focal_sigma_px=50.0)

_SIDE = np.linspace(-0.1, 0.1, 4)
_BOARD = np.stack(np.meshgrid(_SIDE, _SIDE), axis=-1).reshape(-1, 2)
_CORNERS = [0, 3, 15, 12]


def warm_up() -> None:
    """
    Estimate views of a board and a marker with much and little information, and calibrate.

    The first run on a machine compiles for some tens of seconds and prints a line about it.
    """
    _estimate_all()
    _calibrate()
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


def _estimate_all() -> None:
    for tilt in _TILTS:
        image = _view(_FACING @ _rotated(tilt))
        for chosen in (slice(None), _CORNERS):
            for options in (EstimateOptions(), _IDEAL, _PRIOR):
                pixels, points = image[chosen], _BOARD[chosen]
                estimate_pose(pixels, points, image_size=_SIZE, options=options)
            estimate_pose(pixels, points, camera=_CAMERA)


def _estimate_realistic() -> None:
    """Estimate views whose focal length is certain and uncertain."""
    for tilt in _TILTS:
        estimate_pose(_view(_FACING @ _rotated(tilt)), _BOARD, image_size=_SIZE)


def _calibrate() -> None:
    calibration = SelfCalibration(_SIZE)
    first = _view(_FACING @ _rotated(_TILTS[0]))
    another = _view(_FACING @ _rotated(_TILTS[0]) @ _rotated(_TURN))
    for image in (first, first, another):
        calibration.update(image, _BOARD)


def _solve() -> None:
    image_points = _view(_FACING @ _rotated(_TILTS[0]))[_CORNERS] - _CAMERA.center_px
    solve_p4pfr(image_points, _BOARD[_CORNERS])
    solve_p4pfr_batch(image_points[None], _BOARD[_CORNERS][None])


def _render() -> None:
    render(Chessboard(columns=3, rows=4, square_m=0.05), _CAMERA, _FACING, _SIZE)


# What separate processes compile: the beginnings of the modules' names, and what calls them.
PARTS: dict[str, tuple[tuple[str, ...], Callable[[], None]]] = {
    'search': (
        (
            'p4pfr_ros.core.linalg',
            'p4pfr_ros.core.model.observation',
            'p4pfr_ros.core.one_view.ambiguity',
            'p4pfr_ros.core.one_view.describe',
            'p4pfr_ros.core.one_view.least_squares',
            'p4pfr_ros.core.one_view.ransac',
        ),
        _estimate_all,
    ),
    'fit': (
        ('p4pfr_ros.core.one_view.focal_likelihood', 'p4pfr_ros.core.one_view.full_fit'),
        _estimate_realistic,
    ),
    'calibration': (('p4pfr_ros.core.many_views', 'p4pfr_ros.core.model.uncertainty'), _calibrate),
    'detection': (('p4pfr_ros.detection',), warm_up_detection),
    'minimal': (('p4pfr_ros.core.minimal',), _solve),
    'rendering': (('p4pfr_ros.rendering',), _render),
}


def _rotated(rotation_rad: tuple[float, float, float]) -> Pose:
    return Pose.from_rotation_vector(rotation_rad, np.zeros(3))


def _view(pose: Pose) -> Array:
    """Return the noisy pixels of the board."""
    noise_px = np.random.default_rng(0).normal(0.0, _NOISE_PX, _BOARD.shape)
    pixels: Array = _CAMERA.project(pose.transform(np.pad(_BOARD, ((0, 0), (0, 1))))) + noise_px
    return pixels
