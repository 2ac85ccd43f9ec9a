# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The options, states and results of self-calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
import enum
import math
from typing import Any

import numpy as np

from ..cameras.division import DivisionCamera
from ..geometry import Array, as_points, fields_equal, Mask, Pose, read_only
from ..model.board_shape import BoardShape
from ..model.lens import ASPECT, CX, CY, FOCAL, K, LENS_SIZE, P1, P2, TERMS
from ..model.uncertainty import sigma_at
from ..options import check_options, option

# Tolerated deviation of a covariance from symmetric and positive semidefinite, in variances.
_ROUNDING = 1e-6

# Products of larger variances may not be finite.
LARGEST_VARIANCE = 1e60

# Rows and columns of the parts of the image in which points are counted as seen.
COVERAGE_SHAPE = (12, 16)


class CalibrationState(enum.Enum):
    """Progress of the calibration; the value is a sentence to print."""

    UNCALIBRATED = 'uncalibrated: the views do not determine focal length and distortion yet'
    CONVERGING = 'converging: the camera is known roughly and improves with each new view'
    CALIBRATED = 'calibrated: all uncertainties are within tolerance'


class Verdict(enum.Enum):
    """How self-calibration used a view; the value is a sentence to print."""

    USED = 'the camera was estimated again with this view'
    REDUNDANT = 'the view agrees with the camera and adds no information'
    OUTLIER = 'the view disagrees with the camera and is not used'
    RESTARTED = 'the last views disagree with the camera: it has changed, the calibration restarts'
    NO_POSE = 'no pose could be estimated from the view'


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationOptions:
    """
    Options of ``SelfCalibration``.

    Parameters
    ----------
    max_views
        Maximum number of keyframes: the views that together determine the camera best. Others
        are marginalised.
    min_views
        Minimum number of views of a calibrated camera.
    focal_tolerance
        Calibrated below this standard deviation of the focal length, as a share of it.
    center_tolerance
        The same for the principal point, as a share of the image diagonal.
    projection_tolerance_px
        The same for the projection of a direction where points were seen, pixels.
    center_spread
        Prior standard deviation of the principal point from the middle of the image, as a share
        of the diagonal.
    new_view
        A view is new if its points are at least this far from their places in every keyframe, as
        a share of the image diagonal.
    outliers_to_restart
        Number of disagreeing views, of the last ten informative ones, that restart the
        calibration.

    Raises
    ------
    ValueError
        An option is out of its range.

    """

    max_views: int = option(
        40,
        'Maximum number of keyframes: the views that together determine the camera best.',
        low=2,
        high=1000,
    )
    min_views: int = option(5, 'Minimum number of views of a calibrated camera.', low=2, high=1000)
    focal_tolerance: float = option(
        0.005,
        'Calibrated below this standard deviation of the focal length, as a share of it.',
        low=1e-6,
        high=0.5,
    )
    center_tolerance: float = option(
        0.005,
        'Calibrated below this standard deviation of the principal point, as a share of the image '
        'diagonal.',
        low=1e-6,
        high=0.5,
    )
    projection_tolerance_px: float = option(
        3.0,
        'Calibrated below this standard deviation of the projection of a direction, anywhere '
        'where points were seen, pixels.',
        low=1e-3,
        high=1000.0,
    )
    center_spread: float = option(
        0.03,
        'Prior standard deviation of the principal point from the middle of the image, as a share '
        'of the diagonal.',
        low=1e-6,
        high=0.5,
    )
    new_view: float = option(
        0.02,
        'A view is new if its points are at least this far from their places in every keyframe, '
        'as a share of the image diagonal.',
        low=1e-6,
        high=1.0,
    )
    outliers_to_restart: int = option(
        5,
        'Number of disagreeing views, of the last ten informative ones, that restart the '
        'calibration.',
        low=2,
        high=10,
    )

    def __post_init__(self) -> None:
        check_options(self)
        if not self.min_views <= self.max_views:
            raise ValueError(
                f'min_views must be at most max_views = {self.max_views}, got {self.min_views}'
            )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Keyframe:
    """
    A view that the camera is fitted to.

    image_points (N, 2) raw px, board_points (N, 2) and camera_from_board in board units,
    inliers (N,) bool, residuals_px (N, 2) reprojected minus observed (NaN if the camera does not
    see the point), rms_px of the inliers, the caller's stamp, and the board's name. The points are
    reprojected from where they are on the real board, ``CameraEstimate.board_shape``. The arrays
    are read-only.
    """

    image_points: Array
    board_points: Array
    camera_from_board: Pose
    inliers: Mask
    residuals_px: Array
    rms_px: float
    stamp: Any
    board: str = ''

    def __post_init__(self) -> None:
        for array in (self.image_points, self.board_points, self.inliers, self.residuals_px):
            read_only(array)

    def __eq__(self, other: object) -> bool:
        return fields_equal(self, other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return (
            f'Keyframe(stamp={self.stamp!r}, inliers={int(self.inliers.sum())}/'
            f'{len(self.inliers)}, rms_px={self.rms_px:.3g}, {self.camera_from_board})'
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CameraEstimate:
    """
    A camera estimated from many views.

    Parameters
    ----------
    camera
        The camera.
    covariance : (10, 10) array
        Of focal_px, the centre's x and y (px), k, k2, k3, k4, aspect, p1 and p2, in this order.
        A term that the views did not ask for is zero in the camera, and has the variance that
        they leave to it. Zero variance: taken as exact. Read-only. A (6, 6) array, up to k3, is
        accepted.
    rms_px
        Root mean square distance between the views' inliers and their reprojections.
    views
        Number of views.
    scatter
        Chi-square per degree of freedom of the views' cameras: 1 where lens and boards explain
        all. The covariance includes it.
    projection_sigma_px
        Largest standard deviation of the projection of a direction where points were seen, apart
        from a turn of the camera, pixels. NaN: unknown.
    seen_radius_px
        Distance from the centre to the outermost point that was seen, pixels. None: unknown.
    board_shapes
        The shapes of the boards by their names.
    coverage : (12, 16) array of bool
        Parts of the image, row by row, in which points were seen. None: unknown.

    Raises
    ------
    ValueError
        The covariance is extreme, not symmetric or not ≥ 0, rms_px or another number is negative
        or not finite, or views is not positive.

    """

    camera: DivisionCamera
    covariance: Array
    rms_px: float
    views: int
    scatter: float = 1.0
    projection_sigma_px: float = math.nan
    seen_radius_px: float | None = None
    board_shapes: Mapping[str, BoardShape] = field(default_factory=dict)
    coverage: Mask | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, 'covariance', read_only(_checked_covariance(self.covariance)))
        if not 0.0 <= self.rms_px < math.inf:
            raise ValueError(f'rms_px must be finite and ≥ 0, got {self.rms_px}')
        if self.views < 1:
            raise ValueError(f'views must be at least 1, got {self.views}')
        if not 1.0 <= self.scatter < math.inf:
            raise ValueError(f'scatter must be finite and ≥ 1, got {self.scatter}')
        if self.projection_sigma_px < 0.0 or math.isinf(self.projection_sigma_px):
            given = self.projection_sigma_px
            raise ValueError(f'projection_sigma_px must be finite and ≥ 0, got {given}')
        if self.seen_radius_px is not None and not 0.0 < self.seen_radius_px < math.inf:
            raise ValueError(f'seen_radius_px must be finite and > 0, got {self.seen_radius_px}')
        object.__setattr__(self, 'board_shapes', dict(self.board_shapes))
        if self.coverage is not None:
            coverage = np.array(self.coverage, dtype=bool)
            if coverage.shape != COVERAGE_SHAPE:
                raise ValueError(
                    f'coverage must have shape {COVERAGE_SHAPE}, got {coverage.shape}'
                )
            object.__setattr__(self, 'coverage', read_only(coverage))

    def __eq__(self, other: object) -> bool:
        return fields_equal(self, other)

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy has no pickle.
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        values['board_shapes'] = dict(self.board_shapes)
        return CameraEstimate, tuple(values.values())

    def __repr__(self) -> str:
        return (
            f'CameraEstimate({self.camera}, focal_sigma_px={self.focal_sigma_px:.3g}, '
            f'projection_sigma_px={self.projection_sigma_px:.3g}, '
            f'rms_px={self.rms_px:.3g}, views={self.views})'
        )

    def board_shape(self, board: str = '') -> BoardShape | None:
        """Return the shape of a board by its name; None if it was not estimated."""
        return self.board_shapes.get(board)

    @property
    def focal_sigma_px(self) -> float:
        """Standard deviation of the focal length, px."""
        return sigma_at(self.covariance, FOCAL)

    @property
    def center_sigma_px(self) -> Array:
        """Standard deviations (2,) of the centre's x and y, px."""
        return np.array([sigma_at(self.covariance, CX), sigma_at(self.covariance, CY)])

    @property
    def k_sigma(self) -> float:
        """Standard deviation of k."""
        return sigma_at(self.covariance, K)

    @property
    def terms_sigma(self) -> tuple[float, float, float, float]:
        """Standard deviations of k, k2, k3 and k4."""
        k, k2, k3, k4 = (sigma_at(self.covariance, i) for i in range(LENS_SIZE)[TERMS])
        return k, k2, k3, k4

    @property
    def aspect_sigma(self) -> float:
        """Standard deviation of the aspect ratio."""
        return sigma_at(self.covariance, ASPECT)

    @property
    def decentring_sigma(self) -> tuple[float, float]:
        """Standard deviations of p1 and p2."""
        return sigma_at(self.covariance, P1), sigma_at(self.covariance, P2)


def _checked_covariance(given: Array) -> Array:
    """Return a copy of a covariance, (10, 10); a (6, 6) one lacks the last four parameters."""
    shape = (6, 6) if np.shape(given) == (6, 6) else (LENS_SIZE, LENS_SIZE)
    covariance = np.zeros((LENS_SIZE, LENS_SIZE))
    covariance[: shape[0], : shape[1]] = as_points(given, 'covariance', shape)
    if not np.abs(covariance).max() <= LARGEST_VARIANCE:
        raise ValueError(f'covariance must be at most {LARGEST_VARIANCE:g}')
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # In units of the standard deviations: px² and k² differ by orders of magnitude.
    unit = covariance / np.outer(*(2 * [np.where(sigma > 0.0, sigma, 1.0)]))
    symmetric = np.abs(unit - unit.T).max() <= _ROUNDING
    if not (symmetric and np.linalg.eigvalsh(unit)[0] >= -_ROUNDING):
        raise ValueError(f'covariance must be symmetric and ≥ 0, got {covariance.tolist()}')
    return covariance
