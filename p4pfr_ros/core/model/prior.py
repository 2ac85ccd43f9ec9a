# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Gaussian priors on what views have in common: a typical camera, typical boards, earlier views.

The typical ones determine what the data do not; a handful of views outweighs them. Views that are
no longer fitted are marginalised: their information about lens and boards is added.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from .board_shape import BoardShape, SHAPE_SIGMAS, SHAPE_SIZE
from .lens import ASPECT, CX, CY, FOCAL, K, LENS_SIZE, P1, P2
from ..geometry import Array, Ints
from ..linalg import inverse_of_information

# A typical camera has a field of view of 60° along the diagonal, and no distortion. These are the
# standard deviations of real cameras from it.
TYPICAL_HALF_FOV_RAD = math.radians(30.0)
FOCAL_SIGMA = 0.5  # relative
BEND_SIGMA = 0.3  # of k |d|² at the image's corner

# Standard deviations of k to k4 of real lenses (an equidistant one has about -1/3, -1/45, -2/945
# and -1/4725), and of their bends kᵢ |d|²ⁱ at the image's corner, for lenses so long that the
# first would allow hardly any.
TERM_SPREADS = (0.4, 0.03, 0.003, 0.0005)
BEND_SPREADS = (0.2, 0.1, 0.02, 0.01)

# Standard deviations of fy / fx - 1 and of p1 and p2, before the data ask for them and after.
_ASPECT_SPREAD, FREE_ASPECT_SPREAD = 0.003, 0.3
_DECENTRING_SPREAD, _FREE_DECENTRING_SPREAD = 0.001, 0.05

# Marginalised views count as at most this many; older ones fade, since a lens may change slowly,
# with temperature for example.
_MOST_MARGINALISED = 2000.0

# Most terms of the polynomial.
MAX_ORDER = 4

# Degrees of freedom and scatter (chi-square per degree of freedom of the views' lenses) that are
# added to those measured, since few views do not measure it: of real boards, and of an earlier
# calibration.
USUAL_SCATTER = 10.0, 5.0
_EARLIER_FREEDOM = 40.0

# What an ideal lens and sensor do not have.
IMPERFECTIONS = [ASPECT, P1, P2]


class FreeTerms(NamedTuple):
    """
    Which parameters of the lens are estimated, beside focal length and centre.

    order: number of terms of the polynomial, 1 to 4; imperfect: aspect ratio fy / fx, p1 and p2.
    The others are zero, and considered: their priors count in every covariance.
    """

    order: int = 1
    imperfect: bool = False

    @property
    def columns(self) -> Ints:
        """The places of the estimated parameters in a lens."""
        columns = [FOCAL, CX, CY, *range(K, K + self.order)]
        columns += IMPERFECTIONS if self.imperfect else []
        return np.array(columns)

    def with_boards(self, boards: int) -> Ints:
        """Return the places of the estimated parameters of lens and boards."""
        shapes = np.arange(LENS_SIZE, LENS_SIZE + SHAPE_SIZE * boards)
        return np.concatenate([self.columns, shapes])


def terms_of_lens(lens: Array) -> FreeTerms:
    """Return the terms of a lens (10,) that are not zero."""
    order = max((i + 1 for i in range(MAX_ORDER) if lens[K + i] != 0.0), default=1)
    return FreeTerms(order, bool(lens[IMPERFECTIONS].any()))


def typical_focal_px(corner_px: float) -> float:
    """Return the focal length of a typical camera; corner_px: from the centre to the corner."""
    return corner_px / math.tan(TYPICAL_HALF_FOV_RAD)


class WeightedPrior(NamedTuple):
    """
    A prior for kernels, px²: with d the difference from reference (C,), the cost dᵀ I d - 2 gᵀ d.

    information I (C, C) and gradient g (C,) are multiplied by the noise variance.
    """

    reference: Array
    information: Array
    gradient: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class TypicalCamera:
    """
    The prior on a camera of which nothing is known.

    corner_px: from the middle of the image to its corner; center_sigma_px; focal_px and its sigma;
    k and its sigma (None: that of real lenses); aspect_sigma: of fy / fx.
    """

    corner_px: float
    center_sigma_px: float
    focal_px: float
    focal_sigma_px: float
    k: float = 0.0
    k_sigma: float | None = None
    aspect_sigma: float = _ASPECT_SPREAD

    def at(self, focal_px: float, terms: FreeTerms, boards: int) -> tuple[Array, Array]:
        """Return mean and standard deviations (C,) for a lens of about this focal length."""
        mean = np.zeros(LENS_SIZE + SHAPE_SIZE * boards)
        sigma = np.empty_like(mean)
        mean[FOCAL], mean[K] = self.focal_px, self.k
        sigma[FOCAL] = self.focal_sigma_px
        sigma[CX] = sigma[CY] = self.center_sigma_px
        unit = (focal_px / self.corner_px) ** 2
        for i, (term, bend) in enumerate(zip(TERM_SPREADS, BEND_SPREADS, strict=True)):
            sigma[K + i] = math.hypot(term, bend * unit ** (i + 1))
        if self.k_sigma is not None:
            sigma[K] = self.k_sigma
        sigma[IMPERFECTIONS] = self.aspect_sigma, _DECENTRING_SPREAD, _DECENTRING_SPREAD
        if terms.imperfect:
            sigma[IMPERFECTIONS] = FREE_ASPECT_SPREAD, *[_FREE_DECENTRING_SPREAD] * 2
        sigma[LENS_SIZE:] = np.tile(SHAPE_SIGMAS, boards)
        return mean, sigma

    def information(self, focal_px: float, terms: FreeTerms, boards: int = 0) -> Array:
        """Return the inverse variances (C,) for a lens of about this focal length."""
        sigma = self.at(focal_px, terms, boards)[1]
        information: Array = sigma**-2.0
        return information


@dataclass(frozen=True, slots=True, eq=False)
class CommonPrior:
    """
    The prior on lens and boards: a typical camera, typical boards, and earlier views.

    Earlier views are a quadratic cost about reference (C,): information (C, C), gradient (C,).
    marginalised (C, C): the part of the information from views of this calibration, not of a
    loaded one; views: their number. scatter: degrees of freedom and scatter expected of new views.
    """

    typical: TypicalCamera
    reference: Array
    information: Array
    gradient: Array
    marginalised: Array
    views: int = 0
    scatter: tuple[float, float] = USUAL_SCATTER

    @classmethod
    def without_views(cls, typical: TypicalCamera) -> CommonPrior:
        """Return the prior of a camera of which nothing is known."""
        n = LENS_SIZE
        none = np.zeros((n, n))
        return cls(typical, np.zeros(n), none, np.zeros(n), none)

    @classmethod
    def of_calibration(
        cls, typical: TypicalCamera, lens: Array, covariance: Array, views: int
    ) -> CommonPrior:
        """Return the prior of a camera that was calibrated: lens (10,), covariance (10, 10)."""
        known = np.flatnonzero(np.diag(covariance) > 0.0)
        block = np.ix_(known, known)
        information, weights = np.zeros((LENS_SIZE, LENS_SIZE)), np.zeros(LENS_SIZE)
        information[block] = inverse_of_information(covariance[block])
        # The covariance includes the prior of a typical camera, which every fit adds again.
        mean, sigma = typical.at(float(lens[FOCAL]), terms_of_lens(lens), 0)
        weights[known] = sigma[known] ** -2.0
        nothing = np.zeros_like(information)
        information -= np.diag(weights)
        return cls(typical, lens.copy(), information, weights * (lens - mean), nothing, views)

    @property
    def boards(self) -> int:
        """The number of boards whose shapes are in the prior."""
        return (len(self.reference) - LENS_SIZE) // SHAPE_SIZE

    def with_scatter(self, scatter: float) -> CommonPrior:
        """Return the prior of views that scatter as those of an earlier calibration."""
        return replace(self, scatter=(_EARLIER_FREEDOM, scatter))

    def for_boards(self, boards: int) -> CommonPrior:
        """Return the prior with room for more boards, of which nothing is known."""
        if boards <= self.boards:
            return self
        size = LENS_SIZE + SHAPE_SIZE * boards
        return replace(
            self,
            reference=_enlarged(self.reference, size),
            information=_enlarged(self.information, size),
            gradient=_enlarged(self.gradient, size),
            marginalised=_enlarged(self.marginalised, size),
        )

    def known_shape(self, board: int, numbers: Array, covariance: Array) -> CommonPrior:
        """Return the prior with the shape of a board from an earlier calibration added."""
        prior = self.for_boards(board + 1)
        at = shape_slice(board)
        reference, information = prior.reference.copy(), prior.information.copy()
        reference[at], information[at, at] = numbers, inverse_of_information(covariance)
        return replace(prior, reference=reference, information=information)

    def known_shapes(self, shapes: Iterable[BoardShape]) -> CommonPrior:
        """Return the prior with the shapes of the first boards added."""
        prior = self
        for i, shape in enumerate(shapes):
            prior = prior.known_shape(i, shape.numbers, shape.covariance)
        return prior

    def without_board(self, board: int) -> CommonPrior:
        """Return the prior with what it says of a board's shape marginalised."""
        if board >= self.boards:
            return self
        at = np.arange(len(self.reference))[shape_slice(board)]
        rest = np.setdiff1d(np.arange(len(self.reference)), at)
        typical = np.diag(SHAPE_SIGMAS**-2.0)
        inverse = inverse_of_information(self.information[np.ix_(at, at)] + typical)
        across = self.information[np.ix_(rest, at)] @ inverse
        information, marginalised = np.zeros((2, *self.information.shape))
        gradient, reference = np.zeros((2, len(self.reference)))
        reference[rest] = self.reference[rest]
        kept = self.information[np.ix_(rest, rest)] - across @ self.information[np.ix_(at, rest)]
        information[np.ix_(rest, rest)] = 0.5 * (kept + kept.T)
        # The gradient of the typical shape, which is flat, at the reference.
        of_shape = self.gradient[at] - typical @ self.reference[at]
        gradient[rest] = self.gradient[rest] - across @ of_shape
        share = self.marginalised[np.ix_(rest, rest)]
        marginalised[np.ix_(rest, rest)] = np.minimum(np.abs(share), np.abs(kept)) * np.sign(kept)
        return CommonPrior(
            self.typical, reference, information, gradient, marginalised, self.views, self.scatter
        )

    def marginalise(
        self, information: Array, gradient: Array, common: Array, variance: float, at: Ints
    ) -> CommonPrior:
        """
        Return the prior with the information (18, 18) and negative gradient (18,) of a view added.

        Both are in px², at the given lens and boards (C,); variance: of the noise, px²; at: the
        places (18,) of the view's lens and board among them.
        """
        if not (np.isfinite(information).all() and np.isfinite(gradient).all()):
            return self
        # The view adds eᵀ S e - 2 gᵀ e to the cost, e the step from the linearisation, that is
        # -2 (g + S (θ - reference))ᵀ d with d the step from the reference.
        faded = self.marginalised / _MOST_MARGINALISED
        total = self.information - faded
        # The faded part is taken from a quadratic about the present estimate.
        gradients = self.gradient - faded @ (common - self.reference)
        total[np.ix_(at, at)] += information / variance
        added = gradient + information @ (common[at] - self.reference[at])
        gradients[at] += added / variance
        marginalised = self.marginalised - faded
        marginalised[np.ix_(at, at)] += information / variance
        return replace(
            self,
            information=total,
            gradient=gradients,
            marginalised=marginalised,
            views=self.views + 1,
        )

    def weighted(
        self, variance: float, focal_px: float, terms: FreeTerms, boards: int
    ) -> WeightedPrior:
        """Return the whole prior for kernels, for a lens of about this focal length."""
        prior = self.for_boards(boards)
        mean, sigma = self.typical.at(focal_px, terms, boards)
        # About the earlier views' reference; the typical camera's gradient there is w (m - r).
        weights = sigma**-2.0
        return WeightedPrior(
            prior.reference,
            variance * (prior.information + np.diag(weights)),
            variance * (prior.gradient + weights * (mean - prior.reference)),
        )


def _enlarged(array: Array, size: int) -> Array:
    """Return a vector or matrix with zeros appended; np.pad takes twenty times as long."""
    enlarged = np.zeros((size,) * array.ndim)
    enlarged[tuple(map(slice, array.shape))] = array
    return enlarged


def shape_slice(board: int) -> slice:
    """Return the places of a board's shape among lens and boards."""
    return slice(LENS_SIZE + SHAPE_SIZE * board, LENS_SIZE + SHAPE_SIZE * (board + 1))


def common_places(board: int) -> Ints:
    """Return the places (18,) of the lens and a board's shape among lens and boards."""
    at = shape_slice(board)
    return np.concatenate([np.arange(LENS_SIZE), np.arange(at.start, at.stop)])
