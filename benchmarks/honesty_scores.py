# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an estimate states, against the truth: its errors in its own standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from p4pfr_ros import Pose, PoseEstimate
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.model.uncertainty import COV_FOCAL
from p4pfr_ros.scenes.deviating_view import DeviatingView

# A gross error: the rotation, or the position as a share of the distance.
GROSS_DEG, GROSS_SHARE = 5.0, 0.1
BEYOND_SIGMAS = 5.0
FAR_FACTOR = 10.0

SCORE_HEADER = (
    'views',
    'published',
    'gross',
    f'beyond {BEYOND_SIGMAS:g} sigma',
    f'{FAR_FACTOR:g} times off',
    'NEES / dof,\nmedian',
    'mean of z(f)²',
)


@dataclass(frozen=True, slots=True)
class Score:
    """
    One estimate, judged.

    published: ``~/pose`` would publish it; the other fields count only then.
    gross: its pose is off by more than `GROSS_DEG` or `GROSS_SHARE`.
    far: its distance or its observable focal length is off by more than `FAR_FACTOR`.
    z : (8,) errors in standard deviations, in the order of a covariance; NaN: not observable, or
    without a truth (k of a lens outside the model).
    nees: squared error normalised by the covariance, per degree of freedom.
    """

    published: bool
    gross: bool = False
    far: bool = False
    z: tuple[float, ...] = ()
    nees: float = math.nan

    @property
    def beyond(self) -> bool:
        """Whether an observable quantity is off by more than `BEYOND_SIGMAS`."""
        return bool(np.nanmax(np.abs(self.z)) > BEYOND_SIGMAS)


def score_of(estimate: PoseEstimate, truth: DeviatingView) -> Score:
    """Judge an estimate of a view."""
    if estimate.model is None or not estimate.observable.pose:
        return Score(published=False)
    error = _errors(estimate, truth)
    variances = np.diag(estimate.covariance)
    # Infinite variances are of what is not observable; the sigma of a number taken for known is 0.
    stated = np.isfinite(error) & np.isfinite(variances) & (variances > 0.0)
    sigma = np.sqrt(variances, where=stated, out=np.full(len(error), np.nan))
    z = error / sigma
    distance = float(np.linalg.norm(truth.camera_from_board.translation))
    estimated = estimate.model.camera_from_board.distance
    ratios = [estimated / distance]
    if estimate.observable.focal:
        ratios.append(estimate.model.camera.focal_px / truth.focal_px)
    return Score(
        published=True,
        gross=math.degrees(float(np.linalg.norm(error[3:6]))) > GROSS_DEG
        or float(np.linalg.norm(error[:3])) > GROSS_SHARE * distance,
        far=any(abs(math.log(ratio)) > math.log(FAR_FACTOR) for ratio in ratios),
        z=tuple(z.tolist()),
        nees=_nees(z[stated], (estimate.covariance / np.outer(sigma, sigma))[stated][:, stated]),
    )


def _errors(estimate: PoseEstimate, truth: DeviatingView) -> Array:
    """Return the errors (8,) in the order of a covariance; NaN for k without a truth."""
    assert estimate.model is not None
    pose, true_pose = estimate.model.camera_from_board, truth.camera_from_board
    turned = Pose(pose.rotation @ true_pose.rotation.T, np.zeros(3)).rotation_vector
    camera = estimate.model.camera
    lens = camera.focal_px - truth.focal_px, camera.k - truth.k
    return np.concatenate([pose.translation - true_pose.translation, turned, lens])


def _nees(z: Array, correlation: Array) -> float:
    """Return the normalised squared error per degree of freedom; infinite if it has no inverse."""
    try:
        return float(z @ np.linalg.solve(correlation, z)) / len(z)
    except np.linalg.LinAlgError:
        return math.inf


def summary(scores: Sequence[Score]) -> tuple[str, ...]:
    """Return the cells of a row, as in `SCORE_HEADER`."""
    published = [score for score in scores if score.published]
    focal = np.array([score.z[COV_FOCAL] for score in published])
    focal = focal[np.isfinite(focal)]
    return (
        str(len(scores)),
        str(len(published)),
        _share([score.gross for score in published]),
        _share([score.beyond for score in published]),
        _share([score.far for score in published]),
        _number(float(np.median([score.nees for score in published]))) if published else '',
        _number(float(np.mean(focal**2))) if focal.size else '',
    )


def _share(found: Sequence[bool]) -> str:
    """Return a number and its share of all, percent."""
    return f'{sum(found)} ({100.0 * float(np.mean(found)):.1f} %)' if found else ''


def _number(value: float) -> str:
    return f'{value:.2f}' if value < 1000.0 else f'{value:.0e}'
