# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Draws the figures of docs/tour.md with the commands that the tour describes, on rendered images.

    python docs/draw_tour.py [--output docs]
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
import shutil
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.cli import main as p4pfr
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.images import write_image
from p4pfr_ros.rendering import render

BOARD_FILE = Path(__file__).parent.parent / 'config' / 'boards' / 'chessboard_9x6_25mm.yaml'
SIZE = (640, 480)
CAMERA = DivisionCamera(focal_px=420.0, center_px=(326.0, 236.0), k=-0.25)
# Head-on, the board's y axis points up and its z axis to the viewer.
HEAD_ON = np.diag([1.0, -1.0, -1.0])
# Tilt, its direction, turn about the line of sight (degrees), and x, y, z in front of the camera
# (m): the board tilted to all sides, and in all corners of the image.
VIEWS = (
    (40, 0, 0, 0.0, 0.0, 0.36),
    (40, 180, 5, 0.0, 0.0, 0.36),
    (40, 90, -5, 0.0, 0.0, 0.34),
    (40, 270, 8, 0.0, 0.0, 0.34),
    (30, 45, 20, -0.10, -0.07, 0.36),
    (30, 135, -20, 0.10, -0.07, 0.36),
    (30, 225, 10, -0.10, 0.07, 0.36),
    (30, 315, -10, 0.10, 0.07, 0.36),
    (15, 60, 90, 0.0, 0.0, 0.30),
    (10, 200, 0, 0.0, 0.0, 0.27),
    (50, 30, 40, 0.02, 0.02, 0.45),
    (35, 120, -35, -0.03, 0.01, 0.50),
)


def main() -> None:
    """Write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--output', type=Path, default=Path('docs'), help='folder of the figures')
    output = parser.parse_args().output
    with TemporaryDirectory() as folder:
        webcam = Path(folder) / 'webcam'
        webcam.mkdir()
        write_views(webcam)
        board = ['--board', str(BOARD_FILE)]
        page, camera, report = (str(Path(folder) / f) for f in ('b.png', 'c.yaml', 'r.png'))
        _run('board', str(BOARD_FILE), '-o', page, '--dpi', '60')
        _run('calibrate', str(webcam), *board, '-o', camera, '--plot', report)
        first = str(webcam / 'view00.png')
        _run('estimate', first, *board, '--camera', camera, '--draw', folder)
        shutil.copy(page, output / 'tour_board.png')
        shutil.copy(report, output / 'tour_report.png')
        shutil.copy(Path(folder) / 'view00_pose.png', output / 'tour_pose.png')
        write_image(output / 'tour_views.png', _contact_sheet(sorted(webcam.iterdir()), columns=4))


def write_views(folder: Path, camera: DivisionCamera = CAMERA) -> None:
    """Render the views of a webcam, or of another camera, into a folder."""
    board = load_board(str(BOARD_FILE))
    for i, (tilt, azimuth, turn, *at_m) in enumerate(VIEWS):
        axis = np.array([math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth)), 0.0])
        tilted = Pose.from_rotation_vector(math.radians(tilt) * axis, np.array(at_m))
        turned = Pose.from_rotation_vector(np.array([0.0, 0.0, math.radians(turn)]), np.zeros(3))
        pose = Pose(tilted.rotation @ turned.rotation @ HEAD_ON, tilted.translation)
        image = render(board, camera, pose, SIZE, noise_sigma=0.4, seed=i)
        write_image(folder / f'view{i:02}.png', image)


def _run(*arguments: str) -> None:
    status = p4pfr(arguments)
    if status:
        raise SystemExit(f'p4pfr {" ".join(arguments)}: exit status {status}')


def _contact_sheet(paths: list[Path], columns: int) -> np.ndarray:
    """Return small images side by side, with white lines between them."""
    small = [
        cv2.copyMakeBorder(
            cv2.resize(cv2.imread(str(path)), (220, 165), interpolation=cv2.INTER_AREA),
            *(2, 2, 2, 2),
            cv2.BORDER_CONSTANT,
            value=(255, 255, 255),
        )
        for path in paths
    ]
    rows = [np.hstack(small[i : i + columns]) for i in range(0, len(small), columns)]
    sheet: np.ndarray = np.vstack(rows)
    return sheet


if __name__ == '__main__':
    main()
