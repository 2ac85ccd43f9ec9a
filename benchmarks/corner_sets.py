# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Corners of boards in the photographs of real cameras, from the folder P4PFR_DATA.

FOLDER/corners/NAME.npz contains image_size (2,), view (N,), image_points (N, 2) px and
board_points (N, 2) m. This module stands alone because several benchmarks read these sets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array

NAMES = ('opencv_left', 'gopro_hero', 'gopro_wide', 'fisheye_a_left', 'webcam_stretched')
NO_CORNERS = 'P4PFR_DATA must name a folder with corners of real cameras, corners/*.npz'


@dataclass(frozen=True, slots=True)
class CornerView:
    """One photograph: image_points (N, 2) px, and ids (N,), the rows of the set's board_points."""

    image_points: Array
    ids: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class CornerSet:
    """Photographs of one board by one camera, in file order; board_points (M, 2) m."""

    name: str
    image_size: tuple[int, int]
    board_points: Array
    views: tuple[CornerView, ...]

    def select(self, indices: NDArray[np.intp]) -> CornerSet:
        """Return the set with these views only, in this order."""
        return replace(self, views=tuple(self.views[i] for i in indices))


def read_corner_sets() -> list[CornerSet]:
    """Read the sets that the folder has; none without the folder."""
    if 'P4PFR_DATA' not in os.environ:
        return []
    paths = [Path(os.environ['P4PFR_DATA']) / 'corners' / f'{name}.npz' for name in NAMES]
    return [_read(path) for path in paths if path.is_file()]


def _read(path: Path) -> CornerSet:
    data = np.load(path)
    width, height = data['image_size'].tolist()
    board_points, ids = np.unique(data['board_points'], axis=0, return_inverse=True)
    views = tuple(
        CornerView(data['image_points'][of_view], ids.reshape(-1)[of_view])
        for of_view in (data['view'] == view for view in np.unique(data['view']))
    )
    return CornerSet(path.stem, (width, height), board_points, views)
