# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The modes of the node without a node: views in, answers and news out."""

from typing import NamedTuple

from p4pfr_ros import DivisionCamera, PoseEstimate
from p4pfr_ros.ros.parameters.declare import replaced
from p4pfr_ros.ros.parameters.image_node_options import PoseNodeOptions
from p4pfr_ros.ros.pose.camera_source import Intrinsics
from p4pfr_ros.ros.pose.self_calibrating import SelfCalibrating
from p4pfr_ros.ros.runtime.rejections import Rejected

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
