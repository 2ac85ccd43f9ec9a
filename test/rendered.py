# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rendered image files of boards with ground truth."""

import math
from pathlib import Path

import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.images import write_image
from p4pfr_ros.rendering import render

BOARDS = Path(__file__).parent.parent / 'config' / 'boards'
CHESSBOARD = str(BOARDS / 'chessboard_9x6_25mm.yaml')
MARKER = str(BOARDS / 'marker_36h11_150mm.yaml')

FOCAL_PX, K = 420.0, -0.25
TILT_DEG = 30.0
TURN_RAD = math.radians(TILT_DEG) * np.array([0.6, 0.8, 0.0])
AT_M = np.array([0.01, -0.02, 0.5])


def write_scene(path, board_file, *, turn_rad=TURN_RAD, at_m=AT_M, size=(640, 480), seed=3):
    """Render a board, rotated from head-on; return the true camera_from_board."""
    width, height = size
    camera = DivisionCamera(FOCAL_PX, ((width - 1) / 2, (height - 1) / 2), K)
    turn = Pose.from_rotation_vector(turn_rad, at_m)
    pose = Pose(turn.rotation @ np.diag([1.0, -1.0, -1.0]), turn.translation)
    image = render(load_board(board_file), camera, pose, size, noise_sigma=1.0, seed=seed)
    write_image(path, image)
    return pose


def write_views(folder, count):
    """Render count views of the chessboard, all over the image; return the paths."""
    rng = np.random.default_rng(4)
    paths = [folder / f'view{i:02}.png' for i in range(count)]
    for i, path in enumerate(paths):
        azimuth = 2.4 * i  # nearly the golden angle: no two views are similar
        tilt = 0.35 + 0.3 * rng.random()
        turn_rad = (tilt * math.cos(azimuth), tilt * math.sin(azimuth), rng.uniform(-0.5, 0.5))
        at_m = (0.08 * math.cos(1.7 * i), 0.05 * math.sin(1.7 * i), rng.uniform(0.28, 0.38))
        write_scene(path, CHESSBOARD, turn_rad=np.array(turn_rad), at_m=np.array(at_m), seed=i)
    return paths


def write_empty(path):
    """Write an image without a board."""
    write_image(path, np.full((480, 640), 128, dtype=np.uint8))
