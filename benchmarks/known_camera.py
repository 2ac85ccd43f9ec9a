# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pose with a known camera, against cv2.solvePnP with refinement on undistorted points."""

from __future__ import annotations

from collections.abc import Sequence
import functools
import math

import numpy as np
from p4pfr_ros import EstimateOptions, Pose
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.scenes.single_view import SyntheticView

from .opencv import estimate_known, median_ms, pose_from_undistorted, undistort, views_of

_POINTS = (4, 8, 24, 100, 500)
_ROUNDS = 7

_IDEAL, _DEFAULT = EstimateOptions.ideal(), EstimateOptions()

KNOWN_HEADER = (
    'points',
    'estimate_pose:\nrotation ° / position %',
    'OpenCV:\nrotation ° / position %',
    'estimate_pose, ms,\nno deviations',
    'estimate_pose, ms',
    'OpenCV, ms,\nwithout undistortion',
    'ratio',
)


def known_rows(scenes: int) -> list[tuple[str, ...]]:
    """Measure each number of points over the given number of scenes."""
    return [_row(n, views_of(n, 0, scenes)) for n in _POINTS]


def _row(n: int, views: list[SyntheticView]) -> tuple[str, ...]:
    prepared = [undistort(v) for v in views]
    opencv = [pose_from_undistorted(*p) for p in prepared]
    estimates = [estimate_known(v, _DEFAULT) for v in views]
    ours = [e.model.camera_from_board if e.model else None for e in estimates]
    times = median_ms(
        {
            'ideal': [functools.partial(estimate_known, v, _IDEAL) for v in views],
            'ours': [functools.partial(estimate_known, v, _DEFAULT) for v in views],
            'opencv': [functools.partial(pose_from_undistorted, *p) for p in prepared],
        },
        _ROUNDS,
    )
    return (
        str(n),
        _medians(ours, views),
        _medians(opencv, views),
        f'{times["ideal"]:.3f}',
        f'{times["ours"]:.3f}',
        f'{times["opencv"]:.3f}',
        f'{times["ours"] / times["opencv"]:.2f}',
    )


def _medians(poses: Sequence[Pose | None], views: list[SyntheticView]) -> str:
    errors = np.array([_error(p, v) for p, v in zip(poses, views, strict=True)])
    rotation_deg, position = np.median(errors, axis=0)
    return f'{rotation_deg:.4f} / {position:.4f}'


def _error(pose: Pose | None, drawn: SyntheticView) -> tuple[float, float]:
    if pose is None:
        return math.inf, math.inf
    truth = drawn.camera_from_board
    distance = np.linalg.norm(pose.translation - truth.translation)
    return (
        math.degrees(rotation_angle_rad(pose.rotation, truth.rotation)),
        100.0 * float(distance / np.linalg.norm(truth.translation)),
    )
