# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Images of another size are treated as images of another camera."""

from modes import CALIBRATING, FREEZE, Modes
import moving
import numpy as np
from p4pfr_ros import CalibrationState
from p4pfr_ros.files.calibration import Calibration
from p4pfr_ros.ros.runtime.rejections import Rejected


def _larger(view):
    """Return the view in an image of twice the size."""
    return moving.observation(2.0 * view.image_points + 0.5, (1280, 960), view.index)


def test_another_image_size_is_another_camera():
    """A notice names both sizes, and the calibration restarts."""
    modes = Modes()
    modes.process_all(moving.views(0, 10))
    view = moving.views(10, 11)[0]
    notice = modes.process(_larger(view)).notice
    assert notice.cause == 'image_size'
    assert '640x480' in notice.reason
    assert '1280x960' in notice.reason
    assert modes.calibrations.image_size == (1280, 960)
    assert modes.calibrations.state is not CalibrationState.CALIBRATED
    assert modes.process(_larger(view)).notice is None
    third = moving.observation(view.image_points, (800, 600), 11)
    assert isinstance(modes.process(third, FREEZE), Rejected)


def test_the_camera_of_an_earlier_image_size_is_loaded_again():
    """So a second camera_info or a restarted driver does not discard the calibration."""
    modes = Modes()
    modes.process_all(moving.views(0, CALIBRATING))
    before, view = modes.calibrations.fused, moving.views(CALIBRATING, CALIBRATING + 1)[0]
    modes.process(_larger(view))
    assert modes.calibrations.restarted
    again = modes.process(view.observation)
    loaded, camera = again.estimate.model.camera, before.camera
    assert abs(loaded.focal_px - camera.focal_px) < 0.05 * before.focal_sigma_px
    difference_px = np.subtract(loaded.center_px, camera.center_px)
    assert (np.abs(difference_px) < 0.05 * before.center_sigma_px).all()
    assert again.notice.reason.endswith('treated as the earlier camera of that size')
    sizes = [(width, 480) for width in range(641, 660)]
    for size in sizes:
        modes.process(moving.observation(view.image_points, size, 10))
    # All sizes had a camera; the number of stored ones is limited.
    known = [size for size in sizes if not _is_rejected(modes.calibrations.known_camera(size))]
    assert 0 < len(known) <= 1 + 8
    assert known == sizes[-len(known) :]


def _is_rejected(camera):
    return isinstance(camera, Rejected)


def test_a_loaded_calibration_of_another_image_size_is_reported():
    """It is not used, and nothing has restarted."""
    calibrated = Modes()
    calibrated.process_all(moving.views(0, CALIBRATING))
    fused = calibrated.calibrations.fused
    modes = Modes(Calibration.from_estimate(fused, (1280, 960), 'left'))
    notice = modes.process(moving.views(0, 1)[0].observation).notice
    assert notice.cause == 'image_size'
    assert '1280x960' in notice.reason
    assert not modes.calibrations.restarted
    assert modes.process(moving.views(1, 2)[0].observation).notice is None
