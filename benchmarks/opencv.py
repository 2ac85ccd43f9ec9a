# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Timing of OpenCV and of ``estimate_pose`` on the same views."""

from __future__ import annotations

from collections.abc import Callable
import time

import cv2
import numpy as np
from p4pfr_ros import estimate_pose, EstimateOptions, Pose, PoseEstimate
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.scenes.instances import IMAGE_SIZE
from p4pfr_ros.scenes.single_view import draw_view, SyntheticView

# The calls to time, by name; each list is repeated in order.
Calls = dict[str, list[Callable[[], object]]]

# EstimateOptions.min_inlier_ratio is 0.25 by default.
USUAL_OUTLIERS_PERCENT = 75

_CALIBRATE_FLAGS = (
    cv2.CALIB_USE_INTRINSIC_GUESS
    | cv2.CALIB_FIX_PRINCIPAL_POINT
    | cv2.CALIB_FIX_ASPECT_RATIO
    | cv2.CALIB_ZERO_TANGENT_DIST
    | cv2.CALIB_FIX_K2
    | cv2.CALIB_FIX_K3
)


def calibrate(drawn: SyntheticView) -> None:
    """Call cv2.calibrateCamera on one view, with k1 free."""
    guess_px = float(max(IMAGE_SIZE))
    x, y = (IMAGE_SIZE[0] - 1) / 2.0, (IMAGE_SIZE[1] - 1) / 2.0
    matrix = np.array([[guess_px, 0.0, x], [0.0, guess_px, y], [0.0, 0.0, 1.0]])
    points = _in_space(drawn.board_points).astype(np.float32)
    image = drawn.image_points.astype(np.float32)
    cv2.calibrateCamera([points], [image], IMAGE_SIZE, matrix, np.zeros(5), flags=_CALIBRATE_FLAGS)


def pose_from_undistorted(points: Array, undistorted: Array) -> Pose:
    """Call cv2.solvePnP (IPPE) and its refinement on points (N, 3) and (N, 2) at z = 1."""
    _, rotation, translation = cv2.solvePnP(
        points, undistorted, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    rotation, translation = cv2.solvePnPRefineLM(
        points, undistorted, np.eye(3), None, rotation, translation
    )
    return Pose(cv2.Rodrigues(rotation)[0], translation.ravel())


def undistort(drawn: SyntheticView) -> tuple[Array, Array]:
    """Return the inputs of solvePnP: board points (N, 3), undistorted image points (N, 2)."""
    rays = drawn.camera.unproject(drawn.image_points)
    return _in_space(drawn.board_points), np.ascontiguousarray(rays[:, :2] / rays[:, 2:])


def _in_space(board: Array) -> Array:
    return np.column_stack([board, np.zeros(len(board))])


def options_for(outlier_percent: int, *, ideal: bool) -> EstimateOptions:
    """Return options, without deviations or not; for more outliers than the default allows."""
    options = EstimateOptions.ideal if ideal else EstimateOptions
    if outlier_percent <= USUAL_OUTLIERS_PERCENT:
        return options()
    return options(min_inlier_ratio=0.05)


def estimate(drawn: SyntheticView, options: EstimateOptions) -> PoseEstimate:
    """Call ``estimate_pose`` with an unknown camera."""
    return estimate_pose(
        drawn.image_points, drawn.board_points, image_size=IMAGE_SIZE, options=options
    )


def estimate_known(drawn: SyntheticView, options: EstimateOptions) -> PoseEstimate:
    """Call ``estimate_pose`` with the known camera."""
    return estimate_pose(
        drawn.image_points, drawn.board_points, camera=drawn.camera, options=options
    )


def views_of(n_points: int, outlier_percent: int, count: int) -> list[SyntheticView]:
    """Draw views for the timing."""
    rng = np.random.default_rng([n_points, outlier_percent, 1])
    return [draw_view(rng, n_points, outlier_share=outlier_percent / 100.0) for _ in range(count)]


def median_ms(calls: Calls, rounds: int) -> dict[str, float]:
    """Return median times; calls alternate, so that a busy machine slows all of them alike."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for i in range(max(map(len, calls.values()))):
            for name, each in calls.items():
                start = time.perf_counter()
                each[i % len(each)]()
                times[name].append(time.perf_counter() - start)
    return {name: 1e3 * float(np.median(seconds)) for name, seconds in times.items()}
