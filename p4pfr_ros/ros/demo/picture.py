# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""demo.png: a view as it was seen, with what was found; beside it, straightened."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from p4pfr_ros.boards import Board
from p4pfr_ros.detection import Detection
from p4pfr_ros.drawing import annotate, straighten
from p4pfr_ros.image_files import write_image

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
