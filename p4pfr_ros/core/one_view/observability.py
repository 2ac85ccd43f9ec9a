# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What one view cannot tell at all, and a covariance that does not pretend otherwise."""

from __future__ import annotations

from dataclasses import dataclass, fields
import math

import numpy as np

from ..geometry import Array

# A quantity counts as observable while its standard deviation is below: a share of itself for
# focal length and distance, radians for the direction of the board, and for the distortion the
# change of k |d|² at the image's corner.
_MAX_SHARE = 0.3
_MAX_DIRECTION_RAD = 0.3
_MAX_BEND = 0.3


@dataclass(frozen=True, slots=True)
class Observability:
    """
    Which quantities a view determines.

    direction: the board's orientation; distance: its translation along the line of sight;
    focal: the focal length; distortion: k.
    """

    direction: bool = False
    distance: bool = False
    focal: bool = False
    distortion: bool = False

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Return the names of those that it does not determine."""
        return tuple(f.name for f in fields(self) if not getattr(self, f.name))


def observability_of(
    focal_px: float, translation: Array, covariance: Array, corner_px: float
) -> Observability:
    """
    Judge by the standard deviations.

    translation is the board's (its unit), corner_px the distance of the image's farthest corner
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
    bend = math.sqrt(max(c[7][7], 0.0)) * (corner_px / focal_px) ** 2
    return Observability(
        direction=c[3][3] + c[4][4] + c[5][5] < _MAX_DIRECTION_RAD**2,
        # Its variance is along / distance².
        distance=along < (_MAX_SHARE * distance2) ** 2,
        focal=c[6][6] < (_MAX_SHARE * focal_px) ** 2,
        distortion=bend < _MAX_BEND,
    )


def without_the_undetermined(covariance: Array, seen: Observability) -> Array:
    """Give what is not determined an infinite variance, and no correlation (NaN)."""
    if all((seen.direction, seen.distance, seen.focal, seen.distortion)):
        return covariance
    known = np.repeat([seen.distance, seen.direction, seen.focal, seen.distortion], [3, 3, 1, 1])
    honest: Array = np.where(np.outer(known, known), covariance, np.nan)
    honest[np.diag_indices(8)] = np.where(known, np.diag(covariance), np.inf)
    return honest
