# SPDX-License-Identifier: Apache-2.0
"""By how much views differ over their camera: what their points' errors have in common."""

from __future__ import annotations

import numpy as np

from .adjust import LensPrior
from .geometry import Array
from .information import inverse_of
from .lens import LENS_SIZE

# The scatter of the views counts from this many degrees of freedom on: before, it is taken to be
# what the noise explains.
_SCATTER_FREEDOM = 4.0


def scatter_of(
    told: Array, equations: Array, prior: LensPrior, variance: float, free: int
) -> float:
    """
    Return by how much the views differ over the lens, in units of what the noise explains.

    told (V, 6, 7) are the views' equations for the lens, at the common optimum. Errors that the
    points of a view share (a board that is not flat, a lens that is not of the model) do not show
    in its residuals, but in that: each view would have the lens go its own way.
    """
    # A view alone would move the lens by (S + Λ)⁻¹ g, S its information, g its pull and Λ the
    # prior's. At the optimum of all, g has the covariance σ² (S - S T⁻¹ S), T the total.
    information, pulls = told[:, :free, :free], told[:, :free, LENS_SIZE]
    alone = np.linalg.inv(information + prior.information[:free, :free])
    total = inverse_of(equations[:free, :free])
    squares = np.einsum('va,vab,vb->', pulls, alone, pulls) / variance
    freedom = np.einsum('vab,vba->', alone, information - information @ total @ information)
    return max(1.0, float((_SCATTER_FREEDOM + squares) / (_SCATTER_FREEDOM + freedom)))
