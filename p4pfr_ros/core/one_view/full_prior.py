# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What is known of lens, pixels and board before a view: the priors of the full fit.

This module stands alone because it has no state: ``full_estimate`` fits with these priors.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from .full_model import (
    BEND,
    BENDS,
    BOW_XX,
    DEVIATIONS,
    LOG_FOCAL,
    PARAMETERS,
    SHEAR,
    STRETCH,
)
from .results import EstimateOptions
from ..cameras.division import DivisionCamera
from ..geometry import Array, Ints
from ..linalg import inverse_of_information
from ..model.lens import ASPECT, CX, CY, FOCAL, K, lens_from_camera, LENS_SIZE, P2, POSE_COLUMNS
from ..model.prior import BEND_SPREADS, FREE_ASPECT_SPREAD, typical_focal_px

# The bends in a lens.
_BENDS_AT = slice(BEND, BEND + BENDS)


class ViewPrior(NamedTuple):
    """
    What is known of lens and deviations before the view.

    mean (10,) and information (10, 10) as ``full_model`` parametrises the lens; usual, sizes and
    active: see ``FullProblem``.
    """

    mean: Array
    information: Array
    usual: float
    sizes: Array
    active: Ints


def lens_of_camera(camera: DivisionCamera) -> Array:
    """Return the lens (10,) of a camera, relative to its own centre."""
    return lens_from_camera(camera, camera.center_px)


def known_prior(
    options: EstimateOptions, lens: Array, corner_px: float, covariance: Array | None
) -> ViewPrior:
    """Return a known lens (10,); terms of zero variance keep their values."""
    powers = (corner_px / lens[FOCAL]) ** (2.0 * np.arange(1, BENDS + 1))
    mean = lens.copy()
    mean[LOG_FOCAL] = math.log(lens[FOCAL])
    mean[_BENDS_AT] *= powers
    exact = _exact_prior(options)
    if covariance is None:
        return exact._replace(mean=mean)
    # θ = (log f, c, bᵢ = kᵢ (R/f)²ⁱ, ...):  d(log f) = df / f,
    # dbᵢ = (R/f)²ⁱ dkᵢ - 2i bᵢ df / f.
    jacobian = np.eye(LENS_SIZE)
    jacobian[LOG_FOCAL, FOCAL] = 1.0 / lens[FOCAL]
    for i in range(BENDS):
        jacobian[BEND + i, K + i] = powers[i]
        jacobian[BEND + i, FOCAL] = -(2 * i + 2) * mean[BEND + i] / lens[FOCAL]
    free = np.diag(covariance) > 0.0
    transformed = (jacobian @ covariance @ jacobian.T)[np.ix_(free, free)]
    information = np.zeros((LENS_SIZE, LENS_SIZE))
    information[np.ix_(free, free)] = inverse_of_information(transformed)
    if not free[ASPECT] and options.aspect_spread > 0.0:
        free[ASPECT] = True
        information[ASPECT, ASPECT] = options.aspect_spread**-2.0
    active = np.concatenate([np.ones(POSE_COLUMNS, dtype=bool), free, exact.sizes > 0.0])
    return ViewPrior(mean, information, 0.0, exact.sizes, np.flatnonzero(active))


@functools.lru_cache(maxsize=64)
def _exact_prior(options: EstimateOptions) -> ViewPrior:
    """Return what all exactly known lenses have in common; read-only."""
    sizes = _sizes_of(options)
    active = np.concatenate([np.arange(PARAMETERS - DEVIATIONS) < POSE_COLUMNS, sizes > 0.0])
    information = np.zeros((LENS_SIZE, LENS_SIZE))
    if options.aspect_spread > 0.0:
        active[POSE_COLUMNS + ASPECT] = True
        information[ASPECT, ASPECT] = options.aspect_spread**-2.0
    return ViewPrior(np.zeros(LENS_SIZE), information, 0.0, sizes, np.flatnonzero(active))


@functools.lru_cache(maxsize=64)
def usual_prior(options: EstimateOptions, corner_px: float, center_known: bool) -> ViewPrior:
    """Return the priors on the lens of an unknown camera; read-only, for all its views."""
    mean, sigma = np.zeros(LENS_SIZE), np.ones(LENS_SIZE)
    mean[LOG_FOCAL] = math.log(typical_focal_px(corner_px))
    sigma[LOG_FOCAL] = options.focal_spread
    if options.prior_focal_px is not None and options.prior_focal_sigma_px is not None:
        mean[LOG_FOCAL] = math.log(options.prior_focal_px)
        sigma[LOG_FOCAL] = options.prior_focal_sigma_px / options.prior_focal_px
    center_known = center_known or options.center_spread == 0.0
    if not center_known:
        sigma[CX] = sigma[CY] = options.center_spread * 2.0 * corner_px
    if options.aspect_spread > 0.0:
        sigma[ASPECT] = options.aspect_spread
    sizes = _sizes_of(options)
    sizes[SHEAR] = 0.0  # which would cost an unknown camera half of its accuracy
    active = np.ones(PARAMETERS, dtype=bool)
    active[POSE_COLUMNS + CX : POSE_COLUMNS + CY + 1] = not center_known
    active[POSE_COLUMNS + BEND + 1 : POSE_COLUMNS + BEND + 3] = options.lens_spread > 0.0
    active[POSE_COLUMNS + BEND + 3 : POSE_COLUMNS + P2 + 1] = False
    active[POSE_COLUMNS + ASPECT] = options.aspect_spread > 0.0
    active[POSE_COLUMNS + LENS_SIZE :] = sizes > 0.0
    usual = options.lens_spread or 1.0
    return ViewPrior(mean, np.diag(sigma**-2.0), usual, sizes, np.flatnonzero(active))


def _sizes_of(options: EstimateOptions) -> Array:
    sizes = np.zeros(DEVIATIONS)
    sizes[SHEAR] = options.image_shear
    sizes[STRETCH : STRETCH + 2] = options.board_stretch
    sizes[BOW_XX:] = options.board_bow
    return sizes


def with_prior_on_k(
    given: ViewPrior, options: EstimateOptions, focal_px: float, corner_px: float
) -> ViewPrior:
    """Add the caller's prior on k = b₁ (f/R)², linear about a focal length."""
    unit, sigma = (focal_px / corner_px) ** 2, options.prior_k_sigma
    assert sigma is not None
    mean, information = given.mean.copy(), given.information.copy()
    # dk = unit db₁ + 2 k d(log f); the mean has the given k at its own focal length.
    by = np.zeros(LENS_SIZE)
    by[LOG_FOCAL], by[BEND] = 2.0 * options.prior_k, unit
    information[_BENDS_AT, _BENDS_AT] = np.diag([0.0, *np.power(BEND_SPREADS[1:], -2.0)])
    information += np.outer(by, by) / sigma**2
    mean[BEND] = options.prior_k * (1.0 + 2.0 * (math.log(focal_px) - mean[LOG_FOCAL])) / unit
    return given._replace(mean=mean, information=information, usual=0.0)


def with_free_aspect(information: Array) -> Array:
    """Return a prior's information (10, 10) with that of any aspect ratio."""
    free = information.copy()
    free[ASPECT, ASPECT] = FREE_ASPECT_SPREAD**-2.0
    return free
