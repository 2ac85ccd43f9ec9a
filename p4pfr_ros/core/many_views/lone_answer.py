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

"""The answer to a view that disagrees with the camera: by itself, its centre in doubt too."""

from __future__ import annotations

from dataclasses import replace

from .calibration_view import lens_of
from .estimate import PoseEstimate
from .fit_views import fit_views
from .fused_answer import fused_answer
from .information import Knowledge
from .lens import CX, CY
from .seen_by_fit import seen_by_fit
from .sighting import Sighting


def lone_answer(sighting: Sighting, common: Knowledge) -> PoseEstimate:
    """
    Answer by the view and what lenses are like; where its optical centre is, only roughly.

    Four points leave nothing to estimate a centre from, and are answered as they are.
    """
    alone, row, view = sighting.alone, sighting.alone_row, sighting.view
    if alone.model is None or row is None or len(view) == 4:
        return alone
    middle_px = view.scaled.center_px
    mean = common.mean.copy()
    mean[CX : CY + 1] = lens_of(sighting.camera, middle_px)[CX : CY + 1]
    knowledge, lens = replace(common, mean=mean), lens_of(alone.model.camera, middle_px)
    fit = fit_views([view], row[None], lens, 1, knowledge, sighting.robust.sigma_px)
    seen = seen_by_fit(view, fit.poses[0], fit)
    return fused_answer(seen, alone, sighting.robust.threshold_px)
