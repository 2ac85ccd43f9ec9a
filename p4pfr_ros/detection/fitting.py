# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Many small least-squares fits at once: one model, N patches of a picture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from p4pfr_ros.core.geometry import Array

# Of parameters (N, p): the model's values (N, m) and their derivatives (N, m, p).
Model = Callable[[Array], tuple[Array, Array]]

# The Gaussian with the variance of a unit box, 1/12, as a tanh of the same slope: √(2/π) √12.
_LARGEST_SLOPE = 2.76
_DAMPING_AFTER_SUCCESS, _DAMPING_AFTER_FAILURE = 0.2, 10.0


def fit_patches(
    model: Model,
    start: Array,
    observed: Array,
    weights: Array,
    iterations: int,
    *,
    first_damping: float = 1e-3,
) -> tuple[Array, Array]:
    """
    Fit a model to each of N patches by Levenberg and Marquardt's method.

    Parameters
    ----------
    model
        What should be seen, and its derivatives.
    start : (N, p) array
        Parameters to start from.
    observed, weights : (N, m) arrays
        What was seen, and how much each value counts.
    iterations
        Number of steps tried.
    first_damping
        Damping of the first step, as a part of the curvature: the larger, the smaller the step.

    Returns
    -------
    The parameters (N, p) and the weighted rms (N,) of what is left.

    """
    parameters = start.copy()
    values, slopes = model(parameters)
    cost = _cost(observed - values, weights)
    damping = np.full(len(start), first_damping)
    for _ in range(iterations):
        step = _damped_step(observed - values, slopes, weights, damping)
        tried = parameters + step
        tried_values, tried_slopes = model(tried)
        tried_cost = _cost(observed - tried_values, weights)
        better = tried_cost < cost
        parameters[better] = tried[better]
        values[better], slopes[better] = tried_values[better], tried_slopes[better]
        cost = np.where(better, tried_cost, cost)
        damping *= np.where(better, _DAMPING_AFTER_SUCCESS, _DAMPING_AFTER_FAILURE)
    rms: Array = np.sqrt(cost / np.maximum(weights.sum(axis=1), 1e-9))
    return parameters, rms


def sharpness(q: Array) -> tuple[Array, Array]:
    """
    Return the slope s, per pixel, of an edge tanh(s e) by a free parameter q, and ds/dq.

    q = 0 is half of the largest slope: that of an ideal edge, averaged over a pixel. To allow for
    sharper ones would leave an edge's place, within a pixel, open.
    """
    s: Array = _LARGEST_SLOPE / (1.0 + np.exp(-np.clip(q, -30.0, 30.0)))
    return s, s * (1.0 - s / _LARGEST_SLOPE)


def _cost(residuals: Array, weights: Array) -> Array:
    cost: Array = np.sum(weights * residuals**2, axis=1)
    return cost


def _damped_step(residuals: Array, slopes: Array, weights: Array, damping: Array) -> Array:
    weighted = slopes * weights[..., None]
    normal = np.swapaxes(weighted, 1, 2) @ slopes
    gradient = np.swapaxes(weighted, 1, 2) @ residuals[..., None]
    diagonal = np.einsum('nii->ni', normal)
    # The small constant is for a blank patch, where nothing depends on anything.
    diagonal += damping[:, None] * diagonal + 1e-6
    step: Array = np.asarray(np.linalg.solve(normal, gradient)[..., 0], dtype=np.float64)
    return step
