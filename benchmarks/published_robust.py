# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Published results of other robust estimators, from another machine and other scenes.

200 scenes per cell, drawn by the same rules as ours: 0.5 px noise, tilt 15 to 65°, outliers
uniform in the image.
"""

from __future__ import annotations

from typing import NamedTuple


class Figures(NamedTuple):
    """Success %, median rotation error °, median focal length error %, ms (None: not timed)."""

    success: float
    rotation_deg: float
    focal: float
    milliseconds: float | None = None


IDEAL = 'least squares from ground truth'
RADIALPOSE = 'radialpose LO-MSAC'
POSELIB = 'PoseLib 3.0.0, default'
POSELIB_MORE = 'PoseLib 3.0.0, 100 to 10,000 iterations'

# Keys: number of points, percentage of outliers.
ROBUST = {
    (100, 0): {
        IDEAL: Figures(99.5, 0.068, 0.26),
        RADIALPOSE: Figures(97.5, 0.093, 0.43, 5.1),
        POSELIB: Figures(99.5, 0.075, 0.28, 8.4),
        POSELIB_MORE: Figures(99.5, 0.075, 0.28, 1.5),
    },
    (100, 30): {
        IDEAL: Figures(99.0, 0.097, 0.48),
        RADIALPOSE: Figures(96.0, 0.116, 0.67, 3.7),
        POSELIB: Figures(98.0, 0.097, 0.45, 7.8),
        POSELIB_MORE: Figures(98.0, 0.097, 0.45, 1.6),
    },
    (100, 50): {
        IDEAL: Figures(99.0, 0.100, 0.46),
        RADIALPOSE: Figures(96.0, 0.116, 0.56, 3.9),
        POSELIB: Figures(99.5, 0.109, 0.49, 7.4),
        POSELIB_MORE: Figures(99.5, 0.109, 0.49, 7.2),
    },
    (100, 70): {
        IDEAL: Figures(95.5, 0.111, 0.51),
        RADIALPOSE: Figures(94.0, 0.119, 0.58, 12.2),
        POSELIB: Figures(96.0, 0.118, 0.54, 101.0),
        POSELIB_MORE: Figures(96.0, 0.118, 0.54, 69.0),
    },
    (24, 0): {
        IDEAL: Figures(95.0, 0.152, 0.81),
        RADIALPOSE: Figures(90.5, 0.165, 0.92, 2.6),
        POSELIB: Figures(96.0, 0.163, 0.86, 3.5),
        POSELIB_MORE: Figures(96.0, 0.163, 0.86, 0.53),
    },
    (24, 50): {
        IDEAL: Figures(89.0, 0.247, 1.18),
        RADIALPOSE: Figures(87.0, 0.268, 1.35, 2.2),
        POSELIB: Figures(87.5, 0.250, 1.16, 4.7),
        POSELIB_MORE: Figures(87.5, 0.250, 1.16, 4.6),
    },
    (24, 70): {
        IDEAL: Figures(75.5, 0.392, 1.92),
        RADIALPOSE: Figures(69.0, 0.391, 2.06, 9.1),
        POSELIB: Figures(74.5, 0.399, 1.88, 173.0),
        POSELIB_MORE: Figures(69.5, 0.431, 2.06, 30.0),
    },
}
