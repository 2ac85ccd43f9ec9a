# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The objects of the public API: short reprs, equality, read-only arrays, OpenCV's shapes."""

from copy import deepcopy
from dataclasses import fields, replace
import pickle

import numpy as np
from p4pfr_ros import (
    CalibrationOptions,
    DivisionCamera,
    estimate_pose,
    EstimateOptions,
    Pose,
    SelfCalibration,
    solve_p4pfr,
    solve_p4pfr_batch,
    Status,
)
from p4pfr_ros.core.geometry import rotation_from_vector
import pytest

SIZE = (640, 480)
CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2)
POSE = Pose.from_rotation_vector([2.9, 0.3, 0.2], [0.02, -0.01, 0.6])
BOARD = np.stack(np.meshgrid(np.linspace(-0.1, 0.1, 5), np.linspace(-0.08, 0.08, 4)), -1)
BOARD = BOARD.reshape(-1, 2)
# The noise of a real detector, so that an estimate has a covariance.
IMAGE = CAMERA.project(POSE.transform(np.pad(BOARD, ((0, 0), (0, 1)))))
IMAGE = IMAGE + np.random.default_rng(0).normal(0.0, 0.2, IMAGE.shape)


@pytest.fixture(scope='module')
def objects():
    """Make one of each public object."""
    calibration = SelfCalibration(SIZE)
    estimate = calibration.update(IMAGE, BOARD, stamp=7)
    corners = [0, 4, 19, 15]
    return {
        'Pose': POSE,
        'DivisionCamera': CAMERA,
        'CameraInfoModel': CAMERA.to_camera_info_model(SIZE),
        'Solution': estimate.model,
        'PoseEstimate': estimate,
        'PoseEstimate without a model': estimate_pose(IMAGE, 0.0 * BOARD, image_size=SIZE),
        'CameraEstimate': calibration.fused,
        'BoardShape': calibration.fused.board_shape(),
        'Keyframe': calibration.views[0],
        'SolutionBatch': solve_p4pfr_batch(IMAGE[None, corners], BOARD[None, corners]),
        'EstimateOptions': EstimateOptions(),
        'CalibrationOptions': CalibrationOptions(),
        'SelfCalibration': calibration,
    }


NAMES = (
    'Pose',
    'DivisionCamera',
    'CameraInfoModel',
    'Solution',
    'PoseEstimate',
    'PoseEstimate without a model',
    'CameraEstimate',
    'BoardShape',
    'Keyframe',
    'SolutionBatch',
    'EstimateOptions',
    'CalibrationOptions',
)
# The fields that are arrays.
ARRAYS = {
    'Pose': ('rotation', 'translation'),
    'PoseEstimate': ('inliers', 'covariance'),
    'PoseEstimate without a model': ('inliers', 'covariance'),
    'CameraEstimate': ('covariance', 'coverage'),
    'BoardShape': ('center', 'half_extent', 'numbers', 'covariance'),
    'Keyframe': ('image_points', 'board_points', 'inliers', 'residuals_px'),
    'SolutionBatch': ('count', 'focal_px', 'k', 'rotation', 'translation'),
}


@pytest.mark.parametrize('name', [*NAMES, 'SelfCalibration'])
def test_repr_fits_a_screen(objects, name):
    text = repr(objects[name])
    assert text.startswith(name.split()[0])
    assert len(text) < 500
    assert '\n' not in text


@pytest.mark.parametrize('name', NAMES)
def test_copies_are_equal(objects, name):
    value = objects[name]
    assert value == deepcopy(value)
    assert value == pickle.loads(pickle.dumps(value))
    assert value != 1


@pytest.mark.parametrize('name', NAMES)
def test_objects_with_different_values_are_not_equal(objects, name):
    value = objects[name]
    changed = {
        'Pose': lambda: Pose(POSE.rotation, POSE.translation + 1e-9),
        'PoseEstimate': lambda: replace(value, covariance=2.0 * value.covariance),
        'PoseEstimate without a model': lambda: replace(value, status=Status.NO_SOLUTION),
        'Solution': lambda: replace(value, camera=CAMERA),
        'CameraEstimate': lambda: replace(value, covariance=2.0 * value.covariance),
        'BoardShape': lambda: replace(value, numbers=value.numbers + 1e-9),
        'Keyframe': lambda: replace(value, stamp=8),
        'SolutionBatch': lambda: replace(value, k=value.k + 1.0),
        'DivisionCamera': lambda: replace(value, k=0.1),
        'CameraInfoModel': lambda: replace(value, residual_px=1.0),
        'EstimateOptions': lambda: replace(value, seed=1),
        'CalibrationOptions': lambda: replace(value, max_views=30),
    }[name]()
    assert value != changed


@pytest.mark.parametrize('name', NAMES)
def test_arrays_are_read_only(objects, name):
    value = objects[name]
    values = {field.name: getattr(value, field.name) for field in fields(value)}
    arrays = {key: array for key, array in values.items() if isinstance(array, np.ndarray)}
    assert tuple(arrays) == ARRAYS.get(name, ())
    for array in arrays.values():
        with pytest.raises(ValueError, match='read-only'):
            array[...] = 0


def test_a_pose_copies_the_callers_array():
    translation = np.array([1.0, 2.0, 3.0])
    pose = Pose(np.eye(3), translation)
    translation[0] = 9.0
    assert pose.translation[0] == 1.0


def test_a_keyframe_copies_the_callers_arrays():
    image, board = IMAGE.copy(), BOARD.copy()
    calibration = SelfCalibration(SIZE)
    calibration.update(image, board)
    assert len(calibration.views) == 1
    image += 1.0
    board += 1.0
    np.testing.assert_array_equal(calibration.views[0].image_points, IMAGE)


def test_equal_poses_have_equal_hashes():
    assert len({POSE, deepcopy(POSE), Pose.identity()}) == 2


def test_matrices_transform_points_as_their_objects_do():
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (9, 3))
    homogeneous = np.column_stack([points, np.ones(9)]) @ POSE.matrix.T
    np.testing.assert_allclose(homogeneous[:, :3], POSE.transform(points), atol=1e-15)
    pinhole = DivisionCamera(500.0, (320.0, 240.0))
    in_front = points + np.array([0.0, 0.0, 3.0])
    projected = in_front @ pinhole.matrix.T
    np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], pinhole.project(in_front))


@pytest.mark.parametrize('angle', [0.0, 1e-12, 0.3, 2.0, np.pi - 1e-9, np.pi])
def test_rotation_vector_inverts_rodrigues(angle):
    vector = angle * np.array([2.0, -1.0, 0.5]) / np.linalg.norm([2.0, -1.0, 0.5])
    pose = Pose.from_rotation_vector(vector, np.zeros(3))
    back = rotation_from_vector(pose.rotation_vector)
    np.testing.assert_allclose(back, pose.rotation, atol=1e-14)
    assert np.linalg.norm(pose.rotation_vector) == pytest.approx(angle, abs=1e-14)


@pytest.mark.parametrize('tilt_deg', [0.0, 30.0, 90.0, 150.0])
def test_tilt_is_the_angle_from_facing_the_camera(tilt_deg):
    facing = Pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 2.0])
    tilted = facing @ Pose.from_rotation_vector([0.0, np.radians(tilt_deg), 0.0], np.zeros(3))
    assert tilted.tilt_deg == pytest.approx(tilt_deg)
    assert tilted.distance == 2.0


@pytest.mark.parametrize(
    ('image', 'board'),
    [
        (IMAGE[:, None], BOARD),
        (IMAGE, np.pad(BOARD, ((0, 0), (0, 1)))),
        (
            IMAGE[:, None].astype(np.float32).astype(float),
            np.pad(BOARD, ((0, 0), (0, 1)))[:, None],
        ),
    ],
    ids=['(N, 1, 2)', '(N, 3)', '(N, 1, 3)'],
)
def test_opencv_shapes_are_accepted(image, board):
    expected = estimate_pose(image.reshape(-1, 2), BOARD, image_size=SIZE)
    assert estimate_pose(image, board, image_size=SIZE) == expected
    four = [0, 4, 19, 15]
    assert solve_p4pfr(image[four], board[four]) == solve_p4pfr(
        image[four].reshape(-1, 2), BOARD[four]
    )
    assert SelfCalibration(SIZE).update(image, board).status is expected.status


@pytest.mark.parametrize(
    ('image', 'board', 'message'),
    [
        (
            IMAGE[:, None, None],
            BOARD,
            r'image_points must have shape \(N, 2\), got \(20, 1, 1, 2\)',
        ),
        (IMAGE.T, BOARD, r'image_points must have shape \(N, 2\), got \(2, 20\)'),
        (
            IMAGE,
            np.ones((20, 3)),
            'board_points must lie on the plane Z = 0, got a point with Z = 1',
        ),
        (IMAGE, BOARD[:9], r'board_points must have shape \(20, 2\), got \(9, 2\)'),
        (IMAGE, [[1.0], [2.0, 3.0]], r'board_points must be numbers of shape \(20, 2\)'),
    ],
)
def test_the_error_for_other_shapes_states_the_expected_one(image, board, message):
    with pytest.raises(ValueError, match=message) as error:
        estimate_pose(image, board, image_size=SIZE)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'camera': 520.0}, 'camera must be a DivisionCamera or a CameraInfoModel, got float'),
        (
            {'camera': np.eye(3)},
            'camera must be a DivisionCamera or a CameraInfoModel, got ndarray',
        ),
        ({'options': {'seed': 1}}, 'options must be EstimateOptions, got dict'),
        ({'options': CalibrationOptions()}, 'options must be EstimateOptions, got Calibration'),
    ],
)
def test_the_error_for_a_wrong_type_names_the_argument(arguments, message):
    with pytest.raises(TypeError, match=message):
        estimate_pose(IMAGE, BOARD, image_size=SIZE, **arguments)


def test_self_calibration_rejects_options_of_another_type():
    with pytest.raises(TypeError, match='options must be CalibrationOptions, got EstimateOptions'):
        SelfCalibration(SIZE, options=EstimateOptions())
    with pytest.raises(TypeError, match='robust must be EstimateOptions, got dict'):
        SelfCalibration(SIZE, robust={})


def test_standard_deviations_are_those_of_the_covariance(objects):
    estimate, fused = objects['PoseEstimate'], objects['CameraEstimate']
    sigma = np.sqrt(np.diag(estimate.covariance))
    assert (estimate.focal_sigma_px, estimate.k_sigma) == (sigma[6], sigma[7])
    direction = estimate.model.camera_from_board.translation
    direction = direction / np.linalg.norm(direction)
    variance = direction @ estimate.covariance[:3, :3] @ direction
    assert estimate.distance_sigma == pytest.approx(np.sqrt(variance))
    camera_sigma = np.sqrt(np.diag(fused.covariance))
    assert fused.focal_sigma_px == camera_sigma[0]
    np.testing.assert_array_equal(fused.center_sigma_px, camera_sigma[1:3])
    assert fused.terms_sigma == tuple(camera_sigma[3:7])
    assert (fused.aspect_sigma, *fused.decentring_sigma) == tuple(camera_sigma[7:])
    no_model = objects['PoseEstimate without a model']
    assert np.isnan([no_model.focal_sigma_px, no_model.k_sigma, no_model.distance_sigma]).all()


@pytest.mark.parametrize(
    ('terms', 'order'),
    [((0.0,), 1), ((-0.2, 0.1), 2), ((-0.2, 0.0, 0.1), 3), ((0.0, 0.0, 0.0, 0.1), 4)],
)
def test_order_counts_the_terms(terms, order):
    assert DivisionCamera(500.0, (320.0, 240.0), *terms).order == order
