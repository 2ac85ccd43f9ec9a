# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The calibration file: path, loading, saving; and the driver, which receives the result."""

from dataclasses import replace
import os
from pathlib import Path
import tempfile
import time

import moving
import numpy as np
from p4pfr_ros import CalibrationState
from p4pfr_ros.files.calibration import Calibration, load_calibration, save_calibration
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.ros.parameters.declare import replaced
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
from p4pfr_ros.ros.pose.calibration_keeper import calibration_path, CalibrationKeeper
import pytest

SETTINGS = PoseNodeOptions().robust, PoseNodeOptions().calibration


class Log:
    """Records log lines."""

    def __init__(self):
        self.lines = []

    def info(self, text):
        """Record a line."""
        self.lines.append(text)

    def warning(self, text):
        """Record a line."""
        self.lines.append(f'WARN {text}')

    @property
    def saved(self):
        """The lines about saving."""
        return [line for line in self.lines if line.startswith('saved to ')]


class Driver:
    """Records the calibrations that are sent to the camera driver."""

    def __init__(self):
        self.sent = []

    def send(self, camera_info):
        """Record a calibration."""
        self.sent.append(camera_info)


class Kept:
    """A keeper with its log and its driver."""

    def __init__(self, path, **values):
        self.options = replaced(PoseNodeOptions(), {'calibration_file': str(path)} | values)
        self.log, self.driver = Log(), Driver()
        self.keeper = CalibrationKeeper(self.log, self.driver, self.options)

    def set(self, **values):
        """Set parameters."""
        self.options = replaced(self.options, values)

    def process(self, views):
        """Update the calibration with views; return the notices of the keeper."""
        calibrations, options, notices = self.keeper.calibrations, self.options, []
        for view in views:
            calibration = calibrations.select(moving.SIZE, options.robust, options.calibration)
            calibration.update(view.image_points, moving.BOARD.points, view.index)
            calibrations.finish_view()
            notices.append(self.keeper.follow(view.observation, options))
        return [notice for notice in notices if notice is not None]


@pytest.fixture
def path(tmp_path):
    """Give the path of a file in a folder that does not exist yet."""
    return tmp_path / 'camera_info' / 'left.yaml'


def test_a_saved_calibration_is_loaded_after_a_restart(path):
    """Camera, covariance and state are the same."""
    before = Kept(path)
    before.process(moving.views(0, 40))
    ok, text = before.keeper.save()
    assert ok, text
    assert str(path) in text
    after = Kept(path)
    assert 'focal length' in after.log.lines[0]
    after.keeper.calibrations.select(moving.SIZE, *SETTINGS)
    old, new = before.keeper.calibrations.fused, after.keeper.calibrations.fused
    assert new.camera == old.camera
    np.testing.assert_allclose(new.covariance, old.covariance, rtol=1e-12)
    assert after.keeper.calibrations.state is CalibrationState.CALIBRATED


def test_states_are_logged_and_the_calibration_is_sent_once(path):
    """With save_when_calibrated it is also saved; it is sent again after a restart."""
    kept = Kept(path, save_when_calibrated=True)
    kept.process(moving.views(0, 40))
    assert [line for line in kept.log.lines if CalibrationState.CONVERGING.value in line]
    assert len([line for line in kept.log.lines if CalibrationState.CALIBRATED.value in line]) == 1
    [info] = kept.driver.sent
    assert (info.width, info.height, info.distortion_model) == (640, 480, 'rational_polynomial')
    assert info.k[0] == pytest.approx(520.0, rel=0.01)
    assert load_calibration(path).camera_name == 'camera'
    kept.process(moving.views(40, 80, moving.ZOOMED))
    assert [info.k[0] for info in kept.driver.sent[1:]] == pytest.approx([650.0], rel=0.02)
    kept.keeper.reset()
    kept.process(moving.views(0, 40))
    assert len(kept.driver.sent) == 3


def test_a_calibration_that_alternates_around_its_limit_is_sent_once(path):
    """The state alternates as the tolerance changes."""
    kept = Kept(path)
    kept.process(moving.views(0, 30))
    kept.set(**{'calibration.focal_tolerance': 1e-6})
    kept.process(moving.views(30, 35))
    assert kept.keeper.calibrations.state is CalibrationState.CONVERGING
    kept.set(**{'calibration.focal_tolerance': 0.005})
    kept.process(moving.views(35, 40))
    assert kept.keeper.calibrations.state is CalibrationState.CALIBRATED
    assert len(kept.driver.sent) == 1


def test_saving_can_be_enabled_later(path):
    """By a change of the parameter."""
    kept = Kept(path)
    kept.process(moving.views(0, 40))
    kept.set(save_when_calibrated=True)
    kept.process(moving.views(40, 42))
    assert path.exists()
    assert len([line for line in kept.log.lines if line.startswith('saved')]) == 1


def test_a_clearly_better_camera_is_saved_again(path):
    """When a standard deviation has fallen by a third, and not with each view."""
    kept, files = Kept(path, save_when_calibrated=True), []
    for view in moving.views(0, 90):
        kept.process([view])
        if not path.exists():
            continue
        file, fused = load_calibration(path).estimate, kept.keeper.calibrations.fused
        assert fused.focal_sigma_px >= file.focal_sigma_px / 1.51
        assert not fused.projection_sigma_px < file.projection_sigma_px / 1.51
        if not files or file != files[-1]:
            files.append(file)
    assert 2 <= len(files) == len(kept.log.saved) <= 10
    assert files[-1].focal_sigma_px < files[0].focal_sigma_px


def test_what_the_last_views_added_is_saved_at_the_end(path):
    """Once, and only if saving is enabled."""
    kept = Kept(path, save_when_calibrated=True)
    kept.keeper.save_at_end(kept.options)
    assert not path.exists()
    kept.process(moving.views(0, 45))
    fused, saved = kept.keeper.calibrations.fused, len(kept.log.saved)
    assert load_calibration(path).estimate != fused
    kept.set(save_when_calibrated=False)
    kept.keeper.save_at_end(kept.options)
    assert load_calibration(path).estimate != fused
    kept.set(save_when_calibrated=True)
    for _ in range(2):
        kept.keeper.save_at_end(kept.options)
    assert load_calibration(path).estimate == fused
    assert len(kept.log.saved) == saved + 1


def test_a_loaded_camera_is_not_saved_again_at_once(path):
    """The file has it already."""
    before = Kept(path)
    before.process(moving.views(0, 60))
    assert before.keeper.save()[0]
    after = Kept(path, save_when_calibrated=True)
    after.process(moving.views(60, 62))
    assert after.keeper.calibrations.state is CalibrationState.CALIBRATED
    assert after.log.saved == []


def test_the_file_of_another_program_is_kept(monkeypatch, tmp_path):
    """With .bak appended, as the log says."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    path = tmp_path / 'camera_info' / 'camera.yaml'
    path.parent.mkdir()
    path.write_text('image_width: 640\n')
    kept = Kept('', save_when_calibrated=True)
    kept.process(moving.views(0, 40))
    assert kept.log.saved[0].endswith(f'another program, is now {path}.bak')
    assert Path(f'{path}.bak').read_text() == 'image_width: 640\n'


def test_failed_saving_gives_a_notice_and_is_retried(tmp_path, monkeypatch):
    """After a minute, not with each view."""
    (tmp_path / 'file').write_text('')
    kept = Kept(tmp_path / 'file' / 'left.yaml', save_when_calibrated=True)
    [notice] = kept.process(moving.views(0, 40))
    assert notice.cause == 'not_saved'
    assert str(tmp_path / 'file') in notice.reason
    (tmp_path / 'file').unlink()
    assert kept.process(moving.views(40, 42)) == []
    assert not (tmp_path / 'file').exists()
    now_s = time.monotonic()
    monkeypatch.setattr(time, 'monotonic', lambda: now_s + 61.0)
    assert kept.process(moving.views(42, 44)) == []
    assert (tmp_path / 'file' / 'left.yaml').exists()


def test_one_view_is_singular(path):
    """In the log line."""
    kept = Kept(path)
    kept.process(moving.views(0, 1))
    assert kept.log.lines[0].endswith(', 1 view)')


def test_nothing_is_saved_by_default(path):
    """The file belongs to the user."""
    Kept(path).process(moving.views(0, 40))
    assert not path.exists()


def test_saving_without_a_calibration_fails(path):
    """No file is written."""
    assert Kept(path).keeper.save() == (
        False,
        'nothing to save: the camera has not been estimated yet',
    )
    assert not path.exists()


def test_a_path_that_cannot_be_written_fails_with_a_reason(tmp_path):
    """One line with the path; no exception."""
    (tmp_path / 'file').write_text('')
    kept = Kept(tmp_path / 'file' / 'left.yaml')
    kept.process(moving.views(0, 12))
    ok, text = kept.keeper.save()
    assert not ok
    assert str(tmp_path / 'file') in text


def test_an_invalid_file_is_an_error(path):
    """It is neither treated as missing nor overwritten."""
    path.parent.mkdir()
    path.write_text('image_width: 640\n')
    with pytest.raises(ConfigError, match=str(path)):
        Kept(path)
    assert path.read_text() == 'image_width: 640\n'


def test_a_file_of_another_program_is_used_in_mode_fixed(path):
    """Self-calibration does not start from it."""
    ours = moving.CAMERA.to_camera_info_model(moving.SIZE)
    model = replace(ours, residual_px=0.0)
    save_calibration(path, Calibration(image_size=moving.SIZE, camera_name='left', model=model))
    kept = Kept(path)
    assert 'written by another program' in kept.log.lines[0]
    calibrations = kept.keeper.calibrations
    assert calibrations.known_camera(moving.SIZE) == model
    assert calibrations.known_camera((1280, 960)).cause == 'image_size'
    calibrations.select(moving.SIZE, *SETTINGS)
    assert calibrations.state is CalibrationState.UNCALIBRATED


def test_what_a_file_leaves_open_is_warned_of(path):
    """And a chain of Kalibr is read, by the camera's name."""
    path.parent.mkdir()
    chain = '{intrinsics: [5, 6, 7, 8], resolution: [640, 480], distortion_coeffs: [1, 2, 3, 4]}'
    path.write_text(f'cam0: {chain}\ncam1: {chain}\n')
    kept = Kept(path, camera_name='cam1')
    assert kept.log.lines[0].startswith(f'WARN {path}: no distortion_model: taken as plumb_bob')
    assert kept.keeper.calibrations.known_camera((640, 480)).focal_px == (5.0, 6.0)
    with pytest.raises(ConfigError, match='got cam0, cam1: set camera_name'):
        Kept(path)


def test_a_pipe_does_not_block_the_start(tmp_path):
    """It is neither read nor written."""
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(ConfigError, match='expected a regular file, got a pipe'):
        Kept(tmp_path / 'pipe')


def test_without_calibration_file_the_path_is_that_of_camera_info_manager(monkeypatch, tmp_path):
    """It is not loaded, because it may belong to another camera."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    kept = Kept('', camera_name='left')
    kept.process(moving.views(0, 12))
    assert kept.keeper.save()[0]
    assert load_calibration(tmp_path / 'camera_info/left.yaml').camera_name == 'left'
    again = Kept('', camera_name='left')
    assert again.log.lines == []
    assert not again.keeper.calibrations.has_camera


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
def test_paths_follow_the_rules_of_camera_info_manager(monkeypatch, given, expected):
    """Paths and URLs."""
    monkeypatch.setenv('HOME', '/home/me')
    monkeypatch.delenv('ROS_HOME', raising=False)
    assert calibration_path(given, 'left') == Path(expected)


def test_a_url_of_another_scheme_is_an_error():
    """It is not treated as a path."""
    with pytest.raises(ConfigError, match=r"calibration_file: expected .* got 'package://a/b'"):
        calibration_path('package://a/b', 'left')


def test_the_home_of_an_unknown_user_is_an_error():
    """One line, no traceback."""
    with pytest.raises(ConfigError, match=r"calibration_file: .* got '~nobody_here/a.yaml': ~ is"):
        calibration_path('~nobody_here/a.yaml', 'left')


def test_a_user_without_a_home_can_save(monkeypatch):
    """As in a container with an unknown user ID."""

    def no_home():
        raise RuntimeError('Could not determine home directory.')

    monkeypatch.setattr(Path, 'home', no_home)
    monkeypatch.delenv('ROS_HOME', raising=False)
    path = calibration_path('', 'left')
    assert path == Path(tempfile.gettempdir()) / '.ros/camera_info/left.yaml'


def test_a_camera_name_must_be_a_valid_file_name():
    """It may not contain a path."""
    with pytest.raises(ConfigError, match=r'^camera_name: expected letters'):
        replaced(PoseNodeOptions(), {'camera_name': '../left'})
