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

from dataclasses import dataclass, replace
import math

import numpy as np

from .describe import ViewProblem
from .least_squares import linearise, Problem
from .results import EstimateOptions, PoseEstimate
from ..cameras.division import DivisionCamera
from ..geometry import Array, POSE_SIZE
from ..jit import jit
from ..linalg import invert_information
from ..minimal.solution import G, H, ROW_SIZE
from ..model.normal_equations import add_point, COLUMNS
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

# A free camera is another one if the logarithm of its focal length differs by more than this, or its
# centre by that share of the image's diagonal. A view alone shows it with this evidence: 5 sigma.
_OTHER_FOCAL = 0.3
_OTHER_CENTER = 0.1
_LARGE_EVIDENCE = 25.0

# A view is telling if a smaller stretch would show; a tilted board's is some percent with a camera
# that does not fit, a fronto-parallel one's is none.
_TELLING_SIGMA = 0.005
_TELLING_TILT_DEG = 20.0


@dataclass(frozen=True, slots=True)
class CameraFit:
    """
    How a view fits the known camera.

    stretch_chi2, stretch_sigma
        Chi-square (two degrees of freedom) and standard deviation of the stretch that the board
        would need; infinite without a pose.
    evidence
        Chi-square (one degree of freedom) that a free camera's fit of the view holds against the
        known one; 0 if it does not ask for another camera, or was not needed.
    misfit
        Whether the view alone shows that the camera does not fit.
    proves
        Whether the view supports the camera: with most others it would not fit.
    """

    stretch_chi2: float
    stretch_sigma: float
    evidence: float = 0.0
    misfit: bool = False
    proves: bool = False


UNKNOWN_FIT = CameraFit(math.inf, math.inf)


def fit_of_camera(view: ViewProblem, estimate: PoseEstimate) -> CameraFit:
    """Return how a view fits the known camera that it was estimated with."""
    if estimate.model is None:
        return UNKNOWN_FIT
    pose = estimate.model.camera_from_board
    row = np.empty(ROW_SIZE)
    row[:POSE_SIZE] = view.view.observation.row_from_pose(pose)
    row[G], row[H] = 1.0, 0.0
    options = view.options
    chi2, sigma = stretch_of(
        row, view.problem(), options.threshold_px**2, options.sigma_px or 0.0
    )
    share = np.count_nonzero(estimate.inliers) / len(estimate.inliers)
    proves = (
        chi2 < _LARGE_CHI2
        and share >= _FEW_INLIERS
        and sigma < _TELLING_SIGMA
        and pose.tilt_deg > _TELLING_TILT_DEG
    )
    return CameraFit(chi2, sigma, proves=proves)


def is_bad(fit: CameraFit, estimate: PoseEstimate) -> bool:
    """Return whether a view that was estimated with a known camera needs a free one to judge it."""
    few = np.count_nonzero(estimate.inliers) < _FEW_INLIERS * len(estimate.inliers)
    return few or fit.stretch_chi2 > _LARGE_CHI2


def free_options(options: EstimateOptions) -> EstimateOptions:
    """Return the options of a free camera, its usual deviations allowed and without priors."""
    usual = EstimateOptions.realistic()
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
    fit: CameraFit,
    estimate: PoseEstimate,
    free: PoseEstimate,
    camera: DivisionCamera,
    image_size: tuple[float, float] | None,
) -> CameraFit:
    """
    Compare the known camera of an estimate with a free one's.

    image_size None: unknown, and the free camera has the same centre.
    """
    if free.model is None or free.inliers.sum() < max(estimate.inliers.sum(), 4):
        return fit
    cameras = [solution.camera for solution in (free.model, *free.alternatives)]
    log_focal = min(abs(math.log(c.focal_px / camera.focal_px)) for c in cameras)
    sigma = free.focal_sigma_px / free.model.camera.focal_px
    evidence = (log_focal / sigma) ** 2 if log_focal > _OTHER_FOCAL else 0.0
    if image_size is not None and fit.stretch_chi2 < math.inf:
        off_px = min(math.dist(c.center_px, camera.center_px) for c in cameras)
        if off_px > _OTHER_CENTER * math.hypot(*image_size):
            evidence = max(evidence, fit.stretch_chi2)
    # Of four points one that is off asks for another camera, too.
    misfit = evidence > _LARGE_EVIDENCE and len(estimate.inliers) > 4
    return replace(fit, evidence=evidence, misfit=misfit)


@jit
def stretch_of(row: Array, problem: Problem, limit: float, sigma_px: float) -> tuple[float, float]:
    """
    Return chi-square and standard deviation of the board's stretch and skew at a known pose.

    limit: the squared threshold of inliers, px²; sigma_px 0: the noise is measured.
    """
    normal, covariance = np.zeros((8, COLUMNS)), np.empty((8, 8))
    jacobian = np.empty((2, COLUMNS))
    count, total = 0, 0.0
    for i in range(len(problem.image)):
        linearise(row, problem, i, jacobian)
        x, y = problem.board[i, 0], problem.board[i, 1]
        for j in range(2):
            # The derivative by the point's place, a, is the one by the translation.
            along_x = along_y = 0.0
            for m in range(3):
                along_x += jacobian[j, 3 + m] * row[3 * m]
                along_y += jacobian[j, 3 + m] * row[3 * m + 1]
            jacobian[j, 6], jacobian[j, 7] = along_x * x - along_y * y, along_x * y + along_y * x
        if add_point(jacobian, limit, 8, normal) == 1:
            count += 1
            total += jacobian[0, 8] ** 2 + jacobian[1, 8] ** 2
    for a in range(8):
        for b in range(a):
            normal[a, b] = normal[b, a]
    invert_information(normal, 8, np.empty((8, COLUMNS)), covariance)
    shift = np.zeros(8)
    for a in range(8):
        for b in range(8):
            shift[a] -= covariance[a, b] * normal[b, 8]
    for a in range(8):
        total += shift[a] * normal[a, 8]
    variance = sigma_px * sigma_px
    dof = 2 * count - 8
    if sigma_px == 0.0:
        variance = DEFAULT_SIGMA_PX * DEFAULT_SIGMA_PX
        if dof >= _ENOUGH_DOF:
            measured = noise_variance(max(total, 0.0), dof, limit)
            variance = max(measured, _SMALLEST_SIGMA_PX * _SMALLEST_SIGMA_PX)
    usual = _USUAL_STRETCH * _USUAL_STRETCH
    aa, bb = variance * covariance[6, 6], variance * covariance[7, 7]
    ab = variance * covariance[6, 7]
    sigma = math.sqrt(max(aa, bb, 0.0))
    aa, bb = aa + usual, bb + usual
    a, b = shift[6], shift[7]
    chi2 = (bb * a * a - 2.0 * ab * a * b + aa * b * b) / (aa * bb - ab * ab)
    return chi2, sigma
