# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Single views of real cameras: the stated and the true error of the focal length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from p4pfr_ros import estimate_pose, EstimateOptions, PoseEstimate
from p4pfr_ros.core.geometry import Array

# Focal lengths fx of the cameras of the real corners, px, from calibrations of all their views
# with aspect ratio and the shape of the board.
REAL_FOCAL_PX = {
    'opencv_left': 533.5,
    'gopro_hero': 440.1,
    'gopro_wide': 563.7,
    'fisheye_a_left': 228.3,
    'webcam_stretched': 195.4,
}
REAL_SIGMAS = 3.0
# Its pixels are 18 % from square, far more than any deviation that the options allow for.
_STRETCHED = 'webcam_stretched'

REAL_HEADER = (
    'camera',
    'views',
    'focal length observable',
    f'of them f beyond {REAL_SIGMAS:g} sigma',
    'median error of f',
)


@dataclass(frozen=True, slots=True)
class RealViews:
    """
    Estimates from single views of a real camera.

    views: their number; z, percent: of those whose focal length is observable, its error in
    standard deviations, and in percent of the reference.
    """

    views: int
    z: Array
    percent: Array


def real_views(corners: Path, options: EstimateOptions) -> RealViews:
    """Estimate from the corners of each photograph alone; corners: an .npz file of a camera."""
    reference_px = REAL_FOCAL_PX[corners.stem]
    data = np.load(corners)
    estimates = [
        estimate_pose(
            data['image_points'][data['view'] == view],
            data['board_points'][data['view'] == view],
            image_size=tuple(data['image_size'].tolist()),
            options=options,
        )
        for view in np.unique(data['view'])
    ]
    told = [e for e in estimates if e.model is not None and e.observable.focal]
    return RealViews(
        len(estimates),
        np.array([_focal_error_px(e, reference_px) / e.focal_sigma_px for e in told]),
        np.array([100.0 * _focal_error_px(e, reference_px) / reference_px for e in told]),
    )


def _focal_error_px(estimate: PoseEstimate, reference_px: float) -> float:
    assert estimate.model is not None
    return estimate.model.camera.focal_px - reference_px


def real_rows(measured: Mapping[str, RealViews]) -> list[tuple[str, ...]]:
    """Return a row for each camera, and rows for all and for those with nearly square pixels."""
    square = [views for name, views in measured.items() if name != _STRETCHED]
    return [
        *(_real_row(name, views) for name, views in measured.items()),
        _real_row('all', _together(list(measured.values()))),
        _real_row(f'all but {_STRETCHED}', _together(square)),
    ]


def _together(measured: Sequence[RealViews]) -> RealViews:
    return RealViews(
        sum(views.views for views in measured),
        np.concatenate([views.z for views in measured]),
        np.concatenate([views.percent for views in measured]),
    )


def _real_row(name: str, views: RealViews) -> tuple[str, ...]:
    beyond = int(np.count_nonzero(np.abs(views.z) > REAL_SIGMAS))
    count = len(views.z)
    return (
        name,
        str(views.views),
        str(count),
        f'{beyond} ({100.0 * beyond / count:.1f} %)' if count else '',
        f'{np.median(np.abs(views.percent)):.2f} %' if count else '',
    )
