# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The modes without a node: how good poses get, what changes are noticed, what is refused."""

from modes import fixed, FREEZE, LEARNING, Modes, NO_CAMERA_INFO, options, SELF_CALIBRATE
import moving
import numpy as np
from p4pfr_ros import CalibrationState
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.files.calibration import Calibration
from p4pfr_ros.ros.parameters.declare import replaced
import pytest


@pytest.fixture(scope='module')
def learned():
    """Give modes that have found the camera; tests only look at them."""
    modes = Modes()
    modes.learn(moving.moments(0, LEARNING))
    assert modes.found.state is CalibrationState.CALIBRATED
    return modes


def _rms(errors):
    return float(np.sqrt(np.mean(np.square(errors))))


def _errors_m(modes, settings, moments):
    answers = [modes.answer(moment, settings) for moment in moments]
    poses = [answer.estimate.model.camera_from_board for answer in answers]
    return [moment.error_m(pose) for moment, pose in zip(moments, poses, strict=True)]


def test_once_calibrated_poses_are_nearly_as_good_as_by_the_true_camera():
    """The same views: at most 20 % more error; one view alone has three times as much."""
    modes, moments = Modes(), moving.moments(2000, 2100)
    # The centre of a lens is told by many views together; 40 are kept, and all remembered.
    modes.learn(moving.moments(0, 1600))
    by_truth = _rms(_errors_m(modes, fixed(moving.CAMERA), moments))
    assert _rms(_errors_m(modes, FREEZE, moments)) < 1.2 * by_truth
    assert _rms(_errors_m(modes, SELF_CALIBRATE, moments)) < 1.2 * by_truth
    assert _rms(_errors_m(modes, options('per_frame'), moments)) > 3.0 * by_truth


def test_a_zoom_is_noticed_within_ten_views_and_recovered_from():
    """Meanwhile, errors are within what the covariances say; afterwards they are small again."""
    modes = Modes()
    modes.learn(moving.moments(0, LEARNING))
    after = moving.moments(LEARNING, 2 * LEARNING, moving.ZOOMED)
    answers = [modes.answer(moment) for moment in after]
    noticed = [a.remark.cause for a in answers[:10] if a.remark is not None]
    assert noticed == ['camera_changed']
    for moment, answer in zip(after, answers, strict=True):
        pose = answer.estimate.model.camera_from_board
        assert moment.error_m(pose) < 3.0 * _sigma_m(answer), moment.index
    assert modes.found.state is CalibrationState.CALIBRATED
    assert modes.found.fused.camera.focal_px == pytest.approx(650.0, rel=0.005)
    worst_before = max(_sigma_m(a) for a in answers[:10])
    assert worst_before > 2.0 * _sigma_m(answers[-1])


def _sigma_m(answer):
    """Return the standard deviation of the position, m."""
    return float(np.sqrt(np.trace(answer.estimate.covariance[:3, :3])))


def test_the_camera_that_is_told_is_the_one_in_use():
    """Another one after a view that has changed it, and the same after one that adds nothing."""
    modes = Modes()
    first = modes.learn(moving.moments(0, 10))
    assert first.camera == modes.found.fused.camera
    again = modes.answer(moving.moments(9, 10)[0])
    assert again.camera is first.camera
    assert again.estimate.model.camera == first.camera


def test_a_pose_by_a_known_camera_does_not_wait_for_what_is_learnt():
    """Until the camera is good, the view itself makes the pose better, and is learnt from."""
    modes, told = Modes(), 0
    modes.look(moving.moments(0, 1)[0])
    assert modes.found.fused is not None
    modes.learn(moving.moments(0, LEARNING))
    for moment in moving.moments(LEARNING, 2 * LEARNING):
        before = modes.found.fused
        answer = modes.look(moment)
        assert answer.estimate.model.camera == before.camera
        assert modes.found.fused is before
        told += answer.news().camera != before.camera
    assert told > 0


def test_of_two_boards_in_a_picture_the_first_may_tell_of_the_change():
    """The second agrees with the new camera; what the first has brought is not lost by that."""
    modes = Modes()
    modes.learn(moving.moments(0, LEARNING))
    causes = []
    for moment in moving.moments(LEARNING, 2 * LEARNING, moving.ZOOMED):
        answers = [modes.look(moment), modes.look(moment)]
        remarks = [answer.news().remark for answer in answers]
        causes += [remark.cause for remark in remarks if remark is not None]
    assert 'camera_changed' in causes


def test_fixed_freezes_the_camera_that_was_found(learned):
    """Views of another camera do not change it."""
    found = learned.found.fused
    for moment in moving.moments(LEARNING, LEARNING + 20, moving.ZOOMED):
        answer = learned.answer(moment, FREEZE)
        assert answer.estimate.model is None or answer.estimate.model.camera == found.camera
    assert learned.found.fused is found


def test_fixed_without_a_camera_says_what_is_missing():
    """It names the parameters that would help."""
    rejected = Modes().answer(moving.moments(0, 1)[0], FREEZE)
    assert rejected.cause == 'no_camera'
    assert 'intrinsics.focal_px' in rejected.reason
    assert 'calibration_file' in rejected.reason


def test_fixed_tells_its_camera():
    """The one of the moment: parameters may change."""
    first, second = moving.moments(0, 2)
    settings = fixed(moving.CAMERA)
    modes = Modes()
    assert modes.answer(first, settings).camera == moving.CAMERA
    other = replaced(settings, {'intrinsics.k': -0.2})
    assert modes.answer(second, other).camera.k == -0.2


@pytest.mark.parametrize('mode', ['camera_info', 'fixed'])
def test_a_camera_that_somebody_else_has_calibrated_gives_the_true_pose(mode):
    """By a CameraInfo, or by a file of another program; its model is not ours."""
    model = moving.CAMERA.to_camera_info_model(moving.SIZE)
    loaded = Calibration(image_size=moving.SIZE, camera_name='other', model=model)
    modes = Modes(loaded=loaded, model=model)
    moments = moving.moments(0, 20)
    by_truth = [modes.answer(moment, fixed(moving.CAMERA)).estimate.model for moment in moments]
    for moment, truth in zip(moments, by_truth, strict=True):
        model = modes.answer(moment, options(mode)).estimate.model
        pose, true = model.camera_from_board, truth.camera_from_board
        np.testing.assert_allclose(pose.translation, true.translation, atol=1e-6)
        assert rotation_angle_rad(pose.rotation, true.rotation) < 1e-5


def test_a_camera_info_that_is_missing_is_the_reason():
    """Passed on as it is."""
    assert Modes().answer(moving.moments(0, 1)[0], options('camera_info')) is NO_CAMERA_INFO


def test_new_thresholds_keep_the_camera():
    """Nothing that was learned is lost when robust.* or calibration.* change."""
    modes = Modes()
    modes.learn(moving.moments(0, LEARNING))
    before = modes.found.fused
    moment = moving.moments(LEARNING, LEARNING + 1)[0]
    settings = options('self_calibrate', robust__threshold_px=4.0, calibration__max_views=30)
    assert modes.answer(moment, settings).remark is None
    assert modes.found.state is CalibrationState.CALIBRATED
    assert abs(modes.found.fused.camera.focal_px - before.camera.focal_px) < before.focal_sigma_px


def test_a_calibration_that_was_loaded_holds_from_the_first_view(learned):
    """And a reset forgets it."""
    estimate = learned.found.fused
    loaded = Calibration.from_estimate(estimate, moving.SIZE, 'camera')
    modes = Modes(loaded=loaded)
    moment = moving.moments(LEARNING, LEARNING + 1)[0]
    answer = modes.answer(moment)
    assert answer.camera is not None
    assert modes.found.state is CalibrationState.CALIBRATED
    assert _sigma_m(answer) < 0.6 * _sigma_m(modes.answer(moment, options('per_frame')))
    modes.found.reset()
    assert modes.found.state is CalibrationState.UNCALIBRATED
    assert not modes.found.knows_any
