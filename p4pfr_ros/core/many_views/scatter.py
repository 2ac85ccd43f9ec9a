# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""By how much views differ over their camera: what their points' errors have in common."""

from __future__ import annotations

import numpy as np

from ..geometry import Array
from ..model.prior import inverse_of

# The scatter of the views counts from this many degrees of freedom on: before, it is taken to be
# what the noise explains.
_SCATTER_FREEDOM = 4.0


def scatter_of(
    information: Array, pulls: Array, prior: Array, total: Array, variance: float
) -> float:
    """
    Return by how much views differ over the lens, in units of what the noise explains.

    information (V, n, n) and pulls (V, n) are the views' equations for the lens at their common
    optimum, prior (n, n) what is known besides, total (n, n) all of it together; px². Errors that
    the points of a view share (a board that is not flat, a lens that is not of the model) do not
    show in its residuals, but in that: each view would have the lens go its own way.
    """
    # A view alone would move the lens by (S + Λ)⁻¹ g, S its information, g its pull and Λ the
    # prior's. At the optimum of all, g has the covariance σ² (S - S T⁻¹ S), T the total.
    alone = np.linalg.inv(information + prior)
    expected = information - information @ inverse_of(total) @ information
    squares = np.einsum('va,vab,vb->', pulls, alone, pulls) / variance
    freedom = np.einsum('vab,vba->', alone, expected)
    return max(1.0, float((_SCATTER_FREEDOM + squares) / (_SCATTER_FREEDOM + freedom)))
