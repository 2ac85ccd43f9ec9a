# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The modes without a node: how good poses get, what changes are noticed, what is refused."""

from typing import NamedTuple

import moving
import numpy as np
from p4pfr_ros import CalibrationState, DivisionCamera, PoseEstimate
from p4pfr_ros.calibration_file import Calibration
from p4pfr_ros.core.geometry import rotation_angle_rad
from p4pfr_ros.ros.intrinsics import Intrinsics, View
from p4pfr_ros.ros.options import PoseNodeOptions
from p4pfr_ros.ros.parameters import replaced
from p4pfr_ros.ros.rejections import Rejected
from p4pfr_ros.ros.self_calibrating import SelfCalibrating
import pytest

NO_CAMERA_INFO = Rejected('no_camera_info', 'none has come')
LEARNING = 60


def options(mode, **values):
    """Return pose_node's options in a mode."""
    named = {name.replace('__', '.'): value for name, value in values.items()}
    return replaced(PoseNodeOptions(), {'intrinsics.mode': mode} | named)


def fixed(camera):
    """Return the options of the mode fixed with a camera."""
    x, y = camera.center_px
    values = {'intrinsics__focal_px': camera.focal_px, 'intrinsics__k': camera.k}
    return options('fixed', image__center_x_px=x, image__center_y_px=y, **values)


SELF_CALIBRATE, FREEZE = options('self_calibrate'), options('fixed')


class Answered(NamedTuple):
    """A moment's answer, and what it has brought besides."""

    estimate: PoseEstimate
    camera: DivisionCamera | None
    remark: Rejected | None


class Modes:
    """The modes of one node, and the camera that it finds."""

    def __init__(self, loaded=None, model=NO_CAMERA_INFO):
        self.found = SelfCalibrating(loaded)
        self._intrinsics = Intrinsics(self.found, lambda: model)

    def look(self, moment, settings=SELF_CALIBRATE):
        """Answer one moment; nothing may have been learnt from it yet."""
        return self._intrinsics.answer(moment.view, settings)

    def answer(self, moment, settings=SELF_CALIBRATE):
        """Answer one moment, and learn from it."""
        answer = self.look(moment, settings)
        if isinstance(answer, Rejected):
            return answer
        news = answer.news()
        return Answered(answer.estimate, news.camera, news.remark)

    def learn(self, moments, settings=SELF_CALIBRATE):
        """Answer many; return the last answer."""
        return [self.answer(moment, settings) for moment in moments][-1]


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
    assert len(modes.found._of_other_sizes) <= 8


def test_a_loaded_calibration_of_another_size_is_remarked_upon(learned):
    """It is not taken, and nothing has started over."""
    found = Calibration.from_estimate(learned.found.fused, (1280, 960), 'left')
    modes = Modes(found)
    news = modes.look(moving.moments(0, 1)[0]).news()
    assert news.remark.cause == 'image_size'
    assert '1280x960' in news.remark.reason
    assert not news.restarted
    assert modes.answer(moving.moments(1, 2)[0]).remark is None


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
