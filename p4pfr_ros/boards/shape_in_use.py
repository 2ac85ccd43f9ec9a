# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which shape of a calibration belongs to a board.

This module stands alone: the command line and the node estimate poses with known shapes, too.
"""

from __future__ import annotations

from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.many_views.results import CameraEstimate
from p4pfr_ros.core.model.board_shape import BoardShape


def shape_in_use(estimate: CameraEstimate, name: str, board_points: Array) -> BoardShape | None:
    """
    Return the shape of the board with this name and these points (N, 2), board units.

    None if the calibration has none, or if the points reach beyond it: then another board has
    the name, or only a part of it was seen. A board without a shape counts as flat, within the
    deviations that ``EstimateOptions`` allow.
    """
    shape = estimate.board_shape(name)
    return shape if shape is not None and shape.covers(board_points) else None
