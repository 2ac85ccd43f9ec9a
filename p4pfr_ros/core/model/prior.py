# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is known of the lens besides the views that are fitted: beforehand, and from others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .lens import LENS_SIZE
from ..geometry import Array
from ..linalg import invert_information
from ..many_views.bundle_adjustment import LensPrior

# Views that are no longer fitted count for so many at most, and fade as new ones come: a lens
# that is warmed up by the sun may change.
_MOST_REMEMBERED = 2000.0


# Of a scaled matrix's smallest eigenvalue, beside the one on its diagonal.
_CLEARLY = 1e-9


def inverse_of(information: Array) -> Array:
    """Invert a symmetric matrix of mixed units; what it does not hold gets a huge variance."""
    n = len(information)
    inverse = np.empty((n, n))
    invert_information(np.ascontiguousarray(information), np.empty((n, n + 1)), inverse)
    return inverse


@dataclass(frozen=True, slots=True, eq=False)
class Knowledge:
    """
    A normal distribution of the lens: mean (6,) and information (6, 6), inverse squares.

    remembered (6, 6) is what of the information comes from views that are not fitted any more,
    and views is their number.
    """

    mean: Array
    information: Array
    remembered: Array
    views: int

    @classmethod
    def beforehand(cls, mean: Array, information: Array, views: int = 0) -> Knowledge:
        """Return what is known before the first view."""
        return cls(mean, information, np.zeros((LENS_SIZE, LENS_SIZE)), views)

    def weighed(self, variance: float) -> LensPrior:
        """Return it in px², for a noise of that variance."""
        return LensPrior(self.mean, variance * self.information)

    def remembering(self, told: Array, pull: Array, lens: Array, variance: float) -> Knowledge:
        """
        Add what a view told of the lens (6, 6), and where from lens (6,) it would have it go.

        Both are px², for a noise of that variance.
        """
        # The view's share of the cost about the lens θ is dᵀ S d - 2 gᵀ d, d the step from θ. Two
        # quadratic functions of the lens make one, whose minimum is where their pulls cancel.
        faded = self.remembered / _MOST_REMEMBERED
        information = self.information - faded + told / variance
        if not _is_positive(information):  # a view of next to nothing, and rounding
            return self
        pulls = (told @ (lens - self.mean) + pull) / variance
        return replace(
            self,
            mean=self.mean + inverse_of(information) @ pulls,
            information=information,
            remembered=self.remembered - faded + told / variance,
            views=self.views + 1,
        )


def _is_positive(information: Array) -> bool:
    """Say whether a matrix of mixed units is positive definite, clearly so."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    if not (size > 0.0).all():
        return False
    return bool(np.linalg.eigvalsh(information / np.outer(size, size))[0] > _CLEARLY)
