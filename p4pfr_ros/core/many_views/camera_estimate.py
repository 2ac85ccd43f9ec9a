# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``CameraEstimate``: a self-calibrated camera, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from ..cameras.division import DivisionCamera
from ..geometry import Array, as_points

# Of the variances: how far rounding may take a covariance from symmetry and from positive.
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class CameraEstimate:
    """
    A camera fused from many views.

    Parameters
    ----------
    camera
        The camera.
    covariance : (6, 6) array
        Of focal_px, the centre's x and y (px), k, k2 and k3, in this order. Rows and columns of
        what was not estimated are zero.
    rms_px
        Root of the mean squared distance between the views' inliers and their reprojections.
    views
        How many views it is made of.

    Raises
    ------
    ValueError
        The covariance is none, rms_px is negative or not finite, or there is no view.

    """

    camera: DivisionCamera
    covariance: Array
    rms_px: float
    views: int

    def __post_init__(self) -> None:
        covariance = as_points(self.covariance, 'covariance', (6, 6))
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        # In units of the standard deviations, as px² and k² are of very different sizes.
        unit = covariance / np.outer(*(2 * [np.where(sigma > 0.0, sigma, 1.0)]))
        symmetric = np.abs(unit - unit.T).max() <= _ROUNDING
        if not (symmetric and np.linalg.eigvalsh(unit)[0] >= -_ROUNDING):
            raise ValueError(f'covariance must be symmetric and ≥ 0, got {covariance.tolist()}')
        if not 0.0 <= self.rms_px < math.inf:
            raise ValueError(f'rms_px must be finite and ≥ 0, got {self.rms_px}')
        if self.views < 1:
            raise ValueError(f'views must be at least 1, got {self.views}')
        object.__setattr__(self, 'covariance', covariance)

    @property
    def focal_sigma_px(self) -> float:
        """The standard deviation of the focal length, px."""
        return self._sigma(0)

    @property
    def center_sigma_px(self) -> Array:
        """The standard deviations (2,) of the centre's x and y, px; 0 where it was not freed."""
        return np.array([self._sigma(1), self._sigma(2)])

    @property
    def k_sigma(self) -> float:
        """The standard deviation of k."""
        return self._sigma(3)

    def _sigma(self, index: int) -> float:
        return math.sqrt(max(0.0, float(self.covariance[index, index])))
