# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``Solution``, and the row of numbers that represents one inside the kernels."""

from __future__ import annotations

from dataclasses import dataclass

from ..cameras.division import DivisionCamera
from ..geometry import Array, Pose, POSE_SIZE, read_only, TRANSLATION
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


# A frozen object's slots, set without its check: half the time of object.__setattr__.
_set_camera = vars(Solution)['camera'].__set__
_set_pose = vars(Solution)['camera_from_board'].__set__


def solutions_from_rows(rows: Array, center_px: tuple[float, float]) -> list[Solution]:
    """Return the solutions of a kernel's rows (n, ROW_SIZE), which become read-only."""
    read_only(rows)
    solutions = []
    rotations = rows[:, :TRANSLATION].reshape(-1, 3, 3)
    for i, (g, h) in enumerate(rows[:, G:].tolist()):
        solution = object.__new__(Solution)
        _set_camera(solution, DivisionCamera.unchecked(g, center_px, h * g))
        _set_pose(solution, Pose.unchecked(rotations[i], rows[i, TRANSLATION:G]))
        solutions.append(solution)
    return solutions
