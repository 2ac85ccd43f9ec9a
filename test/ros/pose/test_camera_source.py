# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The intrinsics modes without a node: accuracy of poses, changes of the camera, rejections."""

from dataclasses import replace

from modes import CALIBRATING, fixed, FREEZE, Modes, options, SELF_CALIBRATE
import moving
import numpy as np
from p4pfr_ros import BoardShape, CalibrationState, CameraEstimate, Status
from p4pfr_ros.boards.shape_in_use import shape_in_use
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.files.calibration import Calibration
from p4pfr_ros.ros.conversions import camera_info_from_model_msg, ImageFrame
from p4pfr_ros.ros.parameters.declare import replaced
from p4pfr_ros.ros.pose.camera_source import on_real_board
from p4pfr_ros.ros.pose.inputs import Target
import pytest
import scenes


@pytest.fixture(scope='module')
def calibrated():
    """Give modes with a calibrated camera; tests do not change it."""
    modes = Modes()
    modes.process_all(moving.views(0, CALIBRATING))
    assert modes.calibrations.state is CalibrationState.CALIBRATED
    return modes


def _rms(errors):
    return float(np.sqrt(np.mean(np.square(errors))))


def _errors_m(modes, settings, views):
    results = [modes.process(view.observation, settings) for view in views]
    poses = [result.estimate.model.camera_from_board for result in results]
    return [view.error_m(pose) for view, pose in zip(views, poses, strict=True)]


@pytest.mark.exhaustive
def test_poses_of_a_calibrated_camera_are_nearly_as_accurate_as_with_the_true_camera():
    """At most 20 % more error on the same views; a single view has three times the error."""
    modes, views = Modes(), moving.views(2000, 2100)
    # Many views determine the centre: 40 are keyframes, the others are marginalised.
    modes.process_all(moving.views(0, 1600))
    with_true_camera = _rms(_errors_m(modes, fixed(moving.CAMERA), views))
    assert _rms(_errors_m(modes, FREEZE, views)) < 1.2 * with_true_camera
    assert _rms(_errors_m(modes, SELF_CALIBRATE, views)) < 1.2 * with_true_camera
    assert _rms(_errors_m(modes, options('per_frame'), views)) > 3.0 * with_true_camera


def test_a_zoom_is_detected_within_ten_views_and_calibrated_again():
    """Until then there is no pose, or its error is within the covariance; then it is small."""
    modes = Modes()
    modes.process_all(moving.views(0, CALIBRATING))
    after = moving.views(CALIBRATING, 2 * CALIBRATING, moving.ZOOMED)
    results = [modes.process(view.observation) for view in after]
    causes = [r.notice.cause for r in results[:10] if r.notice is not None]
    assert causes == ['camera_changed']
    for view, result in zip(after, results, strict=True):
        if result.estimate.status is Status.MISFIT:
            continue
        pose = result.estimate.model.camera_from_board
        assert view.error_m(pose) < 3.0 * _sigma_m(result), view.index
    assert modes.calibrations.state is CalibrationState.CALIBRATED
    assert modes.calibrations.fused.camera.focal_px == pytest.approx(650.0, rel=0.005)
    assert any(result.estimate.status is Status.MISFIT for result in results[:10])


def _sigma_m(result):
    """Return the standard deviation of the position, m."""
    return float(np.sqrt(np.trace(result.estimate.covariance[:3, :3])))


def test_the_camera_to_publish_is_the_camera_in_use():
    """A new one after a view that changes it, the same object after a redundant view."""
    modes = Modes()
    first = modes.process_all(moving.views(0, 10))
    assert first.camera == modes.calibrations.fused.camera
    again = modes.process(moving.views(9, 10)[0].observation)
    assert again.camera is first.camera
    assert again.estimate.model.camera == first.camera


def test_a_calibrated_camera_gives_the_pose_before_it_is_updated():
    """Before it is calibrated, it is updated first, which improves the pose."""
    modes, poses = Modes(), []

    def on_pose(estimate):
        poses.append((estimate, modes.calibrations.fused))

    first = modes.process(moving.views(0, 1)[0].observation, on_pose=on_pose)
    [(estimate, fused)] = poses
    assert estimate is first.estimate
    assert fused is not None
    modes.process_all(moving.views(0, CALIBRATING))
    updates = 0
    for view in moving.views(CALIBRATING, 2 * CALIBRATING):
        poses.clear()
        before = modes.calibrations.fused
        result = modes.process(view.observation, on_pose=on_pose)
        [(estimate, fused)] = poses
        assert estimate is result.estimate
        assert estimate.model.camera == before.camera
        assert fused is before
        updates += result.camera != before.camera
    assert updates > 0


@pytest.mark.parametrize('mode', ['per_frame', 'fixed', 'camera_info'])
def test_the_other_modes_give_the_pose_once(mode):
    """It is the estimate that is returned."""
    model = moving.CAMERA.to_camera_info_model(moving.SIZE)
    info = camera_info_from_model_msg(scenes.header(0), ImageFrame(moving.SIZE), model)
    settings = fixed(moving.CAMERA) if mode == 'fixed' else options(mode)
    poses = []
    observation = moving.views(0, 1)[0].observation
    result = Modes(camera_info=info).process(observation, settings, poses.append)
    assert [pose is result.estimate for pose in poses] == [True]


def test_the_first_of_two_boards_in_an_image_may_reveal_the_change():
    """The second board agrees with the new camera; the notice of the first is not lost."""
    modes = Modes()
    modes.process_all(moving.views(0, CALIBRATING))
    causes = []
    for view in moving.views(CALIBRATING, 2 * CALIBRATING, moving.ZOOMED):
        notices = [modes.process(view.observation).notice for _ in range(2)]
        causes += [notice.cause for notice in notices if notice is not None]
    assert 'camera_changed' in causes


def test_fixed_keeps_the_estimated_camera(calibrated):
    """Views of another camera do not change it."""
    fused = calibrated.calibrations.fused
    for view in moving.views(CALIBRATING, CALIBRATING + 20, moving.ZOOMED):
        result = calibrated.process(view.observation, FREEZE)
        assert result.estimate.model is None or result.estimate.model.camera == fused.camera
    assert calibrated.calibrations.fused is fused


def test_fixed_without_a_camera_lists_the_parameters_to_set():
    """The reason names them."""
    rejected = Modes().process(moving.views(0, 1)[0].observation, FREEZE)
    assert rejected.cause == 'no_camera'
    assert 'intrinsics.focal_px' in rejected.reason
    assert 'calibration_file' in rejected.reason


def test_fixed_publishes_the_camera_of_the_parameters():
    """The current one: parameters may change."""
    first, second = moving.views(0, 2)
    settings = fixed(moving.CAMERA)
    modes = Modes()
    assert modes.process(first.observation, settings).camera == moving.CAMERA
    other = replaced(settings, {'intrinsics.k': -0.2})
    assert modes.process(second.observation, other).camera.k == -0.2


@pytest.mark.parametrize('mode', ['camera_info', 'fixed'])
def test_the_calibration_of_another_program_gives_the_true_pose(mode):
    """From camera_info or from a file; its model is not the division model."""
    model = moving.CAMERA.to_camera_info_model(moving.SIZE)
    info = camera_info_from_model_msg(scenes.header(0), ImageFrame(moving.SIZE), model)
    loaded = Calibration(image_size=moving.SIZE, camera_name='other', model=model)
    modes = Modes(loaded=loaded, camera_info=info)
    for view in moving.views(0, 20):
        observation = view.observation
        pose, true = (
            modes.process(observation, settings).estimate.model.camera_from_board
            for settings in (options(mode), fixed(moving.CAMERA))
        )
        np.testing.assert_allclose(pose.translation, true.translation, atol=1e-6)
        assert rotation_angle_rad(pose.rotation, true.rotation) < 1e-5


def test_a_loaded_calibration_has_the_shapes_of_its_boards():
    """By name, and for the points that it was seen with; another board counts as flat."""
    shape = BoardShape(
        np.zeros(2), np.array([0.1, 0.0625]), [0, 0, 0.02, 0, 0, 0, 0, 0], 1e-10 * np.eye(8)
    )
    covariance = np.diag([0.1, 0.1, 0.1, 1e-6, 0, 0, 0, 0, 0, 0])
    [view] = moving.views(0, 1)
    in_camera = view.camera_from_board.transform(shape.points(moving.BOARD.points))
    image_points = moving.CAMERA.project(in_camera)
    errors_m = {}
    for known, name in (('wall', 'wall'), ('wall', 'door'), ('', '')):
        estimate = CameraEstimate(moving.CAMERA, covariance, 0.2, 20, board_shapes={known: shape})
        modes = Modes(loaded=Calibration.from_estimate(estimate, moving.SIZE, 'camera'))
        board = replace(moving.BOARD, name=name) if name else None
        observed = moving.observation(image_points, moving.SIZE, 0, Target(board=board))
        pose = modes.process(observed, FREEZE).estimate.model.camera_from_board
        errors_m[name] = view.error_m(pose)
    assert errors_m['wall'] == pytest.approx(errors_m[''], abs=1e-9)
    assert errors_m['wall'] < 1e-5 < 1e-4 < errors_m['door']


def test_a_shape_is_not_extrapolated():
    """Another board of the same name, which is larger, counts as flat."""
    points = moving.BOARD.points
    for factor, known in ((0.9, False), (1.0, True), (3.0, True)):
        shape = BoardShape(
            np.zeros(2), factor * np.array([0.1, 0.0625]), np.zeros(8), np.zeros((8, 8))
        )
        estimate = CameraEstimate(moving.CAMERA, np.eye(10), 0.2, 20, board_shapes={'wall': shape})
        assert (shape_in_use(estimate, 'wall', points) is shape) is known
        assert shape_in_use(estimate, 'door', points) is None


def test_self_calibration_estimates_the_shape_of_each_board_by_its_name():
    modes = Modes()
    targets = [Target(f'~/{name}', replace(moving.BOARD, name=name)) for name in ('a', 'b')]
    for view in moving.views(0, 12):
        target = targets[view.index % 2]
        observed = moving.observation(view.image_points, moving.SIZE, view.index, target)
        modes.process(observed)
    assert set(modes.calibrations.fused.board_shapes) == {'a', 'b'}
    before = Modes()
    assert before.calibrations.missing == ()
    before.process(observed)
    assert '4 more different views' in before.calibrations.missing


def test_the_points_for_markers_are_on_the_real_board():
    """The residuals that colour them are those of the estimate."""
    modes = Modes()
    modes.process_all(moving.views(0, 20))
    calibration = modes.calibrations.select(
        moving.SIZE, SELF_CALIBRATE.robust, SELF_CALIBRATE.calibration
    )
    observed = moving.views(20, 21)[0].observation
    surface = on_real_board(calibration, observed).surface_points
    shape = modes.calibrations.fused.board_shape('')
    np.testing.assert_array_equal(surface, shape.points(moving.BOARD.points))
    assert on_real_board(moving.CAMERA, observed) is observed


def test_a_missing_camera_info_is_rejected():
    """In the mode camera_info only."""
    rejected = Modes().process(moving.views(0, 1)[0].observation, options('camera_info'))
    assert rejected.cause == 'no_camera_info'


def test_new_options_keep_the_camera():
    """A change of robust.* or calibration.* does not discard the calibration."""
    modes = Modes()
    modes.process_all(moving.views(0, CALIBRATING))
    before = modes.calibrations.fused
    observation = moving.views(CALIBRATING, CALIBRATING + 1)[0].observation
    settings = options('self_calibrate', robust__threshold_px=4.0, calibration__max_views=30)
    assert modes.process(observation, settings).notice is None
    after = modes.calibrations
    assert after.state is CalibrationState.CALIBRATED
    assert abs(after.fused.camera.focal_px - before.camera.focal_px) < before.focal_sigma_px


def test_a_loaded_calibration_is_used_from_the_first_view(calibrated):
    """A reset discards it."""
    estimate = calibrated.calibrations.fused
    modes = Modes(loaded=Calibration.from_estimate(estimate, moving.SIZE, 'camera'))
    observation = moving.views(CALIBRATING, CALIBRATING + 1)[0].observation
    result = modes.process(observation)
    assert result.camera is not None
    assert modes.calibrations.state is CalibrationState.CALIBRATED
    alone = modes.process(observation, options('per_frame'))
    assert _sigma_m(result) < 0.6 * _sigma_m(alone)
    modes.calibrations.reset()
    assert modes.calibrations.state is CalibrationState.UNCALIBRATED
    assert not modes.calibrations.has_camera
