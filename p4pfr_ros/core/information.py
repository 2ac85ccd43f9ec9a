# SPDX-License-Identifier: Apache-2.0
"""What is known of the lens besides the views that are fitted: beforehand, and from others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .adjust import LensPrior
from .geometry import Array
from .lens import LENS_SIZE

# Views that are no longer fitted count for so many at most, and fade as new ones come: a lens
# that is warmed up by the sun may change.
_MOST_REMEMBERED = 2000.0

# On the diagonal of a scaled matrix, so that it can always be inverted.
_NO_INFORMATION = 1e-13


def inverse_of(information: Array) -> Array:
    """Invert a symmetric matrix of mixed units; what it does not hold gets a huge variance."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))  # rounding may take it below
    size = np.where(size > 0.0, size, 1.0)
    scale = np.outer(size, size)
    held = information / scale + _NO_INFORMATION * np.eye(len(size))
    inverse: Array = np.linalg.inv(held) / scale
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
        pulls = (told @ (lens - self.mean) + pull) / variance
        return replace(
            self,
            mean=self.mean + inverse_of(information) @ pulls,
            information=information,
            remembered=self.remembered - faded + told / variance,
            views=self.views + 1,
        )
