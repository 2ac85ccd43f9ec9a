# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters ``robust.*``: the search's options, and what is known of the camera."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from p4pfr_ros import EstimateOptions
from p4pfr_ros.files.yaml_fields import ConfigError

from .declare import parameter

_RANSAC = EstimateOptions()
_UNKNOWN_IS_0 = ('sigma_px', 'prior_focal_px', 'prior_focal_sigma_px', 'prior_k_sigma')


@dataclass(frozen=True, slots=True)
class RobustOptions:
    """The search for the pose among wrong correspondences (RANSAC)."""

    threshold_px: float = parameter(
        _RANSAC.threshold_px,
        'A correspondence is an inlier when its reprojection error is below this, pixels.',
        low=0.01,
        high=1000.0,
    )
    confidence: float = parameter(
        _RANSAC.confidence,
        'Of having drawn one sample without a wrong correspondence when the search stops.',
        low=0.5,
        high=0.999999,
    )
    min_iterations: int = parameter(
        _RANSAC.min_iterations,
        'Samples of four points that are tried at least.',
        low=1,
        high=1_000_000,
    )
    max_iterations: int = parameter(
        _RANSAC.max_iterations,
        'Samples of four points that are tried at most.',
        low=1,
        high=1_000_000,
    )
    min_inliers: int = parameter(
        _RANSAC.min_inliers,
        'Of a board with more than four points: when fewer agree, there is no answer.',
        low=4,
        high=1_000_000,
    )
    min_fov_deg: float = parameter(
        _RANSAC.min_fov_deg,
        'Narrowest field of view that the camera may have, along the diagonal, degrees.',
        low=0.1,
        high=359.0,
    )
    max_fov_deg: float = parameter(
        _RANSAC.max_fov_deg,
        'Widest field of view that the camera may have, along the diagonal, degrees.',
        low=0.2,
        high=359.9,
    )
    max_distortion: float = parameter(
        _RANSAC.max_distortion,
        "Largest distortion that the lens may have: |k| |d|^2 at the picture's corner.",
        low=1e-6,
        high=100.0,
    )
    sigma_px: float = parameter(
        0.0,
        'Standard deviation of a corner, pixels, for the covariance. 0: measured from the '
        'residuals, and 0.5 where four points leave none.',
        low=0.0,
        high=1000.0,
    )
    prior_focal_px: float = parameter(
        0.0,
        'Focal length that the camera is known to have, pixels. 0: not known.',
        low=0.0,
        high=1e6,
    )
    prior_focal_sigma_px: float = parameter(
        0.0,
        'Standard deviation of prior_focal_px, pixels; above 0 where that is known.',
        low=0.0,
        high=1e6,
    )
    prior_k: float = parameter(
        _RANSAC.prior_k,
        'Distortion that the camera is known to have, by the division model.',
        low=-100.0,
        high=100.0,
    )
    prior_k_sigma: float = parameter(
        0.0,
        'Standard deviation of prior_k. 0: the distortion is not known.',
        low=0.0,
        high=100.0,
    )
    seed: int = parameter(
        _RANSAC.seed,
        'Seed of the random samples: same input and seed, same output.',
        low=0,
        high=2**31 - 1,
    )

    def __post_init__(self) -> None:
        try:
            self.ransac()
        except ValueError as error:  # two that do not go together
            raise ConfigError(f'robust.{error}') from None

    def ransac(self) -> EstimateOptions:
        """Return what the solver takes: all of these by the same names, None for unknown."""
        given = asdict(self)
        return EstimateOptions(**given | {name: given[name] or None for name in _UNKNOWN_IS_0})
