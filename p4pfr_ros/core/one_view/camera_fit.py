# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Whether a known camera fits a view: the calibration may be of another zoom, binning or device.

Points of a plane and their rays determine a homography, 8 numbers. The pose has 6, so a wrong
camera shows in two: in-plane stretch and skew of the board, as if it had been printed wrong,

    P = R (X + a X + b Y, Y - a Y + b X, 0) + t.

They cost one more linearisation. Only if they are too large, or if there is no pose, is the view
fitted with a free camera, which shows whether another focal length or centre is the reason.

This module stands alone because it judges a camera; ``estimate_pose`` estimates with it.
"""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from .known_camera import add_stretched_points
from .least_squares import LeastSquaresWork, Problem
from .results import CameraFit, EstimateOptions, no_estimate, PoseEstimate, Status
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..jit import jit
from ..linalg import invert_information
from ..model.normal_equations import COLUMNS
from ..model.uncertainty import DEFAULT_SIGMA_PX, noise_variance

# Standard deviation of stretch and skew with the right camera: paper, pixels that are not quite
# square, a rolling shutter.
_USUAL_STRETCH = 0.006

# Chi-square of stretch and skew, and share of inliers, beyond which a free camera is tried.
_LARGE_CHI2 = 9.0
_FEW_INLIERS = 0.8

# Residuals of fewer degrees of freedom do not measure the noise; otherwise it is at least this.
_ENOUGH_DOF = 4
_SMALLEST_SIGMA_PX = 0.1

# A free camera is another one if the logarithm of its focal length differs by more than this, or
# its centre by that share of the image's diagonal. A view alone shows it at 6 sigma, squared here:
# with a right camera, a board bowed by 2 mm reached 35 in 200 views.
_OTHER_FOCAL = 0.3
_OTHER_CENTER = 0.1
_LARGE_EVIDENCE = 40.0

# A view is telling if a smaller stretch would show; a tilted board's is some percent with a camera
# that does not fit, a fronto-parallel one's is none.
_TELLING_SIGMA = 0.005
_TELLING_TILT_DEG = 20.0


def is_bad(estimate: PoseEstimate) -> bool:
    """Return whether a view with a known camera needs a fit with a free one to judge it."""
    fit = estimate.camera_fit
    return fit is None or fit.stretch_chi2 > _LARGE_CHI2 or not _has_most_inliers(estimate)


def proves_camera(estimate: PoseEstimate) -> bool:
    """Return whether a view supports the known camera: with most others it would not fit."""
    fit = estimate.camera_fit
    return (
        estimate.model is not None
        and fit is not None
        and fit.stretch_sigma < _TELLING_SIGMA
        and not is_bad(estimate)
        and estimate.model.camera_from_board.tilt_deg > _TELLING_TILT_DEG
    )


def _has_most_inliers(estimate: PoseEstimate) -> bool:
    inliers = estimate.inliers
    return bool(np.count_nonzero(inliers) >= _FEW_INLIERS * len(inliers))


def free_options(options: EstimateOptions) -> EstimateOptions:
    """Return the options of a free camera, its usual deviations allowed and without priors."""
    usual = EstimateOptions()
    names = ('center_spread', 'lens_spread', 'aspect_spread', 'board_stretch', 'board_bow')
    return replace(
        options,
        prior_focal_px=None,
        prior_focal_sigma_px=None,
        prior_k=0.0,
        prior_k_sigma=None,
        **{name: max(getattr(options, name), getattr(usual, name)) for name in names},
    )


def compared(
    estimate: PoseEstimate,
    free: PoseEstimate,
    camera: DivisionCamera,
    image_size: tuple[float, float] | None,
) -> PoseEstimate:
    """
    Return an estimate with a known camera after its comparison with a free one's; or MISFIT.

    image_size None: unknown, and the free camera has the same centre.
    """
    fit = estimate.camera_fit or CameraFit(math.inf, math.inf)
    if free.model is None or free.inliers.sum() < max(estimate.inliers.sum(), 4):
        return replace(estimate, camera_fit=fit)
    cameras = [solution.camera for solution in (free.model, *free.alternatives)]
    log_focal = min(abs(math.log(c.focal_px / camera.focal_px)) for c in cameras)
    sigma = free.focal_sigma_px / free.model.camera.focal_px
    evidence = (log_focal / sigma) ** 2 if log_focal > _OTHER_FOCAL else 0.0
    if image_size is not None and fit.stretch_chi2 < math.inf:
        off_px = min(math.dist(c.center_px, camera.center_px) for c in cameras)
        if off_px > _OTHER_CENTER * math.hypot(*image_size):
            evidence = max(evidence, fit.stretch_chi2)
    # Of four points one that is off asks for another camera, too.
    n = len(estimate.inliers)
    if n > 4 and evidence > _LARGE_EVIDENCE:
        estimate = no_estimate(Status.MISFIT, n, estimate.iterations)
    return replace(estimate, camera_fit=replace(fit, evidence=evidence))


@jit
def stretched_equations(
    row: Array, problem: Problem, limit: float, work: LeastSquaresWork
) -> None:
    """Write JᵀJ and -Jᵀr as ``normal_equations`` does; columns 6 and 7 are stretch and skew."""
    normal = work.normal
    for a in range(8):
        for b in range(COLUMNS):
            normal[a, b] = 0.0
    add_stretched_points(
        row, problem.board, problem.rays, problem.across, limit, work.jacobian, normal
    )
    for a in range(8):
        for b in range(a):
            normal[a, b] = normal[b, a]
        normal[a, 8] = -normal[a, 8]


@jit
def stretch_of(
    inliers: tuple[int, float], limit: float, sigma_px: float, work: LeastSquaresWork
) -> tuple[float, float]:
    """
    Return chi-square and standard deviation of stretch and skew from ``stretched_equations``.

    inliers: their number and the sum of their squared errors, px²; limit: the squared threshold;
    sigma_px 0: the noise is measured.
    """
    normal, covariance, shift = work.normal, np.empty((8, 8)), np.zeros(8)
    invert_information(normal, 8, work.system, covariance)
    count, total = inliers
    for a in range(8):
        for b in range(8):
            shift[a] += covariance[a, b] * normal[b, 8]
        total -= shift[a] * normal[a, 8]
    variance = sigma_px * sigma_px
    if sigma_px == 0.0:
        variance = DEFAULT_SIGMA_PX * DEFAULT_SIGMA_PX
        if 2 * count - 8 >= _ENOUGH_DOF:
            variance = noise_variance(max(total, 0.0), 2 * count - 8, limit)
            variance = max(variance, _SMALLEST_SIGMA_PX * _SMALLEST_SIGMA_PX)
    aa, bb, ab = covariance[6, 6], covariance[7, 7], variance * covariance[6, 7]
    sigma = math.sqrt(variance * max(aa, bb))
    aa = variance * aa + _USUAL_STRETCH * _USUAL_STRETCH
    bb = variance * bb + _USUAL_STRETCH * _USUAL_STRETCH
    a, b = shift[6], shift[7]
    return (bb * a * a - 2.0 * ab * a * b + aa * b * b) / (aa * bb - ab * ab), sigma
