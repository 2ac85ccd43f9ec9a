# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters ``calibration.*``: when a self-calibrated camera is good, and when it changed."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from p4pfr_ros import CalibrationOptions
from p4pfr_ros.files.yaml_fields import ConfigError

from .declare import parameter

_DEFAULTS = CalibrationOptions()


@dataclass(frozen=True, slots=True)
class SelfCalibrationOptions:
    """Mode self_calibrate: which views are kept, and what is made of them."""

    max_views: int = parameter(
        _DEFAULTS.max_views,
        'At most so many views are kept: those that tell most of the camera together.',
        low=2,
        high=1000,
    )
    min_views: int = parameter(
        _DEFAULTS.min_views,
        'With fewer views the camera never counts as calibrated.',
        low=2,
        high=1000,
    )
    focal_tolerance: float = parameter(
        _DEFAULTS.focal_tolerance,
        'Calibrated below this standard deviation of the focal length, as a share of it.',
        low=1e-6,
        high=0.5,
    )
    center_tolerance: float = parameter(
        _DEFAULTS.center_tolerance,
        'Calibrated below this standard deviation of the optical centre, as a share of the '
        "picture's diagonal.",
        low=1e-6,
        high=0.5,
    )
    bend_tolerance: float = parameter(
        _DEFAULTS.bend_tolerance,
        "Calibrated below this standard deviation of the distortion at the picture's corner, "
        'k |d|^2.',
        low=1e-6,
        high=0.5,
    )
    center_spread: float = parameter(
        _DEFAULTS.center_spread,
        'How far optical centres are from the middle of the picture: a standard deviation, as a '
        'share of the diagonal.',
        low=1e-6,
        high=0.5,
    )
    new_view: float = parameter(
        _DEFAULTS.new_view,
        'A view is new when its points lie so far from where any kept view has them, as a share '
        "of the picture's diagonal.",
        low=1e-6,
        high=1.0,
    )
    outliers_to_restart: int = parameter(
        _DEFAULTS.outliers_to_restart,
        'Of the last ten views that told something of the camera, so many that disagree mean '
        'that it has changed.',
        low=2,
        high=10,
    )

    def __post_init__(self) -> None:
        try:
            self.core()
        except ValueError as error:  # two that do not go together
            raise ConfigError(f'calibration.{error}') from None

    def core(self) -> CalibrationOptions:
        """Return what ``SelfCalibration`` takes: all of these by the same names."""
        return CalibrationOptions(**asdict(self))
