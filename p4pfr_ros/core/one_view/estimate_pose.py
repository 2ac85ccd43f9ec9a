# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``estimate_pose``: one view of a board, some points wrong, to a pose and how sure it is."""

from __future__ import annotations

from numpy.typing import ArrayLike

from .answer import Answering, no_estimate
from .camera import DivisionCamera
from .estimate import PoseEstimate, RansacOptions, Stop
from .estimation import Estimation
from .prepare import prepare

_DEFAULTS = RansacOptions()


def estimate_pose(
    image_points: ArrayLike,
    board_points: ArrayLike,
    *,
    image_size: tuple[int, int] | None = None,
    center_px: tuple[float, float] | None = None,
    camera: DivisionCamera | None = None,
    options: RansacOptions | None = None,
) -> PoseEstimate:
    """
    Estimate pose, focal length and distortion from one view of a plane.

    Parameters
    ----------
    image_points : (N, 2) array, N ≥ 4
        Raw pixels; pixel centres are integers.
    board_points : (N, 2) array
        The same points on the board's plane Z = 0, metres (or any unit; translation shares it).
    image_size
        (width, height), px: gives the default centre, and what the field of view is of.
    center_px
        Principal point and distortion centre; by default the middle of the image.
    camera
        The camera where it is known: pose only; the other two are then not needed.
    options
        How to search.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or nothing that says where the centre is.

    """
    view = prepare(image_points, board_points, image_size, center_px, camera)
    if view.collinear:
        return no_estimate(Stop.COLLINEAR, len(view.image), 0)
    return Estimation(Answering(view, camera, options or _DEFAULTS)).run()
