# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``Solution``, and the row of numbers that represents one inside the kernels."""

from __future__ import annotations

from dataclasses import dataclass

from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose, POSE_SIZE, TRANSLATION
from ..jit import inlined

# A row is a pose (12,), then g and h. The pixel (x, y) from the centre sees the ray
# (x, y, g + h r²), r² = x² + y²: g is the focal length in px, and k = g h.
G = POSE_SIZE
H = G + 1
ROW_SIZE = H + 1

# A sextic has no more.
MAX_SOLUTIONS = 6

Row = tuple[
    float, float, float, float, float, float, float,
    float, float, float, float, float, float, float,
]  # fmt: skip


@inlined
def load_row(array: Array) -> Row:
    """Read a row from an array (ROW_SIZE,)."""
    a = array
    return (
        *(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]),
        *(a[9], a[10], a[11], a[12], a[13]),
    )


@inlined
def store_row(row: Row, array: Array) -> None:
    """Write a row to an array (ROW_SIZE,)."""
    for i in range(ROW_SIZE):
        array[i] = row[i]


@dataclass(frozen=True, slots=True)
class Solution:
    """A camera, and the pose of the board in its frame (board units)."""

    camera: DivisionCamera
    camera_from_board: Pose


def solution_from_row(row: Array, center_px: tuple[float, float]) -> Solution:
    """Return the solution of a kernel's row."""
    g, h = row[G:].tolist()
    camera = DivisionCamera.unchecked(g, center_px, h * g)
    pose = Pose.unchecked(row[:TRANSLATION].reshape(3, 3), row[TRANSLATION:G])
    return Solution(camera, pose)
