# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Gaussian priors on the lens: a typical camera, the caller's priors, or an earlier calibration.

A prior is a mean and an information matrix (inverse covariance). It determines the parameters that
the data do not; a handful of views outweighs it. Views that are no longer fitted are marginalised:
their information about the lens is added to the prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from .lens import CX, CY, FOCAL, K, K2, K3, lens_from_camera, LENS_SIZE
from ..cameras.division import DivisionCamera
from ..geometry import Array
from ..linalg import inverse_of_information

# A typical camera has a field of view of 60° along the diagonal, and no distortion. These are the
# standard deviations of real cameras from it.
TYPICAL_HALF_FOV_RAD = math.radians(30.0)
FOCAL_SIGMA = 0.5  # relative
BEND_SIGMA = 0.3  # of k |d|² at the image's corner; likewise k2 |d|⁴ and k3 |d|⁶

# Marginalised views count as at most this many; older ones fade, since a lens may change slowly,
# with temperature for example.
_MOST_MARGINALISED = 2000.0

# Smallest eigenvalue, with ones on the diagonal, of a matrix that counts as positive definite.
_CLEARLY_POSITIVE = 1e-9


def typical_focal_px(corner_px: float) -> float:
    """Return the focal length of a typical camera; corner_px: from the centre to the corner."""
    return corner_px / math.tan(TYPICAL_HALF_FOV_RAD)


class WeightedPrior(NamedTuple):
    """A prior for kernels: mean (6,), information (6, 6) times the noise variance, px²."""

    mean: Array
    information: Array


@dataclass(frozen=True, slots=True, eq=False)
class LensPrior:
    """
    A Gaussian prior on the lens: mean (6,) and information (6, 6).

    marginalised (6, 6) is the part of the information from views that are no longer fitted; views
    is the number of views in the prior.
    """

    mean: Array
    information: Array
    marginalised: Array
    views: int

    @classmethod
    def without_views(cls, mean: Array, information: Array, views: int = 0) -> LensPrior:
        """Return a prior without marginalised views; views: those of an earlier calibration."""
        return cls(mean, information, np.zeros((LENS_SIZE, LENS_SIZE)), views)

    def marginalise(
        self, information: Array, gradient: Array, lens: Array, variance: float
    ) -> LensPrior:
        """
        Return the prior with the information (6, 6) and negative gradient (6,) of a view added.

        Both are in px², at the given lens (6,); variance: of the noise, px².
        """
        # The view adds dᵀ S d - 2 gᵀ d to the cost, d the step from the lens. The sum of two
        # quadratic functions has its minimum where their gradients cancel.
        faded = self.marginalised / _MOST_MARGINALISED
        total = self.information - faded + information / variance
        if not _is_positive(total):  # rounding, in a view without information
            return self
        gradients = (information @ (lens - self.mean) + gradient) / variance
        return replace(
            self,
            mean=self.mean + inverse_of_information(total) @ gradients,
            information=total,
            marginalised=self.marginalised - faded + information / variance,
            views=self.views + 1,
        )


def typical_camera(
    image_size: tuple[int, int],
    center_sigma: float,
    focal: tuple[float, float] | None,
    k: tuple[float, float | None],
) -> LensPrior:
    """
    Return the prior of a typical camera; the caller's own priors replace its entries.

    Parameters
    ----------
    image_size
        (width, height), px.
    center_sigma
        Standard deviation of the centre from the middle of the image, as a share of the diagonal.
    focal
        The caller's mean and standard deviation of the focal length, px; None: not given.
    k
        The caller's mean of k, and its standard deviation (None: not given).

    """
    diagonal_px = math.hypot(*image_size)
    corner_px = 0.5 * diagonal_px
    focal_px, focal_sigma_px = focal or (0.0, 0.0)
    if focal is None:
        focal_px = typical_focal_px(corner_px)
        focal_sigma_px = FOCAL_SIGMA * focal_px
    corner2 = (corner_px / focal_px) ** 2
    mean, sigma = np.zeros(LENS_SIZE), np.empty(LENS_SIZE)
    mean[FOCAL], mean[K] = focal_px, k[0]
    sigma[FOCAL] = focal_sigma_px
    sigma[CX] = sigma[CY] = center_sigma * diagonal_px
    sigma[K] = k[1] or BEND_SIGMA / corner2
    sigma[K2], sigma[K3] = BEND_SIGMA / corner2**2, BEND_SIGMA / corner2**3
    return LensPrior.without_views(mean, np.diag(sigma**-2.0))


def calibrated_camera(
    camera: DivisionCamera,
    covariance: Array,
    views: int,
    middle_px: tuple[float, float],
    typical: LensPrior,
) -> LensPrior:
    """Return an earlier calibration as a prior; its fixed terms get that of a typical camera."""
    free = np.diag(covariance) > 0.0
    information = typical.information.copy()
    information[np.ix_(free, free)] = inverse_of_information(covariance[np.ix_(free, free)])
    mean = np.where(free, lens_from_camera(camera, middle_px), typical.mean)
    return LensPrior.without_views(mean, information, views)


def _is_positive(information: Array) -> bool:
    """Return whether a matrix of mixed units is clearly positive definite."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    if not (size > 0.0).all():
        return False
    scaled = information / np.outer(size, size)
    return bool(np.linalg.eigvalsh(scaled)[0] > _CLEARLY_POSITIVE)
