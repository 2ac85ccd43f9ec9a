# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``Solution``, and the row of numbers that stands for one inside the kernels."""

from __future__ import annotations

from dataclasses import dataclass

from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose

# Places in a row: the rotation row by row, the translation, then g and h, where the pixel (x, y)
# from the centre sees the ray (x, y, g + h r²): g is the focal length in px, and k = g h.
TRANSLATION = 9
G = 12
H = 13
ROW_SIZE = 14


@dataclass(frozen=True, slots=True)
class Solution:
    """A camera, and where it sees the board."""

    camera: DivisionCamera
    camera_from_board: Pose


def solution_from_row(row: Array, center_px: tuple[float, float]) -> Solution:
    """Dress a kernel's row of numbers."""
    g, h = row[G:].tolist()
    camera = DivisionCamera.unchecked(g, center_px, h * g)
    pose = Pose.unchecked(row[:TRANSLATION].reshape(3, 3), row[TRANSLATION:G])
    return Solution(camera, pose)
