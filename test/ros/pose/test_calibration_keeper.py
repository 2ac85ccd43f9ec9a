# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The calibration's life beside being made: where it lies, loaded, saved, passed on."""

from dataclasses import replace
from pathlib import Path
import time

import moving
import numpy as np
from p4pfr_ros import CalibrationState
from p4pfr_ros.files.calibration import Calibration, load_calibration, save_calibration
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.ros.conversions import ImageFrame
from p4pfr_ros.ros.parameters.declare import replaced
from p4pfr_ros.ros.parameters.image_node_options import PoseNodeOptions
from p4pfr_ros.ros.pose.calibration_keeper import CalibrationKeeper
from p4pfr_ros.ros.pose.calibration_path import calibration_path
import pytest
import scenes

SETTINGS = PoseNodeOptions().robust.ransac(), PoseNodeOptions().calibration.core()
FRAME = ImageFrame(moving.SIZE)


class Kept:
    """A keeper, and what it has said and passed on."""

    def __init__(self, path, **values):
        self.options = replaced(PoseNodeOptions(), {'calibration_file': str(path)} | values)
        self.said, self.told = [], []
        self.keeper = CalibrationKeeper(self.options, self.told.append, self.said.append)

    def set(self, **values):
        """Change parameters."""
        self.options = replaced(self.options, values)

    def learn(self, moments):
        """Show it views; return what it remarks."""
        found = self.keeper.found
        robust, calibration = self.options.robust.ransac(), self.options.calibration.core()
        remarks = []
        for moment in moments:
            found.make_ready(moving.SIZE, robust, calibration)
            _, learn = found.answer(moment.image_points, moving.BOARD.points, moment.index)
            header, restarted = scenes.header(moment.index), learn().restarted
            remarks.append(
                self.keeper.look_after(header, FRAME, self.options, restarted=restarted)
            )
        return [remark for remark in remarks if remark is not None]


@pytest.fixture
def path(tmp_path):
    """Name a file in a folder that is not there yet."""
    return tmp_path / 'camera_info' / 'left.yaml'


def test_a_calibration_that_was_saved_is_there_after_a_restart(path):
    """The numbers to the last digit, their uncertainty, and how far it has come."""
    before = Kept(path)
    before.learn(moving.moments(0, 40))
    ok, text = before.keeper.save()
    assert ok, text
    assert str(path) in text
    after = Kept(path)
    assert 'focal length' in after.said[0]
    after.keeper.found.make_ready(moving.SIZE, *SETTINGS)
    old, new = before.keeper.found.fused, after.keeper.found.fused
    assert new.camera == old.camera
    np.testing.assert_allclose(new.covariance, old.covariance, rtol=1e-12)
    assert after.keeper.found.state is CalibrationState.CALIBRATED


def test_states_are_said_and_a_good_calibration_is_passed_on_once(path):
    """Saved too, if that was asked for."""
    kept = Kept(path, save_when_calibrated=True)
    kept.learn(moving.moments(0, 40))
    assert [line for line in kept.said if CalibrationState.CONVERGING.value in line]
    assert len([line for line in kept.said if CalibrationState.CALIBRATED.value in line]) == 1
    [info] = kept.told
    assert (info.width, info.height, info.distortion_model) == (640, 480, 'rational_polynomial')
    assert info.k[0] == pytest.approx(520.0, rel=0.01)
    assert load_calibration(path).camera_name == 'camera'
    kept.learn(moving.moments(40, 80, moving.ZOOMED))
    assert [info.k[0] for info in kept.told[1:]] == pytest.approx([650.0], rel=0.02)
    kept.keeper.reset()
    kept.learn(moving.moments(0, 40))
    assert len(kept.told) == 3


def test_a_calibration_that_wavers_is_passed_on_once(path):
    """As when it is asked to be better, and then is not."""
    kept = Kept(path)
    kept.learn(moving.moments(0, 30))
    kept.set(**{'calibration.focal_tolerance': 1e-6})
    kept.learn(moving.moments(30, 35))
    assert kept.keeper.found.state is CalibrationState.CONVERGING
    kept.set(**{'calibration.focal_tolerance': 0.005})
    kept.learn(moving.moments(35, 40))
    assert kept.keeper.found.state is CalibrationState.CALIBRATED
    assert len(kept.told) == 1


def test_saving_may_be_asked_for_late(path):
    """As a parameter that is changed while the node works."""
    kept = Kept(path)
    kept.learn(moving.moments(0, 40))
    kept.set(save_when_calibrated=True)
    kept.learn(moving.moments(40, 42))
    assert path.exists()
    assert len([line for line in kept.said if line.startswith('saved')]) == 1


def test_what_could_not_be_saved_is_remarked_and_tried_again(tmp_path, monkeypatch):
    """Not with each view, but after a while."""
    (tmp_path / 'file').write_text('')
    kept = Kept(tmp_path / 'file' / 'left.yaml', save_when_calibrated=True)
    [remark] = kept.learn(moving.moments(0, 40))
    assert remark.cause == 'not_saved'
    assert str(tmp_path / 'file') in remark.reason
    (tmp_path / 'file').unlink()
    assert kept.learn(moving.moments(40, 42)) == []
    assert not (tmp_path / 'file').exists()
    now_s = time.monotonic()
    monkeypatch.setattr(time, 'monotonic', lambda: now_s + 61.0)
    assert kept.learn(moving.moments(42, 44)) == []
    assert (tmp_path / 'file' / 'left.yaml').exists()


def test_one_view_is_no_views(path):
    """A line for people."""
    kept = Kept(path)
    kept.learn(moving.moments(0, 1))
    assert kept.said[0].endswith(', 1 view')


def test_nothing_is_saved_unasked(path):
    """The file is the user's."""
    Kept(path).learn(moving.moments(0, 40))
    assert not path.exists()


def test_before_there_is_a_calibration_saving_says_so(path):
    """And leaves no file."""
    assert Kept(path).keeper.save() == (
        False,
        'nothing to save: no calibration has been found yet',
    )
    assert not path.exists()


def test_a_place_that_cannot_be_written_to_is_said(tmp_path):
    """One line with the path; the node lives on."""
    (tmp_path / 'file').write_text('')
    kept = Kept(tmp_path / 'file' / 'left.yaml')
    kept.learn(moving.moments(0, 12))
    ok, text = kept.keeper.save()
    assert not ok
    assert str(tmp_path / 'file') in text


def test_a_broken_file_is_refused(path):
    """It is not taken for one that is missing, nor overwritten."""
    path.parent.mkdir()
    path.write_text('image_width: 640\n')
    with pytest.raises(ConfigError, match=str(path)):
        Kept(path)
    assert path.read_text() == 'image_width: 640\n'


def test_a_file_of_another_program_serves_the_mode_fixed(path):
    """Its camera is known at once, and what is found does not begin with it."""
    ours = moving.CAMERA.to_camera_info_model(moving.SIZE)
    model = replace(ours, residual_px=0.0)
    save_calibration(path, Calibration(image_size=moving.SIZE, camera_name='left', model=model))
    kept = Kept(path)
    assert 'of another program' in kept.said[0]
    found = kept.keeper.found
    assert found.known_camera(moving.SIZE) == model
    assert found.known_camera((1280, 960)).cause == 'image_size'
    found.make_ready(moving.SIZE, *SETTINGS)
    assert found.state is CalibrationState.UNCALIBRATED


def test_without_a_name_the_file_is_where_camera_info_manager_has_it(monkeypatch, tmp_path):
    """It is not loaded unasked: it may be of any camera."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    kept = Kept('', camera_name='left')
    kept.learn(moving.moments(0, 12))
    assert kept.keeper.save()[0]
    assert load_calibration(tmp_path / 'camera_info/left.yaml').camera_name == 'left'
    again = Kept('', camera_name='left')
    assert again.said == []
    assert not again.keeper.found.knows_any


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ('', '/home/me/.ros/camera_info/left.yaml'),
        ('/data/a.yaml', '/data/a.yaml'),
        ('file:///data/a%20b.yaml', '/data/a b.yaml'),
        ('file://${ROS_HOME}/c/${NAME}.yaml', '/home/me/.ros/c/left.yaml'),
        ('~/a.yaml', '/home/me/a.yaml'),
        ('here.yaml', 'here.yaml'),
    ],
)
def test_names_of_files_are_those_of_camera_info_manager(monkeypatch, given, expected):
    """Paths and URLs."""
    monkeypatch.setenv('HOME', '/home/me')
    monkeypatch.delenv('ROS_HOME', raising=False)
    assert calibration_path(given, 'left') == Path(expected)


def test_a_url_of_another_kind_is_refused():
    """It is not taken for a folder of that name."""
    with pytest.raises(ConfigError, match=r"calibration_file: expected .* got 'package://a/b'"):
        calibration_path('package://a/b', 'left')


def test_a_camera_name_that_is_no_file_name_is_refused():
    """Nor may it lead elsewhere."""
    with pytest.raises(ConfigError, match=r'^camera_name: expected letters'):
        replaced(PoseNodeOptions(), {'camera_name': '../left'})
