# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The answer to a view that disagrees with the camera: by itself, its centre in doubt too."""

from __future__ import annotations

from dataclasses import replace

from .candidate import Sighting
from .fit_views import fit_views
from .fused_answer import fused_answer
from .view_by_fit import seen_by_fit
from ..model.calibration_view import lens_of
from ..model.lens import CX, CY
from ..model.prior import Knowledge
from ..one_view.results import PoseEstimate


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
