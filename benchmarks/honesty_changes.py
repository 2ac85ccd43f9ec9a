# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a calibrated camera states after it has changed, and when the change is detected.

Stands alone because it follows sequences of views, where ``honesty_kinds`` judges single ones.
"""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
from p4pfr_ros import DivisionCamera, EstimateOptions, SelfCalibration, Verdict
from p4pfr_ros.scenes.deviating_view import BOARD, Deviations, draw_deviating_view

from .honesty_kinds import calibrated
from .honesty_scores import Score, score_of
from .tables import Row

ZOOMS = (1.05, 1.1, 1.3, 0.8)
SOON = 10  # views

CHANGE_HEADER = (
    'zoom',
    'cameras',
    f'detected within\n{SOON} views',
    'median views',
    'views before,\npublished',
    'of them gross',
    'gross and\nbeyond 5 sigma',
)

_SEED = 5
_MOST_VIEWS = 20
_TILT_DEG = (10.0, 60.0)


def change_rows(cameras: int, options: EstimateOptions) -> list[Row]:
    """Measure the rows of all zooms."""
    calibrations = [calibrated(index, options) for index in range(cameras)]
    rows: list[Row] = []
    for zoom in ZOOMS:
        needed, published = [], []
        for index, (camera, calibration) in enumerate(calibrations):
            assert isinstance(camera, DivisionCamera)
            zoomed = dataclasses.replace(camera, focal_px=zoom * camera.focal_px)
            rng = np.random.default_rng([_SEED, index])
            views, scores = _until_detected(rng, zoomed, copy.deepcopy(calibration))
            needed.append(views)
            published += [score for score in scores if score.published]
        gross = [score for score in published if score.gross]
        rows.append(
            (
                f'{zoom:g}',
                str(cameras),
                str(sum(views <= SOON for views in needed)),
                f'{np.median(needed):g}',
                str(len(published)),
                str(len(gross)),
                str(sum(score.beyond for score in gross)),
            )
        )
    return rows


def _until_detected(
    rng: np.random.Generator, camera: DivisionCamera, calibration: SelfCalibration
) -> tuple[int, list[Score]]:
    """Return the number of views until the restart, and the scores of the views before it."""
    scores: list[Score] = []
    for number in range(1, _MOST_VIEWS + 1):
        view = draw_deviating_view(
            rng, camera, calibration.image_size, BOARD, Deviations(), tilt_deg=_TILT_DEG
        )
        estimate = calibration.update(view.image_points, view.board_points)
        if calibration.verdict is Verdict.RESTARTED:
            return number, scores
        scores.append(score_of(estimate, view))
    return _MOST_VIEWS + 1, scores
