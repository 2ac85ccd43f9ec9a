# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which terms a lens needs: they are freed when the data ask, and given up by the same test.

The candidates are the next term of the polynomial, and what an ideal camera does not have: aspect
ratio fy / fx and decentring, together. A test of the present fit, without another one, says
whether the data ask for one. Once a camera is not ideal, all terms of the polynomial are
estimated: no real lens has exactly so many, and the priors hold those that the data do not tell.

This module stands alone because it is one statistical decision; the fits are ``joint_fit``'s.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .joint_fit import fit_views, JointFit, Start
from ..geometry import Array, Ints
from ..linalg import inverse_of_information
from ..model.lens import K
from ..model.prior import CommonPrior, FreeTerms, IMPERFECTIONS, MAX_ORDER

# χ² above which terms are freed, and below which they are fixed again, by the number of their
# parameters: as rare as four and two and a half standard deviations, since the test is repeated at
# each view.
_FREED = {1: 16.0, 3: 22.1}
_FIXED = {1: 6.25, 3: 11.1}

# With fewer degrees of freedom, another term would explain any disagreement.
ENOUGH_FOR_A_TERM = 60

# A rim that the terms do not reach: so large a share of the points beyond this share of the seen
# radius are outliers, and this many times as many as elsewhere. Another term is tried, and stays
# if it explains them: the truncated χ² falls by this much.
_RIM, _RIM_OUTLIERS, _RIM_RATIO = 0.8, 0.1, 3.0
_RIM_CHI2 = 100.0


def with_lens_terms(fit: JointFit, prior: CommonPrior, sigma_px: float | None) -> JointFit:
    """Fit again with the terms that the data ask for, as long as they ask for others."""
    tried = {fit.terms}
    if fit.terms.imperfect and fit.terms.order < MAX_ORDER and fit.dof >= ENOUGH_FOR_A_TERM:
        fit = _refitted(fit, FreeTerms(MAX_ORDER, imperfect=True), prior, sigma_px)
    fewer = _without_needless(fit)
    if fewer != fit.terms:
        fit = _refitted(fit, fewer, prior, sigma_px)
    while fit.dof >= ENOUGH_FOR_A_TERM:
        more = _asked_for(fit)
        if more is None:
            wider = _reaching_the_rim(fit, prior, sigma_px)
            if wider is None:
                break
            fit = wider
            continue
        fit = _refitted(fit, more, prior, sigma_px)
        if more in tried:  # given up a moment ago
            break
        tried.add(more)
    return fit


def _refitted(
    fit: JointFit, terms: FreeTerms, prior: CommonPrior, sigma_px: float | None
) -> JointFit:
    start = Start(fit.poses, fit.common, fit.boards, fit.limit)
    return fit_views(fit.views, start, terms, prior, sigma_px)


def _asked_for(fit: JointFit) -> FreeTerms | None:
    """
    Return the terms with what the data ask for most; None if they ask for nothing.

    Rao's score test: if the true value of fixed terms is zero, their gradient after elimination of
    the free parameters is normal with the covariance of its information. Its square over that is
    χ², with as many degrees of freedom as terms.
    """
    best, most = None, 1.0
    for terms, columns in _one_more(fit.terms):
        asked = _score(fit, columns) / _FREED[len(columns)]
        if asked > most:
            best, most = terms, asked
    return best


def _one_more(terms: FreeTerms) -> Iterator[tuple[FreeTerms, Ints]]:
    """Yield the terms with one more kind of them, and the columns that these add."""
    if terms.imperfect:  # with all terms of the polynomial
        return
    if terms.order < MAX_ORDER:
        yield terms._replace(order=terms.order + 1), np.array([K + terms.order])
    yield FreeTerms(MAX_ORDER, imperfect=True), np.array(IMPERFECTIONS)


def _score(fit: JointFit, columns: Ints) -> float:
    """Return χ² of the gradient of fixed parameters."""
    information, by_others = _eliminated(fit, columns, fit.free)
    gradient = fit.equations[:, -1]
    after = gradient[columns] - by_others @ gradient[fit.free]
    return float(after @ inverse_of_information(information) @ after) / fit.variance


def _eliminated(fit: JointFit, columns: Ints, others: Ints) -> tuple[Array, Array]:
    """
    Return the information about parameters (n, n) after others, m, are eliminated.

    Without the prior on these parameters, which is narrow until they are free. Also return the
    matrix (n, m) by which the elimination subtracts the equations of the others.
    """
    total = fit.equations[:, :-1].copy()
    total[columns, columns] -= fit.typical[columns]
    by_others = total[np.ix_(columns, others)] @ inverse_of_information(
        total[np.ix_(others, others)]
    )
    information = total[np.ix_(columns, columns)] - by_others @ total[np.ix_(others, columns)]
    return information, by_others


def _without_needless(fit: JointFit) -> FreeTerms:
    """Return the terms without one that does not differ significantly from zero."""
    terms = fit.terms
    if not terms.imperfect and terms.order > 1 and _is_zero(fit, np.array([K + terms.order - 1])):
        return terms._replace(order=terms.order - 1)
    if terms.imperfect and _is_zero(fit, np.array(IMPERFECTIONS)):
        return terms._replace(imperfect=False)
    return terms


def _is_zero(fit: JointFit, columns: Ints) -> bool:
    """Return whether free parameters are as close to zero as their own variance allows."""
    # The score of the same test before they were freed, for a quadratic cost: with the
    # information of the data after elimination of the others, χ² = θᵀ S θ / σ².
    information, _ = _eliminated(fit, columns, np.setdiff1d(fit.free, columns))
    at = fit.lens[columns]
    return bool(at @ information @ at < _FIXED[len(columns)] * fit.variance)


def _reaching_the_rim(
    fit: JointFit, prior: CommonPrior, sigma_px: float | None
) -> JointFit | None:
    """
    Return a fit with another term that explains a rim of outliers; None if there is none.

    A ring of outliers is a missing term: few points at the rim of a wide lens may be far off while
    all others fit, and the gate cuts them off.
    """
    if fit.terms.order == MAX_ORDER or not _rim_is_off(fit):
        return None
    terms = fit.terms._replace(order=fit.terms.order + 1)
    trial = _refitted(fit, terms, prior, sigma_px)
    gained = fit.cost - trial.cost_within(fit.limit)
    return trial if gained > _RIM_CHI2 * fit.posterior_variance else None


def _rim_is_off(fit: JointFit) -> bool:
    """Return whether outliers are many at the rim of what was seen, and few elsewhere."""
    image = np.concatenate([view.image for view in fit.views])
    radii = np.linalg.norm(image - fit.lens[1:3], axis=1)
    rim, outlier = radii > _RIM * radii.max(), fit.squares >= fit.limit
    at_rim = float(outlier[rim].mean())
    inside = float(outlier[~rim].mean()) if not rim.all() else 0.0
    return at_rim > _RIM_OUTLIERS and at_rim > _RIM_RATIO * inside
