# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detects from the latest views together that the camera has changed (zoom, focus).

This module stands alone because it is one statistical test, independent of the steps by which
``SelfCalibration`` handles a view.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from .candidate import Candidate
from .joint_fit import JointFit, scatter_of
from ..geometry import Array
from ..linalg import inverse_of_information
from ..model.lens import FOCAL
from ..model.prior import TypicalCamera

# Number of latest informative views.
_MEMORY = 10

# Views that agree individually may deviate together, after a turn of the focus ring: a χ² of the
# lens's free parameters beyond this is a change. Tested with at least this many views.
_LARGEST_CHI2 = 40.0
_ENOUGH_VIEWS = 3


class ChangeDetector:
    """Holds the latest informative views, and whether they agreed with the camera."""

    def __init__(self, outliers_to_restart: int) -> None:
        self._to_restart = outliers_to_restart
        self._latest: deque[tuple[Candidate, bool]] = deque(maxlen=_MEMORY)

    def clear(self) -> None:
        """Drop all views."""
        self._latest.clear()

    def add(self, candidate: Candidate, agrees: bool) -> None:
        """Add a view."""
        self._latest.append((candidate, agrees))

    @property
    def any_disagreed(self) -> bool:
        """Whether any of the latest views disagreed."""
        return any(not agrees for _, agrees in self._latest)

    def drop_outlier(self) -> None:
        """Drop the oldest view that disagreed: a single outlier, not a change."""
        outliers = [i for i, (_, agrees) in enumerate(self._latest) if not agrees]
        if outliers:
            del self._latest[outliers[0]]

    def evidence(self, fit: JointFit, typical: TypicalCamera) -> Sequence[Candidate]:
        """Return the views of the changed camera, the latest last; empty if it has not changed."""
        agreed = [candidate for candidate, agrees in self._latest if agrees]
        disagreed = [candidate for candidate, agrees in self._latest if not agrees]
        # Disagreeing views and the common deviation of the others add up; 1 is a change.
        evidence = len(disagreed) / self._to_restart
        if evidence >= 1.0:
            return disagreed
        if len(agreed) >= _ENOUGH_VIEWS:
            enough = (1.0 - evidence) * _LARGEST_CHI2
            evidence += _common_deviation(agreed, fit, typical, enough) / _LARGEST_CHI2
        return [candidate for candidate, _ in self._latest] if evidence >= 1.0 else ()


def _common_deviation(
    candidates: Sequence[Candidate], fit: JointFit, typical: TypicalCamera, enough: float
) -> float:
    """
    Return χ² of the difference between the camera of some views and that of a fit.

    A value below ``enough`` is an upper bound. Each view is evaluated with the fit before it was
    added, so that it is not compared with itself.
    """
    free = fit.terms.columns
    prior = np.diag(fit.variance * typical.information(fit.lens[FOCAL], fit.terms)[free])
    evaluated = [candidate.evaluated for candidate in candidates if candidate.evaluated]
    information = np.array([view.information[np.ix_(free, free)] for view in evaluated])
    gradients = np.array([view.gradient[free] for view in evaluated])
    total = information.sum(axis=0) + prior
    shift = np.linalg.solve(total, gradients.sum(axis=0))
    inverse = fit.variance * inverse_of_information(total)
    of_fit = fit.covariance[np.ix_(free, free)]
    upper_bound = _chi2(shift, fit.measured_scatter * inverse + of_fit)
    if upper_bound < enough:
        return upper_bound
    # The scatter of these views, from the gradients that remain after the shift, may be larger.
    remaining = gradients - information @ shift
    scatter = max(
        fit.measured_scatter, scatter_of(information, remaining, prior, total, fit.variance)
    )
    return _chi2(shift, scatter * inverse + of_fit)


def _chi2(shift: Array, covariance: Array) -> float:
    return float(shift @ np.linalg.solve(covariance, shift))
