# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A new view and the camera of the others: the fit of all together, where they agree."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .candidate import disagrees, Sighting
from .fit_views import fit_views
from .founding import best_of, cameras_of, found
from .joint_fit import JointFit
from .lens_order import asks_for_next_term, MAX_ORDER, needs_last_term
from .selection import least_telling
from ..model.prior import Knowledge

# With fewer coordinates to spare, another term would explain away any disagreement.
_ENOUGH_FOR_A_TERM = 60

# So few views may have led to a wrong optimum: a new one is asked for its own.
_FEW_VIEWS = 5


class Joined(NamedTuple):
    """A fit with the new view, and what is known besides: of a view that went for it, too."""

    fit: JointFit
    knowledge: Knowledge


def with_view(sighting: Sighting, knowledge: Knowledge, max_views: int) -> Joined | None:
    """
    Fit the views and a new one, which is the last then.

    At most max_views: where there is no more room, one is left out, and remembered. None where
    the new one does not agree with the others, or is the one to leave out.
    """
    fit = sighting.fit
    if len(fit.views) >= max_views:
        drop = None if sighting.by_fit is None else least_telling(fit, sighting.by_fit.told)
        if drop is None:
            return None
        told, pull = fit.told[drop], fit.pulls[drop]
        knowledge = knowledge.remembering(told, pull, fit.lens, fit.variance)
        fit = fit.without(drop)
    trials = _joined(sighting, fit, knowledge)
    if len(fit.views) < _FEW_VIEWS and sighting.alone_row is not None:
        rows = [*fit.poses, sighting.alone_row]
        views, cameras = (*fit.views, sighting.view), cameras_of([sighting.alone])
        anew = found(views, rows, cameras, knowledge, sighting.robust)
        trials += [trial for trial in anew if _agree(trial, fit, sighting)]
    if not trials:
        return None
    return Joined(settled(best_of(trials), knowledge, sighting.robust.sigma_px), knowledge)


def explained_anew(sightings: Sequence[Sighting], knowledge: Knowledge) -> JointFit:
    """Fit views that all disagreed with a camera of before; each has an estimate of its own."""
    robust = sightings[0].robust
    views = [sighting.view for sighting in sightings]
    rows = [sighting.row for sighting in sightings]
    cameras = cameras_of(sighting.alone for sighting in sightings)
    best = best_of(found(views, rows, cameras, knowledge, robust))
    return settled(best, knowledge, robust.sigma_px)


def settled(fit: JointFit, knowledge: Knowledge, sigma_px: float | None) -> JointFit:
    """Give the lens the number of terms that the data ask for."""
    if not needs_last_term(fit):
        return fit_views(fit.views, fit.poses, fit.lens, fit.order - 1, knowledge, sigma_px)
    while fit.spare >= _ENOUGH_FOR_A_TERM and asks_for_next_term(fit):
        fit = fit_views(fit.views, fit.poses, fit.lens, fit.order + 1, knowledge, sigma_px)
    return fit


def _joined(sighting: Sighting, fit: JointFit, knowledge: Knowledge) -> list[JointFit]:
    """Fit all from where the others are; where they disagree, a wide lens's next term may help."""
    sigma_px = sighting.robust.sigma_px
    views, poses = (*fit.views, sighting.view), np.vstack([fit.poses, sighting.row])
    for order in range(fit.order, MAX_ORDER + 1):
        trial = fit_views(views, poses, fit.lens, order, knowledge, sigma_px)
        if _agree(trial, fit, sighting):
            return [trial]
        if trial.spare < _ENOUGH_FOR_A_TERM:
            break
    return []


def _agree(trial: JointFit, fit: JointFit, sighting: Sighting) -> bool:
    """Say whether a view and the others share a camera: together they cost little more."""
    if sighting.agrees:
        return True
    excess = trial.cost_within(fit.limit) - fit.cost - sighting.own_cost
    return not disagrees(excess, len(sighting.view), fit)
