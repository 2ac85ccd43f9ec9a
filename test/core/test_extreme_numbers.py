# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Extreme numbers at every argument: an estimate, no model, or an error in one line."""

import dataclasses

from calibration_views import calibrate, compiled_only, draw_views, seeded_camera
from extremes import BOARD, CAMERA, IMAGE, SIZE, survives, VALUES, with_number
import numpy as np
from p4pfr_ros import (
    CalibrationOptions,
    CameraEstimate,
    CameraInfoModel,
    DivisionCamera,
    estimate_pose,
    EstimateOptions,
    SelfCalibration,
    solve_p4pfr,
    solve_p4pfr_batch,
    Verdict,
)
from p4pfr_ros.core.jit import COMPILED
from p4pfr_ros.scenes.instances import IMAGE_SIZE
import pytest

pytestmark = pytest.mark.exhaustive

CORNERS = [0, 5, 29, 24]
CENTER = (319.5, 239.5)
COVARIANCE = np.diag([1.0, 1.0, 1.0, 1e-4, 0.0, 0.0])
CAMERAS = {
    'size': {'image_size': SIZE},
    'centre': {'center_px': CENTER},
    'known': {'camera': CAMERA},
}
OPTIONS = {'ideal': EstimateOptions.ideal(), 'default': EstimateOptions()}
PLACES = {
    'one number': (1, 0),
    'one point': 1,
    'one column': (slice(None), 0),
    'all': slice(None),
}
MODELS = {'plumb_bob': 5, 'rational_polynomial': 8, 'equidistant': 4}

# Interpreted, a search takes seconds.
VALUES = VALUES if COMPILED else [1e-300, 1e30, 1e308]
over_values = pytest.mark.parametrize('value', VALUES)
over_counts = pytest.mark.parametrize('chosen', [CORNERS, range(30)], ids=['4', '30'])
over_options = pytest.mark.parametrize('name', OPTIONS)
over_models = pytest.mark.parametrize('model', MODELS)


def estimate(image, board, name='ideal', **arguments):
    """Estimate with a short search."""
    options = dataclasses.replace(OPTIONS[name], max_iterations=200 if COMPILED else 10)
    return estimate_pose(image, board, options=options, **arguments)


@over_options
@over_counts
@over_values
def test_points(value, chosen, name):
    image, board = IMAGE[list(chosen)], BOARD[list(chosen)]
    for known in CAMERAS.values():
        for place in PLACES.values():
            survives(estimate, with_number(image, place, value), board, name, **known)
            survives(estimate, image, with_number(board, place, value), name, **known)
        if np.isfinite(value):
            with np.errstate(all='ignore'):
                scaled, moved = [value * image, value * board], [image + value, board + value]
            survives(estimate, scaled[0], board, name, **known)
            survives(estimate, image, scaled[1], name, **known)
            survives(estimate, moved[0], board, name, **known)
            survives(estimate, image, moved[1], name, **known)


@over_options
@over_counts
@over_values
def test_image_size_and_centre(value, chosen, name):
    points = IMAGE[list(chosen)], BOARD[list(chosen)]
    for given in (
        {'image_size': (value, 480)},
        {'image_size': (value, value)},
        {'image_size': SIZE, 'center_px': (value, 239.5)},
        {'center_px': (value, value)},
    ):
        survives(estimate, *points, name, **given)


@over_options
@over_values
def test_division_camera(value, name):
    good = {'focal_px': 520.0, 'center_px': CENTER, 'k': -0.2, 'k2': 0.01, 'k3': 0.001}
    good |= {'k4': 1e-4, 'aspect': 1.01, 'p1': 1e-3, 'p2': -1e-3}
    for field in good:
        given = (value, 239.5) if field == 'center_px' else value
        camera = survives(DivisionCamera, **(good | {field: given}))
        if camera is not None:
            survives(estimate, IMAGE, BOARD, name, camera=camera)
            survives(camera.to_camera_info_model, SIZE)
            survives(camera.project, camera.unproject(IMAGE))


@over_models
@over_values
def test_camera_info_model(value, model):
    count = MODELS[model]
    good = {
        'distortion_model': model,
        'coefficients': (0.01,) * count,
        'focal_px': (520.0, 521.0),
        'center_px': CENTER,
        'residual_px': 0.0,
        'image_size': SIZE,
    }
    changes = [{'residual_px': value}, {'image_size': (value, 480)}, {'focal_px': (value, value)}]
    changes += [{name: (value, 240.0)} for name in ('focal_px', 'center_px')]
    for i in range(count):
        coefficients = tuple(value if i == j else 0.01 for j in range(count))
        changes.append({'coefficients': coefficients})
    for change in changes:
        camera = survives(CameraInfoModel, **(good | change))
        if camera is not None:
            survives(estimate, IMAGE, BOARD, camera=camera)


@pytest.mark.parametrize('kind', [EstimateOptions, CalibrationOptions])
@pytest.mark.parametrize('value', [*VALUES, 'text', None, True, 2**70, np.ones(2), np.float32(3)])
def test_options(value, kind):
    for field in dataclasses.fields(kind):
        survives(kind, **{field.name: value})


@pytest.mark.parametrize('end', ['low', 'high'])
@pytest.mark.parametrize('name', [f.name for f in dataclasses.fields(EstimateOptions)])
def test_options_at_the_ends_of_their_range(name, end):
    [field] = [f for f in dataclasses.fields(EstimateOptions) if f.name == name]
    value = getattr(field.metadata['option'], end)
    if value is None or name.endswith('_iterations') or not COMPILED:
        return
    priors = {'prior_focal_px': 500.0, 'prior_focal_sigma_px': 50.0}
    priors |= {'prior_k': -0.2, 'prior_k_sigma': 0.1}
    for base in (EstimateOptions(), EstimateOptions.ideal(), EstimateOptions(**priors)):
        if name.startswith('prior') and base.prior_k_sigma is None:
            continue
        options = survives(dataclasses.replace, base, **{name: value})
        if options is not None:
            for known in CAMERAS.values():
                survives(estimate_pose, IMAGE, BOARD, options=options, **known)
            calibration = SelfCalibration(SIZE, robust=options)
            for _ in range(2):
                survives(calibration.update, IMAGE, BOARD)


def test_an_option_of_another_number_type_is_converted():
    """Otherwise the kernels would be compiled for it, which takes half a minute."""
    options = EstimateOptions(threshold_px=3, seed=np.int8(7), prior_k_sigma=np.float32(0.5))
    assert [type(v) for v in (options.threshold_px, options.seed)] == [float, int]
    assert type(options.prior_k_sigma) is float
    with pytest.raises(ValueError, match=r'^seed must be an integer, got 0\.5$'):
        EstimateOptions(seed=0.5)
    with pytest.raises(ValueError, match=r'^threshold_px must be a number, got True$'):
        EstimateOptions(threshold_px=True)


@pytest.mark.parametrize('value', [5e-324, 1e-160, 0.99e-6])
def test_a_spread_is_zero_or_not_tiny(value):
    with pytest.raises(ValueError, match=r'^center_spread must be 0, or at least 1e-06, got '):
        EstimateOptions(center_spread=value)


@over_values
def test_the_minimal_solver(value):
    image, board = IMAGE[CORNERS] - CENTER, BOARD[CORNERS]
    for place in PLACES.values():
        for points in (
            (with_number(image, place, value), board),
            (image, with_number(board, place, value)),
        ):
            for solution in survives(solve_p4pfr, *points) or ():
                assert np.isfinite(solution.camera_from_board.matrix).all()
                assert np.isfinite([solution.camera.focal_px, solution.camera.k]).all()
            survives(solve_p4pfr_batch, *(each[None] for each in points))


@compiled_only
@over_values
def test_self_calibration(value):
    """After any view the next good one has a pose; a calibrated camera stays as it is."""
    for size in ((value, 480), (value, value)):
        calibration = survives(SelfCalibration, size)
        if calibration is not None:
            survives(calibration.update, IMAGE, BOARD)
    *views, last = draw_views(seeded_camera(0), 12)
    for count in (0, 11):
        calibration = calibrate(views[:count], SelfCalibration(IMAGE_SIZE))
        for place in PLACES.values():
            image, board = last.image_points, last.board_points
            survives(calibration.update, with_number(image, place, value), board)
            survives(calibration.update, image, with_number(board, place, value))
            survives(repr, calibration)
        estimate = survives(calibration.update, image, board)
        assert estimate.model is not None
    assert calibration.verdict in (Verdict.USED, Verdict.REDUNDANT)
    distance = last.camera_from_board.distance
    assert np.isclose(estimate.model.camera_from_board.distance, distance, rtol=0.05)


@compiled_only
@over_values
def test_a_loaded_calibration(value):
    camera = {'focal_px': 520.0, 'center_px': CENTER, 'k': -0.2, 'k2': 0.0, 'k3': 0.0}
    good = {'covariance': COVARIANCE, 'rms_px': 0.2, 'views': 9}
    changes = [(name, {}) for name in camera]
    changes += [('', {'covariance': with_number(COVARIANCE, (i, i), value)}) for i in range(6)]
    changes += [('', {'rms_px': value}), ('', {'views': value})]
    changes.append(('', {'covariance': np.full((6, 6), value)}))
    for name, change in changes:
        number = {name: (value, 239.5) if name == 'center_px' else value} if name else {}
        lens = survives(DivisionCamera, **(camera | number))
        given = lens and survives(CameraEstimate, lens, **(good | change))
        if given is None:
            continue
        calibration = SelfCalibration(SIZE)
        survives(calibration.load, given)
        for _ in range(2):
            survives(calibration.update, IMAGE, BOARD)
        survives(repr, calibration)
