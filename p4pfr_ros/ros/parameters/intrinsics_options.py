# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters ``intrinsics.*``: where the camera comes from."""

from __future__ import annotations

from dataclasses import dataclass

from p4pfr_ros.files.yaml_fields import ConfigError

from .declare import parameter

SELF_CALIBRATE, PER_FRAME, FIXED, CAMERA_INFO = MODES = (
    'self_calibrate',
    'per_frame',
    'fixed',
    'camera_info',
)

_SMALLEST_FOCAL_PX = 1e-3


@dataclass(frozen=True, slots=True)
class IntrinsicsOptions:
    """Focal length, distortion and optical centre: found, or given."""

    mode: str = parameter(
        SELF_CALIBRATE,
        'Where the camera comes from. self_calibrate: found from all views together, ever better; '
        'per_frame: found from each view by itself; fixed: the parameters beside this one, or '
        'where focal_px is 0 the calibration that was loaded or found; camera_info: a calibrated '
        'CameraInfo on that topic.',
        choices=MODES,
    )
    focal_px: float = parameter(
        0.0,
        'Mode fixed: focal length at the optical centre, pixels. 0: not given.',
        low=0.0,
        high=1e6,
    )
    k: float = parameter(
        0.0,
        'Mode fixed: distortion by the division model, dimensionless; negative is barrel.',
        low=-100.0,
        high=100.0,
    )
    k2: float = parameter(
        0.0, 'Mode fixed: its second coefficient, of wide lenses.', low=-100.0, high=100.0
    )
    k3: float = parameter(
        0.0, 'Mode fixed: its third coefficient, of wide lenses.', low=-100.0, high=100.0
    )

    def __post_init__(self) -> None:
        if 0.0 < self.focal_px < _SMALLEST_FOCAL_PX:
            raise ConfigError(
                f'intrinsics.focal_px: expected at least {_SMALLEST_FOCAL_PX:g} px, or 0 for not '
                f'given, got {self.focal_px:g}'
            )
