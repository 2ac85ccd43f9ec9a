# SPDX-License-Identifier: Apache-2.0
"""Pictures of boards of which the truth is known."""

import math
from pathlib import Path

import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.files import load_board
from p4pfr_ros.image_files import write_image
from p4pfr_ros.rendering import render

BOARDS = Path(__file__).parent.parent / 'config' / 'boards'
CHESSBOARD = str(BOARDS / 'chessboard_9x6_25mm.yaml')
MARKER = str(BOARDS / 'marker_36h11_150mm.yaml')

FOCAL_PX, K = 420.0, -0.25
TILT_DEG = 30.0
TURN_RAD = math.radians(TILT_DEG) * np.array([0.6, 0.8, 0.0])
AT_M = np.array([0.01, -0.02, 0.5])


def write_scene(path, board_file, *, turn_rad=TURN_RAD, at_m=AT_M, size=(640, 480)):
    """Render a board, turned from head-on, and return its true camera_from_board."""
    width, height = size
    camera = DivisionCamera(FOCAL_PX, ((width - 1) / 2, (height - 1) / 2), K)
    turn = Pose.from_rotation_vector(turn_rad, at_m)
    pose = Pose(turn.rotation @ np.diag([1.0, -1.0, -1.0]), turn.translation)
    image = render(load_board(board_file), camera, pose, size, noise_sigma=1.0, seed=3)
    write_image(path, image)
    return pose


def write_empty(path):
    """Write a picture of nothing."""
    write_image(path, np.full((480, 640), 128, dtype=np.uint8))
