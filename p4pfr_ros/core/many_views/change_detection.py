# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether the camera has changed: what its latest views say, taken together."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from .candidate import Sighting
from .joint_fit import JointFit
from .scatter import scatter_of
from ..geometry import Array
from ..model.lens import K
from ..model.prior import inverse_of, Knowledge

# The latest views that told something of the camera.
_MEMORY = 10

# Views of which each agrees may lean to one side together, after a turn of the focus ring: beyond
# this χ² of the lens's four to six parameters it is no chance. Asked of so many views at least.
_BEYOND_CHANCE = 40.0
_ENOUGH_VIEWS = 3


class Changes:
    """Remembers the latest views that told something, and whether they agreed."""

    def __init__(self, outliers_to_restart: int) -> None:
        self._enough = outliers_to_restart
        self._latest: deque[tuple[Sighting, bool]] = deque(maxlen=_MEMORY)

    def clear(self) -> None:
        """Forget all."""
        self._latest.clear()

    def note(self, sighting: Sighting, agrees: bool) -> None:
        """Remember a view."""
        self._latest.append((sighting, agrees))

    @property
    def any_disagreed(self) -> bool:
        """Whether any of the latest views disagreed."""
        return any(not agrees for _, agrees in self._latest)

    def forget_an_outlier(self) -> None:
        """Take the oldest view that disagreed for no more than that."""
        outliers = [i for i, (_, agrees) in enumerate(self._latest) if not agrees]
        if outliers:
            del self._latest[outliers[0]]

    @property
    def unanimous(self) -> bool:
        """Whether all of the latest views disagreed."""
        return len(self._latest) == _MEMORY and not any(agrees for _, agrees in self._latest)

    def witnesses(self, fit: JointFit, common: Knowledge) -> Sequence[Sighting]:
        """Return the views, the latest last, that say that the camera has changed; if it has."""
        agreed = [sighting for sighting, agrees in self._latest if agrees]
        disagreed = [sighting for sighting, agrees in self._latest if not agrees]
        evidence = len(disagreed) / self._enough
        if evidence >= 1.0:
            return disagreed
        if len(agreed) >= _ENOUGH_VIEWS:
            enough = (1.0 - evidence) * _BEYOND_CHANCE
            evidence += _lean(agreed, fit, common, enough) / _BEYOND_CHANCE
        return [sighting for sighting, _ in self._latest] if evidence >= 1.0 else ()


def _lean(sightings: Sequence[Sighting], fit: JointFit, common: Knowledge, enough: float) -> float:
    """
    Return χ² of the difference between the camera of some views and that of a fit.

    Where it is less than enough, it may be less still. Each view's equations are those by the fit
    of before it came, so that it is not among what it is compared with.
    """
    free = slice(K + fit.order)
    prior = fit.variance * common.information[free, free]
    seen = [sighting.by_fit for sighting in sightings if sighting.by_fit]
    told = np.array([s.told[free, free] for s in seen])
    pulls = np.array([s.pull[free] for s in seen])
    total = told.sum(axis=0) + prior
    shift = np.linalg.solve(total, pulls.sum(axis=0))
    inverse, of_fit = fit.variance * inverse_of(total), fit.covariance[free, free]
    at_most = _chi2(shift, fit.scatter * inverse + of_fit)
    if at_most < enough:
        return at_most
    # What is left when the shift is made is the scatter of these views, which may be larger.
    left = pulls - told @ shift
    scatter = max(fit.scatter, scatter_of(told, left, prior, total, fit.variance))
    return _chi2(shift, scatter * inverse + of_fit)


def _chi2(shift: Array, covariance: Array) -> float:
    return float(shift @ np.linalg.solve(covariance, shift))
