# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The options and the result of ``estimate_pose``.

``Observability`` names the quantities that a view determines; in the covariance the others have
infinite variances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import enum
import functools
import math
from typing import Any

import numpy as np

from ..geometry import Array, fields_equal, Mask
from ..minimal.solution import Solution
from ..model.uncertainty import COV_FOCAL, COV_K, COVARIANCE_SIZE, POSITION, ROTATION, sigma_at
from ..options import check_options, option, switch

# Largest standard deviations of observable quantities: focal length and distance, relative; the
# direction of the board, radians; the distortion, as k |d|² at the image's corner.
_MAX_SHARE = MAX_FOCAL_SHARE = 0.3
_MAX_DIRECTION_RAD = 0.3
_MAX_BEND = 0.3


# Options that are zero in a world without deviations.
_DEVIATIONS = (
    'center_spread',
    'lens_spread',
    'aspect_spread',
    'image_shear',
    'board_stretch',
    'board_bow',
)

# With smaller spreads, 1 / spread² would be so large that other information is lost in rounding.
_SMALLEST_SPREAD = 1e-6


class Status(enum.Enum):
    """How the estimation ended; the value is a sentence to print."""

    CONFIDENT = 'enough samples were drawn for the requested confidence'
    SPENT = 'the maximum number of samples was drawn'
    UNDETERMINED = 'the view does not determine all quantities: see observable'
    FOUR_POINTS = 'exactly four points: all solutions were found, none can be verified'
    COLLINEAR = 'the board points are collinear and do not determine a pose'
    NO_SOLUTION = 'no camera within the limits explains the points'
    NO_CONSENSUS = 'too few points agree on one pose'
    MISFIT = 'the calibration does not fit this image'
    SEEN_FROM_BEHIND = 'the board would be seen from behind: is the corner order right?'


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateOptions:
    """
    Options of ``estimate_pose``.

    Parameters
    ----------
    threshold_px
        Points with a larger reprojection error are outliers.
    confidence
        Probability that at least one sample without an outlier was drawn when the search stops.
    min_iterations, max_iterations
        Limits of the number of samples.
    min_inliers, min_inlier_ratio
        Minimum number of inliers of a board with more than four points, and their minimum share
        of the points. More are required where as many may agree by chance. The search ends when
        that many would have been found.
    min_fov_deg, max_fov_deg
        Limits of the camera's full field of view along the image diagonal.
    max_distortion
        Largest |k| |d|² at the image's corner.
    sigma_px
        Standard deviation of a corner's x and y. None: measured from the residuals; 0.5 for
        exactly four points, which leave no residuals.
    prior_focal_px, prior_focal_sigma_px
        Gaussian prior on the focal length: mean and standard deviation, px. None: no prior.
    prior_k, prior_k_sigma
        Gaussian prior on the distortion. prior_k_sigma None: no prior.
    focal_spread, center_spread, lens_spread
        Spread of real cameras: standard deviation of the logarithm of the focal length, of the
        principal point from the middle of the image as a share of the diagonal, and a multiple of
        the usual spread of the distortion terms. The first counts only if another is not zero.
    aspect_spread, image_shear, board_stretch, board_bow
        Standard deviations of what a view does not tell: fy/fx of the pixels, shear of the image
        by a rolling shutter (of known cameras), scale, stretch and skew of the board, and its bow
        as a share of half its size. Zero: exactly square, true, flat. `ideal` sets all to zero.
    two_sided
        Whether the board may be seen from behind, as a board of glass. Printed boards are opaque:
        a view of the back is an error in the order of the points. The front is the side from
        which board x points right and board y up.
    seed
        The same seed and the same input give the same output.

    Raises
    ------
    ValueError
        An option is out of its range.

    """

    threshold_px: float = option(
        2.0, 'Points with a larger reprojection error are outliers, pixels.', low=0.01, high=1000.0
    )
    confidence: float = option(
        0.9999,
        'Probability that at least one sample without an outlier was drawn when the search stops.',
        low=0.5,
        high=0.999999,
    )
    min_iterations: int = option(
        10, 'Minimum number of samples of four points.', low=1, high=1_000_000
    )
    max_iterations: int = option(
        100_000, 'Maximum number of samples of four points.', low=1, high=1_000_000
    )
    min_inliers: int = option(
        6,
        'Minimum number of inliers for boards with more than four points.',
        low=4,
        high=1_000_000,
    )
    min_inlier_ratio: float = option(
        0.25,
        'Minimum share of inliers among the points of a board with more than four points.',
        low=0.0,
        high=1.0,
    )
    min_fov_deg: float = option(
        5.0,
        'Smallest field of view of the camera along the image diagonal, degrees.',
        low=0.1,
        high=359.0,
    )
    max_fov_deg: float = option(
        175.0,
        'Largest field of view of the camera along the image diagonal, degrees.',
        low=0.2,
        high=359.9,
    )
    max_distortion: float = option(
        1.0,
        "Largest distortion of the lens: |k| |d|^2 at the image's corner.",
        low=1e-6,
        high=100.0,
    )
    # With smaller sigmas, 1 / sigma² would be so large that other information is lost in rounding.
    sigma_px: float | None = option(
        None,
        'Standard deviation of a corner, pixels, for the covariance. Not given: measured from the '
        'residuals; 0.5 for exactly four points.',
        low=1e-6,
        high=1000.0,
    )
    prior_focal_px: float | None = option(
        None, 'Mean of the prior on the focal length, pixels.', low=1e-3, high=1e6
    )
    prior_focal_sigma_px: float | None = option(
        None, 'Standard deviation of the prior on the focal length, pixels.', low=1e-6, high=1e6
    )
    prior_k: float = option(
        0.0, 'Mean of the prior on the distortion k of the division model.', low=-100.0, high=100.0
    )
    prior_k_sigma: float | None = option(
        None, 'Standard deviation of the prior on the distortion k.', low=1e-9, high=100.0
    )
    focal_spread: float = option(
        0.7,
        'Standard deviation of the logarithm of the focal length from that of a typical camera, '
        'if deviations are allowed.',
        low=0.01,
        high=10.0,
    )
    center_spread: float = option(
        0.03,
        'Standard deviation of the principal point from the middle of the image, as a share of '
        'the diagonal; 0: exactly there.',
        low=0.0,
        high=0.5,
    )
    lens_spread: float = option(
        1.0,
        "Multiple of the usual standard deviations of a lens's distortion terms; 0: one term, of "
        'the usual standard deviation.',
        low=0.0,
        high=100.0,
    )
    aspect_spread: float = option(
        0.003, 'Standard deviation of fy/fx of the pixels from 1; 0: square.', low=0.0, high=0.5
    )
    image_shear: float = option(
        0.003,
        'Standard deviation of the shear of the image along its rows, as by a rolling shutter; '
        'for known cameras. 0: none.',
        low=0.0,
        high=0.5,
    )
    board_stretch: float = option(
        0.0015,
        "Standard deviation of the board's scale, of its stretch along x against y, and of its "
        'skew; 0: none.',
        low=0.0,
        high=0.1,
    )
    board_bow: float = option(
        0.002,
        "Standard deviation of the board's bow, as a share of half its size; 0: flat.",
        low=0.0,
        high=0.1,
    )
    two_sided: bool = switch(
        False,
        'Whether the board may be seen from behind, as a board of glass. Otherwise a view of its '
        'back is rejected: the order of the points is mirrored.',
    )
    seed: int = option(
        0,
        'Seed of the random samples: the same seed and input give the same output.',
        low=0,
        high=2**31 - 1,
    )

    @classmethod
    def ideal(cls, **changes: Any) -> EstimateOptions:
        """
        Return options for a world without deviations.

        The principal point is exactly in the middle of the image (or as given), the lens has one
        term, pixels are square and boards flat. Where that is not true, an estimate is
        confidently wrong.
        """
        return cls(**(dict.fromkeys(_DEVIATIONS, 0.0) | changes))

    @property
    def has_deviations(self) -> bool:
        """Whether more is uncertain than pose, focal length and one distortion term."""
        return any(getattr(self, name) > 0.0 for name in _DEVIATIONS)

    def __post_init__(self) -> None:
        check_options(self)
        for name in _DEVIATIONS:
            spread = getattr(self, name)
            if 0.0 < spread < _SMALLEST_SPREAD:
                raise ValueError(
                    f'{name} must be 0, or at least {_SMALLEST_SPREAD:g}, got {spread}'
                )
        for low, high in (('min_iterations', 'max_iterations'), ('min_fov_deg', 'max_fov_deg')):
            if not getattr(self, low) <= getattr(self, high):
                raise ValueError(
                    f'{low} must be at most {high} = {getattr(self, high)}, '
                    f'got {getattr(self, low)}'
                )
        if (self.prior_focal_px is None) != (self.prior_focal_sigma_px is None):
            raise ValueError('prior_focal_px and prior_focal_sigma_px must be given together')
        if self.prior_k != 0.0 and self.prior_k_sigma is None:
            raise ValueError('prior_k must come with prior_k_sigma')


_QUANTITIES = ('direction', 'distance', 'focal', 'distortion')


@dataclass(frozen=True, slots=True)
class Observability:
    """
    The quantities that a view determines.

    direction: the board's orientation; distance: its translation along the line of sight;
    focal: the focal length; distortion: k.
    """

    direction: bool = False
    distance: bool = False
    focal: bool = False
    distortion: bool = False

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The names of the quantities that the view does not determine."""
        return tuple(name for name in _QUANTITIES if not getattr(self, name))

    @property
    def pose(self) -> bool:
        """Whether the view determines the pose: direction and distance."""
        return self.direction and self.distance


@dataclass(frozen=True, slots=True)
class CameraFit:
    """
    How a view fits the camera that it was estimated with.

    stretch_chi2, stretch_sigma
        Chi-square (two degrees of freedom) and standard deviation of the stretch that the board
        would need; infinite without a pose.
    evidence
        Chi-square (one degree of freedom) by which a free camera contradicts the known one; 0 if
        the view does not ask for another camera, or fits well enough not to be asked.
    """

    stretch_chi2: float
    stretch_sigma: float
    evidence: float = 0.0


@dataclass(frozen=True, slots=True)
class FocalLimits:
    """
    What limits the focal length of an unknown camera: shares of its variance, from 0 to 1.

    They are from the priors on the principal point, on the distortion terms, and on pixels and
    board; the rest is from the noise and the prior on the focal length.
    """

    center: float
    lens: float
    others: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class PoseEstimate:
    """
    The result of one view; every number belongs to ``model``.

    model
        Camera and ``camera_from_board`` (board units), or None: ``status`` gives the reason.
    inliers : (N,) bool
        The points within the threshold.
    rms_px
        Root mean square distance between the inliers and their reprojections, deviations of board
        and image as far as `EstimateOptions` allows them included.
    iterations
        Number of samples drawn.
    covariance : (8, 8)
        Of x, y, z, the rotation about x, y, z (radians; fixed axes of the camera frame, as in
        ROS), focal_px and k. NaN without a model; infinite variance of what is not observable.
    alternatives
        Other solutions that explain the view as well.
    observable
        The quantities that the view determines.
    focal_limits
        What limits the focal length; None if the camera is known, or without deviations.
    camera_fit
        With a known camera: how well it fits the view.
    """

    model: Solution | None
    status: Status
    inliers: Mask
    rms_px: float
    iterations: int
    covariance: Array
    alternatives: tuple[Solution, ...]
    observable: Observability
    camera_fit: CameraFit | None = None
    focal_limits: FocalLimits | None = None

    def __post_init__(self) -> None:
        self.inliers.flags.writeable = self.covariance.flags.writeable = False

    def __eq__(self, other: object) -> bool:
        return fields_equal(self, other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        inliers = f'{int(self.inliers.sum())}/{len(self.inliers)}'
        return (
            f'PoseEstimate({self.status.name}, inliers={inliers}, rms_px={self.rms_px:.3g}, '
            f'model={self.model}, alternatives={len(self.alternatives)}, '
            f'undetermined={self.observable.undetermined})'
        )

    @property
    def focal_sigma_px(self) -> float:
        """Standard deviation of the focal length, px; infinite if it is not observable."""
        return sigma_at(self.covariance, COV_FOCAL)

    @property
    def k_sigma(self) -> float:
        """Standard deviation of k; infinite if it is not observable."""
        return sigma_at(self.covariance, COV_K)

    @property
    def distance_sigma(self) -> float:
        """Standard deviation of the distance to the board's origin, board units; NaN: no model."""
        if self.model is None:
            return math.nan
        if not self.observable.distance:
            return math.inf
        position = self.model.camera_from_board.translation
        sight = position / np.linalg.norm(position)
        return math.sqrt(max(0.0, float(sight @ self.covariance[POSITION, POSITION] @ sight)))


@functools.lru_cache(maxsize=64)
def without_deviations(options: EstimateOptions) -> EstimateOptions:
    """Return the same options for a world without deviations: those of a search."""
    changes: dict[str, Any] = dict.fromkeys(_DEVIATIONS, 0.0)
    return replace(options, **changes)


def with_unusual_deviations(options: EstimateOptions, factor: float) -> EstimateOptions:
    """Return the same options for boards and shutters that deviate more, by a factor."""
    return replace(
        options,
        image_shear=factor * options.image_shear,
        board_stretch=factor * options.board_stretch,
        board_bow=factor * options.board_bow,
    )


def no_estimate(status: Status, n: int, iterations: int) -> PoseEstimate:
    """Return the result of a view of n points without a model."""
    return PoseEstimate(
        model=None,
        status=status,
        inliers=np.zeros(n, dtype=bool),
        rms_px=math.nan,
        iterations=iterations,
        covariance=np.full((COVARIANCE_SIZE, COVARIANCE_SIZE), np.nan),
        alternatives=(),
        observable=Observability(),
    )


def observability_of(
    focal_px: float, translation: Array, covariance: Array, corner_px: float
) -> Observability:
    """
    Return which quantities a view determines, by their standard deviations.

    translation: of the board, board units; corner_px: the distance of the image's farthest corner
    from the centre.
    """
    x, y, z = translation.tolist()
    c = covariance.tolist()
    distance2 = x * x + y * y + z * z
    along = (
        x * (x * c[0][0] + 2.0 * y * c[0][1] + 2.0 * z * c[0][2])
        + y * (y * c[1][1] + 2.0 * z * c[1][2])
        + z * z * c[2][2]
    )
    bend = math.sqrt(max(c[COV_K][COV_K], 0.0)) * (corner_px / focal_px) ** 2
    return Observability(
        direction=sum(c[i][i] for i in range(8)[ROTATION]) < _MAX_DIRECTION_RAD**2,
        # The variance of the distance is along / distance².
        distance=along < (_MAX_SHARE * distance2) ** 2,
        focal=c[COV_FOCAL][COV_FOCAL] < (_MAX_SHARE * focal_px) ** 2,
        distortion=bend < _MAX_BEND,
    )


def widen_focal(covariance: Array, focal_px: float, share: float) -> None:
    """
    Raise the standard deviation of the focal length to a share of it, in place.

    What depends on the focal length becomes as uncertain as it follows it.
    """
    variance = covariance[COV_FOCAL, COV_FOCAL]
    more = (share * focal_px) ** 2 - variance
    if more > 0.0:
        follows = covariance[:, COV_FOCAL] / variance
        covariance += more * np.outer(follows, follows)


def mark_undetermined(covariance: Array, observable: Observability) -> Array:
    """Give the undetermined quantities infinite variances, and no correlations (NaN)."""
    if not observable.undetermined:
        return covariance
    determined = np.empty(COVARIANCE_SIZE, dtype=bool)
    determined[POSITION], determined[ROTATION] = observable.distance, observable.direction
    determined[COV_FOCAL], determined[COV_K] = observable.focal, observable.distortion
    marked: Array = np.where(np.outer(determined, determined), covariance, np.nan)
    marked[np.diag_indices(COVARIANCE_SIZE)] = np.where(determined, np.diag(covariance), np.inf)
    return marked
