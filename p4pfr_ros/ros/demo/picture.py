# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""demo.png: a view as it was seen, with what was found; beside it, straightened."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from p4pfr_ros.boards import Board
from p4pfr_ros.detection import Detection
from p4pfr_ros.files.images import write_image
from p4pfr_ros.report.drawing import annotate, straighten

from .views import View


def write_picture(path: Path, view: View, board: Board) -> None:
    """
    Draw corners, reprojected board and axes into the picture; straighten it beside that.

    Raises
    ------
    ConfigError
        The picture cannot be written.

    """
    points = view.points
    detection = Detection(points.image_points, points.board_points, points.ids)
    seen = annotate(view.picture, detection, view.estimate, board)
    straight = straighten(view.picture, view.estimate.camera)
    write_image(path, np.hstack([seen, cv2.cvtColor(straight, cv2.COLOR_GRAY2BGR)]))
