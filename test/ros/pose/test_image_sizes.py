# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures of another size are of another camera, as far as anybody can tell."""

from modes import FREEZE, LEARNING, Modes, SELF_CALIBRATE
import moving
from p4pfr_ros import CalibrationState
from p4pfr_ros.files.calibration import Calibration
from p4pfr_ros.ros.pose.camera_source import View
from p4pfr_ros.ros.runtime.rejections import Rejected


def test_pictures_of_another_size_are_of_another_camera():
    """It is said, and the calibration begins anew."""
    modes = Modes()
    modes.learn(moving.moments(0, 10))
    view = moving.moments(10, 11)[0].view
    larger = View(2.0 * view.image_points + 0.5, view.board_points, (1280, 960), 10)
    remark = modes._intrinsics.answer(larger, SELF_CALIBRATE).news().remark
    assert remark.cause == 'image_size'
    assert '640x480' in remark.reason
    assert '1280x960' in remark.reason
    assert modes.found.image_size == (1280, 960)
    assert modes.found.state is not CalibrationState.CALIBRATED
    assert modes._intrinsics.answer(larger, SELF_CALIBRATE).news().remark is None
    third = View(view.image_points, view.board_points, (800, 600), 11)
    assert isinstance(modes._intrinsics.answer(third, FREEZE), Rejected)


def test_a_size_that_comes_back_brings_its_camera_back():
    """A second camera_info, or a driver that was started anew, costs no calibration."""
    modes = Modes()
    modes.learn(moving.moments(0, LEARNING))
    before, moment = modes.found.fused, moving.moments(LEARNING, LEARNING + 1)[0]
    view = moment.view
    larger = View(2.0 * view.image_points + 0.5, view.board_points, (1280, 960), 10)
    assert modes._intrinsics.answer(larger, SELF_CALIBRATE).news().restarted
    again = modes.answer(moment)
    assert again.estimate.model.camera == before.camera
    assert again.remark.reason.endswith('taken for the one of which pictures came before')
    for width in range(641, 660):
        other = View(view.image_points, view.board_points, (width, 480), 10)
        modes._intrinsics.answer(other, SELF_CALIBRATE).news()
    assert len(modes.found._known_by_size) <= 8


def test_a_loaded_calibration_of_another_size_is_remarked_upon():
    """It is not taken, and nothing has started over."""
    learned = Modes()
    learned.learn(moving.moments(0, LEARNING))
    found = Calibration.from_estimate(learned.found.fused, (1280, 960), 'left')
    modes = Modes(found)
    news = modes.look(moving.moments(0, 1)[0]).news()
    assert news.remark.cause == 'image_size'
    assert '1280x960' in news.remark.reason
    assert not news.restarted
    assert modes.answer(moving.moments(1, 2)[0]).remark is None
