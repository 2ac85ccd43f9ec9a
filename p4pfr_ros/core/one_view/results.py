# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the robust estimation is asked (``EstimateOptions``) and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
import enum
import math

from .observability import Observability
from ..geometry import Array, Mask
from ..minimal.solution import Solution


class Status(enum.Enum):
    """Why the search ended; the value is a sentence for people."""

    CONFIDENT = 'enough samples were drawn for the confidence that was asked for'
    SPENT = 'the most samples that were allowed have been drawn'
    UNDETERMINED = 'a pose was found, but the view leaves some of it open: see observable'
    FOUR_POINTS = 'exactly four points: every solution was found, none can be checked'
    COLLINEAR = 'the board points lie on one line, so no pose can be told from them'
    NO_SOLUTION = 'no camera within the gates explains the points'
    NO_CONSENSUS = 'too few points agree on any one pose'


# Surer than that nobody is, and squares of less would drown all else in rounding.
_AT_LEAST = {
    'sigma_px': 1e-6,
    'prior_focal_px': 1e-3,
    'prior_focal_sigma_px': 1e-6,
    'prior_k_sigma': 1e-9,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateOptions:
    """
    How ``estimate_pose`` searches.

    Parameters
    ----------
    threshold_px
        A point farther from its reprojection is an outlier.
    confidence
        Of having drawn one sample without an outlier when the search stops.
    min_iterations, max_iterations
        Bounds on the number of samples.
    min_inliers
        With more than four points: fewer that agree are no consensus.
    min_fov_deg, max_fov_deg
        The whole field of view along the image's diagonal that a camera may have.
    max_distortion
        Largest |k| |d|² at the image's corner.
    sigma_px
        Standard deviation of a corner's x and y. None: measured from the residuals, and where
        exactly four points leave none, taken as 0.5.
    prior_focal_px, prior_focal_sigma_px
        The focal length that the camera is known to have, and its standard deviation, px.
    prior_k, prior_k_sigma
        The same of the distortion; known where prior_k_sigma is given.
    seed
        The same seed and the same input give the same output.

    Raises
    ------
    ValueError
        An option is out of its range.

    """

    threshold_px: float = 2.0
    confidence: float = 0.9999
    min_iterations: int = 10
    max_iterations: int = 5000
    min_inliers: int = 6
    min_fov_deg: float = 5.0
    max_fov_deg: float = 175.0
    max_distortion: float = 1.0
    sigma_px: float | None = None
    prior_focal_px: float | None = None
    prior_focal_sigma_px: float | None = None
    prior_k: float = 0.0
    prior_k_sigma: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        for name, low, high in (
            ('threshold_px', 0.0, math.inf),
            ('confidence', 0.0, 1.0),
            ('min_fov_deg', 0.0, 360.0),
            ('max_fov_deg', self.min_fov_deg, 360.0),
            ('max_distortion', 0.0, math.inf),
        ):
            value = getattr(self, name)
            if not low < value < high:
                raise ValueError(f'{name} must be between {low} and {high}, got {value}')
        if not 1 <= self.min_iterations <= self.max_iterations:
            raise ValueError(
                'min_iterations must be at least 1 and at most max_iterations, got '
                f'{self.min_iterations} and {self.max_iterations}'
            )
        if self.min_inliers < 4:
            raise ValueError(f'min_inliers must be at least 4, got {self.min_inliers}')
        for name, low in _AT_LEAST.items():
            value = getattr(self, name)
            if value is not None and not low <= value < math.inf:
                raise ValueError(f'{name} must be at least {low:g}, got {value}')
        self._check_priors()

    def _check_priors(self) -> None:
        if (self.prior_focal_px is None) != (self.prior_focal_sigma_px is None):
            raise ValueError('prior_focal_px and prior_focal_sigma_px must be given together')
        if not math.isfinite(self.prior_k):
            raise ValueError(f'prior_k must be finite, got {self.prior_k}')
        if self.prior_k != 0.0 and self.prior_k_sigma is None:
            raise ValueError('prior_k must come with prior_k_sigma')


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseEstimate:
    """
    What one view tells; every number is of ``model``.

    model
        Camera and ``camera_from_board`` (board units), or None: then ``stop`` says why.
    inliers : (N,) bool
        The points within the threshold.
    rms_px
        Root of the mean squared distance between the inliers and their reprojections.
    iterations
        Samples drawn.
    covariance : (8, 8)
        Of x, y, z, the rotation about x, y, z (radians; fixed axes of the camera frame, as in
        ROS), focal_px and k. NaN without a model.
    alternatives
        Other solutions that explain the view as well.
    observable
        Which quantities the view determines at all.
    """

    model: Solution | None
    status: Status
    inliers: Mask
    rms_px: float
    iterations: int
    covariance: Array
    alternatives: tuple[Solution, ...]
    observable: Observability
