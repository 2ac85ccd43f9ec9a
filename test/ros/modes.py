# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The intrinsics modes of pose_node without a node: observations in, estimates and cameras out."""

from typing import NamedTuple

from p4pfr_ros import CameraEstimate, DivisionCamera, PoseEstimate
from p4pfr_ros.ros.parameters.declare import replaced
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
from p4pfr_ros.ros.pose.camera_check import CameraCheck
from p4pfr_ros.ros.pose.camera_source import (
    CalibrationBySize,
    camera_to_publish,
    CameraSource,
    estimate_with,
)
from p4pfr_ros.ros.pose.inputs import Inputs
from p4pfr_ros.ros.runtime.rejections import Notice, Rejected

# Number of views after which the camera is calibrated.
CALIBRATING = 60


def options(mode, **values):
    """Return the options of pose_node with a mode; two underscores stand for a point."""
    named = {name.replace('__', '.'): value for name, value in values.items()}
    return replaced(PoseNodeOptions(), {'intrinsics.mode': mode} | named)


def fixed(camera):
    """Return the options of the mode fixed with a camera."""
    x, y = camera.center_px
    values = {'intrinsics__focal_px': camera.focal_px, 'intrinsics__k': camera.k}
    return options('fixed', image__center_x_px=x, image__center_y_px=y, **values)


SELF_CALIBRATE, FREEZE = options('self_calibrate'), options('fixed')


class Processed(NamedTuple):
    """The estimate of a view, the camera to publish without its estimate, and a notice."""

    estimate: PoseEstimate
    camera: DivisionCamera | None
    notice: Notice | None


class Modes:
    """The camera source of one node, and its calibrations."""

    def __init__(self, loaded=None, camera_info=None):
        self.calibrations = CalibrationBySize(loaded)
        inputs = Inputs('')
        if camera_info is not None:
            assert inputs.use_camera_info(camera_info) is None
        self._source = CameraSource(self.calibrations, inputs)
        self._check = CameraCheck()

    def process(self, observation, settings=SELF_CALIBRATE, on_pose=lambda _: None):
        """Process one observation as the pipeline does."""
        camera = self._source.camera_for(observation, settings)
        if isinstance(camera, Rejected):
            return camera
        estimate = estimate_with(camera, observation, settings, self._check, on_pose)
        mode = settings.intrinsics.mode
        in_use = camera_to_publish(camera, estimate, mode)
        if isinstance(in_use, CameraEstimate):
            in_use = in_use.camera
        notice = self.calibrations.finish_view() if mode == 'self_calibrate' else None
        return Processed(estimate, in_use, notice)

    def process_all(self, views, settings=SELF_CALIBRATE):
        """Process many views; return the last result."""
        return [self.process(view.observation, settings) for view in views][-1]
