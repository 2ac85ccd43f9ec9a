# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The kinds of views of the honesty benchmark, and the estimates that it judges."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import copy
from dataclasses import dataclass

import numpy as np
from p4pfr_ros import (
    CalibrationState,
    estimate_pose,
    EstimateOptions,
    SelfCalibration,
)
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.scenes.deviating_view import (
    BOARD,
    Camera,
    Deviations,
    draw_deviating_view,
    draw_lens,
    Lens,
    Range,
)

from .honesty_scores import Score, score_of

Draw = Callable[[np.random.Generator], Deviations]

SIZES = ((640, 480), (1280, 720))

# Of cameras that are calibrated first: one for this many views of a kind, at least one.
VIEWS_PER_CAMERA = 10
_CALIBRATION_VIEWS = 40
_CALIBRATION_CENTER = 0.03  # largest distance of the centre from the middle, in widths
_FRONTAL_DEG = (0.0, 12.0)
_CALIBRATION_TILT_DEG = (10.0, 60.0)
_SEEDS = {'marker': 1, 'board': 2, 'calibrated': 3, 'calibration': 4}


@dataclass(frozen=True, slots=True)
class ViewKind:
    """One kind of views: the lens, the distance of its centre from the middle, deviations."""

    draw: Draw
    lens: Lens = 'division'
    center: Range = (0.0, 0.0)


def _always(**deviations: float) -> Draw:
    return lambda rng: Deviations(**deviations)  # type: ignore[arg-type]


def _signed(rng: np.random.Generator, size: float) -> float:
    return size if rng.random() < 0.5 else -size


def _aspect(rng: np.random.Generator) -> Deviations:
    return Deviations(aspect=1.0 + _signed(rng, rng.uniform(0.01, 0.03)))


def _bow(size_m: float) -> Draw:
    return lambda rng: Deviations(bow_x_m=_signed(rng, size_m))


def _shutter(shear: float) -> Draw:
    return lambda rng: Deviations(shear=_signed(rng, shear))


def _hand(rng: np.random.Generator) -> Deviations:
    return Deviations(hand='missing' if rng.random() < 0.5 else 'wrong')


_MARKER_NOISE = _always(noise_px=0.3)
_CENTER_OFF = (0.02, 0.08)

MARKER_KINDS: dict[str, ViewKind] = {
    'in model': ViewKind(_MARKER_NOISE),
    'centre 2 to 8 % of the width off': ViewKind(_MARKER_NOISE, center=_CENTER_OFF),
    'Brown-Conrady lens': ViewKind(_MARKER_NOISE, 'plumb_bob'),
    'equidistant lens': ViewKind(_MARKER_NOISE, 'equidistant'),
}
BOARD_KINDS: dict[str, ViewKind] = {
    'in model': ViewKind(_always()),
    'centre 2 to 8 % of the width off': ViewKind(_always(), center=_CENTER_OFF),
    'Brown-Conrady lens': ViewKind(_always(), 'plumb_bob'),
    'rational lens': ViewKind(_always(), 'rational_polynomial'),
    'equidistant lens': ViewKind(_always(), 'equidistant'),
    'fy/fx 1 to 3 % off': ViewKind(_aspect),
    'board bowed by 1 mm': ViewKind(_bow(0.001)),
    'board stretched by 0.5 %': ViewKind(_always(stretch=0.005)),
    '30 % outliers': ViewKind(_always(outlier_share=0.3)),
}
CALIBRATED_KINDS: dict[str, Draw] = {
    'none': _always(),
    'rolling shutter, 0.5 %': _shutter(0.005),
    'rolling shutter, 1 %': _shutter(0.01),
    'rolling shutter, 2 %': _shutter(0.02),
    'board printed 1 % too wide': _always(stretch=0.01),
    'board bowed by 1 mm': _bow(0.001),
    'board bowed by 2 mm': _bow(0.002),
    'noise 1 px instead of 0.2': _always(noise_px=1.0),
    'a hand over half the board': _hand,
}


def free_scores(
    kinds: Mapping[str, ViewKind], board_points: Array, views: int, options: EstimateOptions
) -> dict[str, list[Score]]:
    """Judge estimates of single views of an unknown camera, by kind; each view has its camera."""
    table = _SEEDS['marker' if len(board_points) == 4 else 'board']
    found = {}
    for row, (name, kind) in enumerate(kinds.items()):
        rng = np.random.default_rng([table, row])
        found[name] = [
            _free_score(rng, kind, SIZES[i % 2], board_points, options) for i in range(views)
        ]
    return found


def _free_score(
    rng: np.random.Generator,
    kind: ViewKind,
    size: tuple[int, int],
    board_points: Array,
    options: EstimateOptions,
) -> Score:
    camera = draw_lens(rng, size, kind.lens, rng.uniform(*kind.center))
    view = draw_deviating_view(rng, camera, size, board_points, kind.draw(rng))
    estimate = estimate_pose(
        view.image_points, view.board_points, image_size=size, options=options
    )
    return score_of(estimate, view)


def calibrated_scores(
    kinds: Mapping[str, Draw], views: int, options: EstimateOptions
) -> dict[str, list[Score]]:
    """
    Judge estimates of the next view after a calibration with views in the model, by kind.

    Each view is given to a copy of the calibration, which has seen no other view that deviates.
    """
    calibrations = [calibrated(i, options) for i in range(max(1, views // VIEWS_PER_CAMERA))]
    found = {}
    for row, (name, draw) in enumerate(kinds.items()):
        rng = np.random.default_rng([_SEEDS['calibrated'], row])
        found[name] = [
            _next_score(rng, *calibrations[i % len(calibrations)], draw) for i in range(views)
        ]
    return found


def calibrated(index: int, options: EstimateOptions) -> tuple[Camera, SelfCalibration]:
    """Return a camera, and its calibration."""
    rng = np.random.default_rng([_SEEDS['calibration'], index])
    size = SIZES[0]
    camera = draw_lens(rng, size, 'division', rng.uniform(0.0, _CALIBRATION_CENTER))
    calibration = SelfCalibration(size, robust=options)
    for _ in range(_CALIBRATION_VIEWS):
        view = draw_deviating_view(
            rng, camera, size, BOARD, Deviations(), tilt_deg=_CALIBRATION_TILT_DEG
        )
        calibration.update(view.image_points, view.board_points)
    assert calibration.state is CalibrationState.CALIBRATED, calibration
    return camera, calibration


def _next_score(
    rng: np.random.Generator, camera: Camera, calibration: SelfCalibration, draw: Draw
) -> Score:
    view = draw_deviating_view(
        rng, camera, calibration.image_size, BOARD, draw(rng), tilt_deg=_FRONTAL_DEG
    )
    return score_of(copy.deepcopy(calibration).update(view.image_points, view.board_points), view)
