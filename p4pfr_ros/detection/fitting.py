# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Many small least-squares fits at once: one model, N image patches."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from p4pfr_ros.core.geometry import Array

# Largest slope of tanh: that of the Gaussian with the variance of a unit box, 1/12: √(2/π) √12.
_MAX_SLOPE = 2.76
_DAMPING_AFTER_SUCCESS, _DAMPING_AFTER_FAILURE = 0.2, 10.0


class PatchModel(Protocol):
    """Grey levels of N patches as a function of their parameters."""

    def evaluate(self, parameters: Array) -> tuple[Array, Array]:
        """Return the levels (N, m) for parameters (N, p), and their derivatives (N, m, p)."""


def fit_patches(
    model: PatchModel,
    start: Array,
    observed: Array,
    weights: Array,
    iterations: int,
    *,
    first_damping: float = 1e-3,
) -> tuple[Array, Array]:
    """
    Fit a model to each of N patches with the Levenberg-Marquardt method.

    Parameters
    ----------
    model
        The model to fit.
    start : (N, p) array
        Initial parameters.
    observed, weights : (N, m) arrays
        Observed grey levels and their weights.
    iterations
        Number of steps to try.
    first_damping
        Damping of the first step, relative to the curvature; larger values shorten the step.

    Returns
    -------
    The parameters (N, p) and the weighted rms residual (N,).

    """
    parameters = start.copy()
    values, derivatives = model.evaluate(parameters)
    cost = _cost(observed - values, weights)
    damping = np.full(len(start), first_damping)
    for _ in range(iterations):
        step = _damped_step(observed - values, derivatives, weights, damping)
        trial = parameters + step
        trial_values, trial_derivatives = model.evaluate(trial)
        trial_cost = _cost(observed - trial_values, weights)
        better = trial_cost < cost
        parameters[better] = trial[better]
        values[better], derivatives[better] = trial_values[better], trial_derivatives[better]
        cost = np.where(better, trial_cost, cost)
        damping *= np.where(better, _DAMPING_AFTER_SUCCESS, _DAMPING_AFTER_FAILURE)
    rms: Array = np.sqrt(cost / np.maximum(weights.sum(axis=1), 1e-9))
    return parameters, rms


def sharpness(q: Array) -> tuple[Array, Array]:
    """
    Map an unbounded parameter q to the slope s of an edge tanh(s e), per pixel; return s, ds/dq.

    s is bounded by the slope of an ideal edge averaged over a pixel; q = 0 gives half of it. An
    even sharper edge would leave its position within a pixel undetermined.
    """
    s: Array = _MAX_SLOPE / (1.0 + np.exp(-np.clip(q, -30.0, 30.0)))
    return s, s * (1.0 - s / _MAX_SLOPE)


def _cost(residuals: Array, weights: Array) -> Array:
    cost: Array = np.sum(weights * residuals**2, axis=1)
    return cost


def _damped_step(residuals: Array, derivatives: Array, weights: Array, damping: Array) -> Array:
    weighted = derivatives * weights[..., None]
    normal = np.swapaxes(weighted, 1, 2) @ derivatives
    gradient = np.swapaxes(weighted, 1, 2) @ residuals[..., None]
    diagonal = np.einsum('nii->ni', normal)
    # The constant keeps the matrix regular for a uniform patch, where all derivatives are zero.
    diagonal += damping[:, None] * diagonal + 1e-6
    step: Array = np.asarray(np.linalg.solve(normal, gradient)[..., 0], dtype=np.float64)
    return step
