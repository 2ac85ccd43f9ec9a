# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Published results of other minimal solvers, from another machine: compare ratios, not times.

The solvers: Oskarsson's paper (arXiv:1805.10705) and its Matlab code (under Octave, with a wrong
sign fixed), and the planar solver of radialpose (C++ and Eigen, -O3 -march=native).
"""

from __future__ import annotations

from typing import NamedTuple


class Recall(NamedTuple):
    """Recall in percent at 1e-6 and at 1e-3; strings, because some are ranges."""

    limit: str  # the recall that image points rounded to double allow
    radialpose: str
    paper_code: str


_SIDE_ON = Recall('100 / 100', '0 / 0.4', '0 / 0.4')
_SPECIAL = Recall('100 / 100', '0', '0')
_MOVED = Recall('100 / 100', '59 - 98', '60 - 94')
UNPUBLISHED = Recall('', '', '')

RECALL = {
    'patch': Recall('100 / 100', '98.9 / 99.8', '98.9 / 99.8'),
    'square': Recall('99.99 / 100', '95.8 / 99.1', '96.0 / 99.2'),
    'patch, tilt < 3°': Recall('99.84 / 100', '78.6 / 95.9', '79.5 / 96.0'),
    'square, tilt < 3°': Recall('99.98 / 100', '34.6 / 80.8', '37.7 / 82.3'),
    'square about its side': _SIDE_ON,
    'a point with x = 0': _SPECIAL,
    'a point at the centre': _SPECIAL,
    'three collinear points': _SPECIAL,
    'patch, board in mm': _MOVED,
    'patch, board moved by 1000': _MOVED,
}

# Time of one 6x6 np.linalg.eigvals on that machine.
EIGVALS_US = 4.3

# Microseconds per solve; all but the first on the machine of EIGVALS_US.
TIMES_US = {
    'paper, Matlab, its own machine': 300.0,
    "paper's code, Octave": 738.0,
    'Bujnak 2010, P4Pfr': 208.0,
    'Larsson 2017, general P4Pfr': 28.0,
    'radialpose, planar P4Pfr': 4.8,
    'Kukelova 2013, 5 points': 2.2,
}

# Microseconds per solve, patch and square, in one run on a machine of the kind of this one, where
# one 6x6 np.linalg.eigvals took PEERS_EIGVALS_US.
PEERS_EIGVALS_US = 3.81
PEERS_US = {
    'PoseLib 3.0.0, p5pfr (5 points)': (1.44, 1.43),
    'radialpose, planar P4Pfr': (4.92, 4.75),
}

# log10 of the residual in undistorted image coordinates at QUANTILES, 100,000 instances.
QUANTILES = (0.5, 0.9, 0.99, 0.999, 1.0)
RESIDUALS = {
    'paper': (-14.26, -12.24, -9.83, -7.55, -4.2),
    "paper's code, Octave": (-14.24, -12.37, -10.06, -7.81, -4.8),
    'radialpose': (-14.34, -12.45, -10.11, -7.94, -4.0),
    'radialpose, R made a rotation': (-13.02, -9.20, -4.15, 0.56, 5.7),
}
